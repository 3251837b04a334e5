//! A builder of ONNX graphs: operations read as arithmetic, names are made up, equal constants are shared.
//!
//! Nodes are appended in the order of the calls, so the graph is sorted topologically and the same calls
//! always give the same bytes. Shapes in comments are `[rows, columns]`; N is the batch.

use crate::proto::{
    AttributeProto, AttributeType, DataType, DimensionProto, Extent, GraphProto, NodeProto, TensorProto,
    TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto,
};
use bake_runtime::spec::Port;
use std::collections::BTreeMap;
use std::ops::Range;

/// Name of the batch axis.
pub const BATCH_AXIS: &str = "N";

/// A tensor of the graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Value(usize);

/// A graph under construction.
#[derive(Default)]
pub struct Graph {
    proto: GraphProto,
    names: Vec<String>,
    scope: &'static str,
    /// By shape and bytes, which tell floats and integers apart too.
    constants: BTreeMap<(Vec<usize>, Vec<u8>), Value>,
}

impl Graph {
    /// The finished graph.
    pub fn finish(mut self, name: &str, doc: &str) -> GraphProto {
        self.proto.name = Some(name.into());
        self.proto.doc_string = Some(doc.into());
        self.proto
    }

    /// Begins a section: the names of what follows start with it, for whoever looks at the graph.
    pub fn scope(&mut self, scope: &'static str) {
        self.scope = scope;
    }

    /// Declares a graph input, float `[N, port.width]`.
    pub fn input(&mut self, port: &Port) -> Value {
        self.proto.input.push(value_info(port));
        self.named(port.name.into())
    }

    /// Makes `value` the graph output `port`.
    pub fn output(&mut self, port: &Port, value: Value) {
        let output = self.named(port.name.into());
        self.push("Identity", &[value], &[output], vec![]);
        self.proto.output.push(value_info(port));
    }

    /// A constant scalar.
    pub fn scalar(&mut self, value: f32) -> Value {
        self.constant(&[], &[value])
    }

    /// A constant tensor; equal ones are stored once.
    pub fn constant(&mut self, shape: &[usize], values: &[f32]) -> Value {
        self.shared(shape, DataType::Float, float_bytes(values))
    }

    /// A named float tensor, row-major.
    pub fn initializer(&mut self, name: String, shape: &[usize], values: &[f32]) -> Value {
        self.push_initializer(name, shape, DataType::Float, float_bytes(values))
    }

    pub fn add(&mut self, a: Value, b: Value) -> Value {
        self.op("Add", &[a, b])
    }

    pub fn sub(&mut self, a: Value, b: Value) -> Value {
        self.op("Sub", &[a, b])
    }

    pub fn mul(&mut self, a: Value, b: Value) -> Value {
        self.op("Mul", &[a, b])
    }

    pub fn div(&mut self, a: Value, b: Value) -> Value {
        self.op("Div", &[a, b])
    }

    /// a + b for a constant b.
    pub fn add_scalar(&mut self, a: Value, b: f32) -> Value {
        let b = self.scalar(b);
        self.add(a, b)
    }

    /// a·b for a constant b.
    pub fn mul_scalar(&mut self, a: Value, b: f32) -> Value {
        let b = self.scalar(b);
        self.mul(a, b)
    }

    /// 1 − a.
    pub fn one_minus(&mut self, a: Value) -> Value {
        let one = self.scalar(1.0);
        self.sub(one, a)
    }

    /// An operation of one tensor without attributes: `Abs`, `Cos`, `Exp`, `Log`, `Neg`, `Relu`, `Round` (halves to
    /// even), `Sigmoid`, `Sin`, `Sqrt`.
    pub fn unary(&mut self, op: &'static str, a: Value) -> Value {
        self.op(op, &[a])
    }

    pub fn min(&mut self, a: Value, b: Value) -> Value {
        self.op("Min", &[a, b])
    }

