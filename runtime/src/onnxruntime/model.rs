//! One ONNX file in an onnxruntime session: loading with every check, and batches in and out.

use super::library::environment;
use crate::backend::{Points, check_lengths};
use crate::error::{Error, Result};
use crate::network::parse_spec;
use crate::spec::{NetworkSpec, Port, Role, SPEC_KEY, params_port};
use ort::environment::Environment;
use ort::logging::LogLevel;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Queries per call of onnxruntime: enough to hide its cost per call, few enough to stay in the caches.
pub const CHUNK: usize = 1024;

/// A structure of arrays to be filled, under the name of the graph output that fills it.
type Output<'a> = (&'static str, Vec<&'a mut [f32]>);

/// A loaded model: a session for each thread that uses it at once, made when it first does.
pub struct Model {
    /// What it says it is.
    pub spec: NetworkSpec,
    /// The file it came from.
    pub path: PathBuf,
    /// The file's bytes, to make sessions of.
    bytes: Vec<u8>,
    environment: Environment,
    /// Inputs in order.
    ports: Vec<Port>,
    /// Queries per call of onnxruntime.
    pub chunk: usize,
    /// Sessions that no thread is using.
    idle: Mutex<Vec<Worker>>,
}

/// A session, and what it is given.
struct Worker {
    session: Session,
    /// Row-major `[N, width]` for each input, kept from call to call.
    rows: Vec<Vec<f32>>,
}

impl Model {
    /// Reads `path` and checks that it is a model of `role`.
    pub fn load(path: PathBuf, role: Role) -> Result<Model> {
        let environment = environment()?;
        let bytes = std::fs::read(&path).map_err(|e| Error::io(&path, e))?;
        let foreign = |reason: String| Error::network(&path, reason);
        let session =
            open(&environment, &bytes).map_err(|e| foreign(format!("onnxruntime refuses it ({e})")))?;
        let spec = read_spec(&session).map_err(foreign)?;
        if spec.role != role {
            return Err(foreign(format!("it is a {} network", spec.role.name())));
        }
        let free = spec.material.free().len();
        let params = (free > 0).then(|| params_port(free));
        let ports: Vec<Port> = params.into_iter().chain(*role.graph_inputs()).collect();
        check_ports("input", session.inputs(), &ports).map_err(foreign)?;
        check_ports("output", session.outputs(), role.graph_outputs()).map_err(foreign)?;
        Ok(Model {
            spec,
            path,
            idle: Mutex::new(vec![Worker {
                session,
                rows: vec![Vec::new(); ports.len()],
            }]),
            ports,
            chunk: CHUNK,
            bytes,
            environment,
        })
    }

    /// An idle session, or a new one.
    fn worker(&self) -> Result<Worker> {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        if let Some(worker) = idle {
            return Ok(worker);
        }
        let refused = |e| {
            Error::network(
                &self.path,
                format!("onnxruntime refuses another session of it ({e})"),
            )
        };
        Ok(Worker {
            session: open(&self.environment, &self.bytes).map_err(refused)?,
            rows: vec![Vec::new(); self.ports.len()],
        })
    }

    /// Runs a batch in chunks: `points`, and the structure of arrays `other` that the role asks for besides.
    pub fn run(&self, points: Points, other: &[&[f32]], outputs: &mut [Output]) -> Result<()> {
        let [_, second] = self.spec.role.graph_inputs();
        points.check(self.spec.material.free().len())?;
        let count = points.len();
        check_all(count, second.name, other.iter().map(|a| a.len()))?;
        for (name, arrays) in outputs.iter() {
            check_all(count, name, arrays.iter().map(|a| a.len()))?;
        }
        let mut worker = self.worker()?;
        let ran = self.run_chunks(&mut worker, points, other, outputs);
        self.idle
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .push(worker);
        ran
    }

