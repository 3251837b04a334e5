//! Where the tensors of a network lie in the one vector that is optimised.

/// What a tensor is, for the rules that treat tensors differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A weight matrix between two hidden layers.
    Hidden,
    /// A weight matrix that touches the inputs or the outputs.
    Outer,
    /// A bias.
    Bias,
}

/// One tensor of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block {
    /// Index of its first value.
    pub offset: usize,
    /// Outputs of its layer.
    pub rows: usize,
    /// Inputs of its layer, 1 for a bias; values are row-major.
    pub columns: usize,
    /// What it is.
    pub kind: Kind,
}

impl Block {
    /// The indices of its values.
    pub fn range(self) -> std::ops::Range<usize> {
        self.offset..self.offset + self.rows * self.columns
    }
}

/// The tensors of a chain of dense layers of (inputs, outputs): weight, bias, weight, bias and so on, each weight
/// `[outputs][inputs]`.
pub fn layout(layers: &[(usize, usize)]) -> Vec<Block> {
    let mut blocks = Vec::with_capacity(2 * layers.len());
    let mut offset = 0;
    for (layer, &(inputs, outputs)) in layers.iter().enumerate() {
        let inner = layer > 0 && layer + 1 < layers.len();
        let weight = if inner { Kind::Hidden } else { Kind::Outer };
        for (columns, kind) in [(inputs, weight), (1, Kind::Bias)] {
            blocks.push(Block {
                offset,
                rows: outputs,
                columns,
                kind,
            });
            offset += outputs * columns;
        }
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_follow_each_other_and_only_inner_weights_are_hidden() {
        let blocks = layout(&[(3, 4), (4, 5), (5, 2)]);
        let kinds: Vec<Kind> = blocks.iter().map(|b| b.kind).collect();
        use Kind::{Bias, Hidden, Outer};
        assert_eq!(kinds, [Outer, Bias, Hidden, Bias, Outer, Bias]);
        let mut end = 0;
        for block in &blocks {
            assert_eq!(block.range().start, end);
            end = block.range().end;
        }
        assert_eq!(end, 3 * 4 + 4 + 4 * 5 + 5 + 5 * 2 + 2);
        assert_eq!((blocks[2].rows, blocks[2].columns), (5, 4));
    }
}