    pub fn max(&mut self, a: Value, b: Value) -> Value {
        self.op("Max", &[a, b])
    }

    /// a limited to −bound..bound.
    pub fn clip(&mut self, a: Value, bound: f32) -> Value {
        let (low, high) = (self.scalar(-bound), self.scalar(bound));
        self.op("Clip", &[a, low, high])
    }

    /// a > b, elementwise; false for NaN.
    pub fn greater(&mut self, a: Value, b: Value) -> Value {
        self.op("Greater", &[a, b])
    }

    /// a < b, elementwise; false for NaN.
    pub fn less(&mut self, a: Value, b: Value) -> Value {
        self.op("Less", &[a, b])
    }

    /// a ≤ b, elementwise; false for NaN.
    pub fn less_or_equal(&mut self, a: Value, b: Value) -> Value {
        self.op("LessOrEqual", &[a, b])
    }

    pub fn and(&mut self, a: Value, b: Value) -> Value {
        self.op("And", &[a, b])
    }

    /// Elements of `yes` where `condition` holds, else of `no`; a NaN in the other one does no harm.
    pub fn select(&mut self, condition: Value, yes: Value, no: Value) -> Value {
        self.op("Where", &[condition, yes, no])
    }

    /// Joins columns: `[N, a]`, `[N, b]`, … ↦ `[N, a + b + …]`.
    pub fn concat(&mut self, parts: &[Value]) -> Value {
        if let [only] = parts {
            return *only;
        }
        self.join(parts, 1)
    }

    /// The K equal parts of the columns of `[N, K·k]`, each `[N, k]`: single columns where there are K.
    pub fn columns<const K: usize>(&mut self, a: Value) -> [Value; K] {
        self.split(a, 1)
    }

    /// The single columns of a `[N, count]` tensor, each `[N, 1]`.
    pub fn column_list(&mut self, a: Value, count: usize) -> Vec<Value> {
        if count == 1 {
            return vec![a];
        }
        let out: Vec<Value> = (0..count).map(|_| self.fresh("Split")).collect();
        self.push("Split", &[a], &out, vec![integer("axis", 1)]);
        out
    }

    /// Two tensors `[N, k]` out of the pair `[2, N, k]`.
    pub fn unstack(&mut self, pair: Value) -> [Value; 2] {
        let axis = self.integers(&[0]);
        let parts: [Value; 2] = self.split(pair, 0);
        parts.map(|part| self.op("Squeeze", &[part, axis]))
    }

    /// `a` with another axis, of length 1, after its last; it has `rank` of them.
    pub fn deepen(&mut self, a: Value, rank: i64) -> Value {
        let axis = self.integers(&[rank]);
        self.op("Unsqueeze", &[a, axis])
    }

    /// All axes but the first in one: `[N, …]` ↦ `[N, width]`.
    pub fn flatten(&mut self, a: Value, width: usize) -> Value {
        // 0 keeps the axis as it is.
        let shape = self.integers(&[0, width as i64]);
        self.op("Reshape", &[a, shape])
    }

    /// a₀, b₀, a₁, b₁, …: the elements of two tensors `[N, s, k]` by turns, `[N, width]` with width = 2·s·k.
    pub fn interleave(&mut self, a: Value, b: Value, width: usize) -> Value {
        let pair = [a, b].map(|part| self.deepen(part, 3));
        let joined = self.join(&pair, 3);
        self.flatten(joined, width)
    }

    /// Some rows of a matrix.
    pub fn rows(&mut self, a: Value, rows: Range<usize>) -> Value {
        let (start, end) = (
            self.integers(&[rows.start as i64]),
            self.integers(&[rows.end as i64]),
        );
        self.op("Slice", &[a, start, end])
    }

    /// Sum of |elements| of each row, `[N, k]` ↦ `[N, 1]`: finite exactly when every element is, short of overflow.
    pub fn row_l1(&mut self, a: Value) -> Value {
        let out = self.fresh("ReduceL1");
        let axes = AttributeProto {
            name: Some("axes".into()),
            ints: vec![1],
            r#type: Some(AttributeType::Ints as i32),
            ..Default::default()
        };
        self.push("ReduceL1", &[a], &[out], vec![axes]);
        out
    }