    fn run_chunks(
        &self,
        worker: &mut Worker,
        points: Points,
        other: &[&[f32]],
        outputs: &mut [Output],
    ) -> Result<()> {
        let [camera, second] = self.spec.role.graph_inputs();
        let count = points.len();
        for start in (0..count).step_by(self.chunk) {
            let end = count.min(start + self.chunk);
            for (port, rows) in self.ports.iter().zip(&mut worker.rows) {
                let columns = match port.name {
                    name if name == camera.name => &points.wo,
                    name if name == second.name => other,
                    _ => points.params,
                };
                rows.clear();
                // A column of one value holds for every query.
                let at = |column: &[f32], i: usize| if column.len() == 1 { column[0] } else { column[i] };
                rows.extend((start..end).flat_map(|i| columns.iter().map(move |column| at(column, i))));
            }
            self.run_chunk(worker, outputs, start, end - start)?;
        }
        Ok(())
    }

    /// Runs the rows that are packed.
    fn run_chunk(
        &self,
        worker: &mut Worker,
        outputs: &mut [Output],
        start: usize,
        count: usize,
    ) -> Result<()> {
        let path = &self.path;
        let failed = |e: ort::Error| {
            Error::Onnxruntime(format!("{}: onnxruntime could not run it: {e}", path.display()))
        };
        let packed = self.ports.iter().zip(&worker.rows).map(|(port, rows)| {
            let tensor = TensorRef::from_array_view(([count, port.width], &rows[..]))?;
            Ok((port.name, tensor))
        });
        let inputs: Vec<_> = packed.collect::<ort::Result<_>>().map_err(failed)?;
        let answers = worker.session.run(inputs).map_err(failed)?;
        for (name, arrays) in outputs.iter_mut() {
            let answer = answers
                .get(*name)
                .ok_or_else(|| Error::network(path, format!("it has no output `{name}`")))?;
            let (_, values) = answer.try_extract_tensor::<f32>().map_err(failed)?;
            let width = arrays.len();
            if values.len() != count * width {
                return Err(Error::network(
                    path,
                    format!("output `{name}` is not [N, {width}]"),
                ));
            }
            for (c, array) in arrays.iter_mut().enumerate() {
                let column = values[c..].iter().step_by(width);
                array[start..start + count]
                    .iter_mut()
                    .zip(column)
                    .for_each(|(to, from)| *to = *from);
            }
        }
        Ok(())
    }
}

fn check_all(count: usize, name: &'static str, lengths: impl Iterator<Item = usize>) -> Result<()> {
    lengths
        .into_iter()
        .try_for_each(|length| check_lengths(count, &[(name, length)]))
}

/// A session that stays on the caller's thread and writes nothing to the terminal.
pub fn open(environment: &Environment, bytes: &[u8]) -> ort::Result<Session> {
    Session::builder(environment)?
        .with_log_level(LogLevel::Fatal)?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_intra_threads(1)?
        .with_inter_threads(1)?
        .with_intra_op_spinning(false)?
        .with_inter_op_spinning(false)?
        .commit_from_memory(bytes)
}

fn read_spec(session: &Session) -> std::result::Result<NetworkSpec, String> {
    let metadata = session
        .metadata()
        .map_err(|e| format!("its metadata cannot be read ({e})"))?;
    let json = metadata
        .custom(SPEC_KEY)
        .ok_or_else(|| format!("its metadata has no `{SPEC_KEY}`, so another program wrote it"))?;
    parse_spec(&json)
}

fn check_ports(kind: &str, found: &[Outlet], expected: &[Port]) -> std::result::Result<(), String> {
    let matches = |outlet: &Outlet, port: &Port| {
        let float = matches!(outlet.dtype(), ValueType::Tensor { ty: TensorElementType::Float32, shape, .. }
            if shape[..] == [-1, port.width as i64]);
        outlet.name() == port.name && float
    };
    if found.len() == expected.len()
        && found
            .iter()
            .zip(expected)
            .all(|(outlet, port)| matches(outlet, port))
    {
        return Ok(());
    }
    let wanted: Vec<String> = expected
        .iter()
        .map(|port| format!("{} [N, {}]", port.name, port.width))
        .collect();
    Err(format!("its {kind}s are not {}", wanted.join(", ")))
}