    /// Matrix product of the last two axes, x·weight.
    pub fn matmul(&mut self, x: Value, weight: Value) -> Value {
        self.op("MatMul", &[x, weight])
    }

    /// x·weight + bias for `[N, i]`, `[i, o]`, `[o]`.
    pub fn affine(&mut self, x: Value, weight: Value, bias: Value) -> Value {
        self.op("Gemm", &[x, weight, bias])
    }

    fn split<const K: usize>(&mut self, a: Value, axis: i64) -> [Value; K] {
        let out: [Value; K] = std::array::from_fn(|_| self.fresh("Split"));
        self.push("Split", &[a], &out, vec![integer("axis", axis)]);
        out
    }

    fn join(&mut self, parts: &[Value], axis: i64) -> Value {
        let out = self.fresh("Concat");
        self.push("Concat", parts, &[out], vec![integer("axis", axis)]);
        out
    }

    fn integers(&mut self, values: &[i64]) -> Value {
        let raw = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.shared(&[values.len()], DataType::Int64, raw)
    }

    fn shared(&mut self, shape: &[usize], data_type: DataType, raw: Vec<u8>) -> Value {
        let key = (shape.to_vec(), raw);
        if let Some(&known) = self.constants.get(&key) {
            return known;
        }
        let name = format!("constant.{}", self.constants.len());
        let value = self.push_initializer(name, shape, data_type, key.1.clone());
        self.constants.insert(key, value);
        value
    }

    fn op(&mut self, op: &'static str, inputs: &[Value]) -> Value {
        let out = self.fresh(op);
        self.push(op, inputs, &[out], vec![]);
        out
    }

    fn push(
        &mut self,
        op: &'static str,
        inputs: &[Value],
        outputs: &[Value],
        attribute: Vec<AttributeProto>,
    ) {
        let name = |v: &Value| self.names[v.0].clone();
        self.proto.node.push(NodeProto {
            input: inputs.iter().map(name).collect(),
            output: outputs.iter().map(name).collect(),
            name: Some(format!("node.{}", self.proto.node.len())),
            op_type: Some(op.into()),
            attribute,
        });
    }

    fn push_initializer(
        &mut self,
        name: String,
        shape: &[usize],
        data_type: DataType,
        raw: Vec<u8>,
    ) -> Value {
        self.proto.initializer.push(TensorProto {
            dims: shape.iter().map(|&d| d as i64).collect(),
            data_type: Some(data_type as i32),
            name: Some(name.clone()),
            raw_data: Some(raw),
        });
        self.named(name)
    }

    fn fresh(&mut self, op: &str) -> Value {
        let name = format!("{}/{}.{}", self.scope, op, self.names.len());
        self.named(name)
    }

    fn named(&mut self, name: String) -> Value {
        self.names.push(name);
        Value(self.names.len() - 1)
    }
}

fn float_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn integer(name: &str, value: i64) -> AttributeProto {
    AttributeProto {
        name: Some(name.into()),
        i: Some(value),
        r#type: Some(AttributeType::Int as i32),
        ..Default::default()
    }
}

fn value_info(port: &Port) -> ValueInfoProto {
    let extents = [Extent::Param(BATCH_AXIS.into()), Extent::Value(port.width as i64)];
    let dim = extents
        .into_iter()
        .map(|extent| DimensionProto { value: Some(extent) })
        .collect();
    let tensor = TensorTypeProto {
        elem_type: Some(DataType::Float as i32),
        shape: Some(TensorShapeProto { dim }),
    };
    ValueInfoProto {
        name: Some(port.name.into()),
        r#type: Some(TypeProto {
            tensor_type: Some(tensor),
        }),
        doc_string: Some(port.doc.into()),
    }
}
