//! Our optimisers: rules that move one flat vector of parameters against its gradient, with a state that can be
//! saved. candle's AdamW keeps its moments to itself, so a run could not be resumed with it.

mod layout;
mod moments;
mod muon;

pub use layout::{Block, Kind, layout};

use moments::{ADAM, RANGER};
use muon::orthogonalised;
use rayon::prelude::*;
use std::ops::Range;

/// Steps between two steps of the slow weights (Zhang et al. 2019; the default of the released Ranger).
const LOOKAHEAD_STEPS: u64 = 6;
/// Share of the way to the fast weights that the slow ones go (the same).
const LOOKAHEAD_SHARE: f32 = 0.5;

/// How parameters follow their gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Muon for hidden matrices (Jordan et al. 2024: momentum, made orthogonal, longer by √(rows/columns) where
    /// there are more rows), Adam for the rest; both at the same rate.
    Muon,
    /// Adam with default parameters (Kingma and Ba 2015).
    Adam,
    /// Ranger (Wright 2019): rectified Adam (Liu et al. 2020) on gradients whose mean over the inputs of an output
    /// is taken away (Yong et al. 2020), and slow weights that follow and catch the fast ones (Zhang et al. 2019).
    /// A weight of a single input is not centred, for it could never move.
    Ranger,
}

/// All parameters of a training run with what their rule remembers.
#[derive(Clone, Debug, PartialEq)]
pub struct Optimiser {
    /// How parameters move.
    pub rule: Rule,
    /// The tensors that they make up, side by side and without gaps.
    pub blocks: Vec<Block>,
    /// Parameters.
    pub value: Vec<f32>,
    /// Running mean of every gradient.
    pub first: Vec<f32>,
    /// Running mean of its square; stays 0 where Muon moves.
    pub second: Vec<f32>,
    /// Slow weights of Ranger; empty for the other rules.
    pub slow: Vec<f32>,
    /// Steps taken.
    pub step: u64,
}

impl Optimiser {
    /// Starts from `value`, which holds the tensors `blocks`.
    pub fn new(rule: Rule, blocks: Vec<Block>, value: Vec<f32>) -> Optimiser {
        let zeros = vec![0.0; value.len()];
        Optimiser {
            rule,
            blocks,
            slow: if rule == Rule::Ranger {
                value.clone()
            } else {
                Vec::new()
            },
            value,
            first: zeros.clone(),
            second: zeros,
            step: 0,
        }
    }

    /// Moves every parameter against `gradient`, which is as long as the parameters, at the learning rate `rate`.
    pub fn descend(&mut self, gradient: &[f32], rate: f64) {
        self.step += 1;
        match self.rule {
            Rule::Muon => self.muon(gradient, rate),
            Rule::Adam => self.adam(0..gradient.len(), gradient, rate),
            Rule::Ranger => self.ranger(gradient, rate),
        }
    }

    fn adam(&mut self, range: Range<usize>, gradient: &[f32], rate: f64) {
        let gradient = &gradient[range.clone()];
        let (first, second) = (&mut self.first[range.clone()], &mut self.second[range.clone()]);
        ADAM.average(first, gradient.iter().copied());
        ADAM.average_square(second, gradient.iter().copied());
        ADAM.step(&mut self.value[range], first, second, ADAM.adam(self.step, rate));
    }

    fn muon(&mut self, gradient: &[f32], rate: f64) {
        let (hidden, rest): (Vec<Block>, Vec<Block>) =
            self.blocks.iter().partition(|b| b.kind == Kind::Hidden);
        for block in rest {
            self.adam(block.range(), gradient, rate);
        }
        for block in &hidden {
            let first = &mut self.first[block.range()];
            ADAM.average(first, gradient[block.range()].iter().copied());
        }
        let step = |b: &Block| orthogonalised(&self.first[b.range()], b.rows, b.columns);
        let steps: Vec<Vec<f32>> = hidden.par_iter().map(step).collect();
        for (block, step) in hidden.iter().zip(&steps) {
            let scale = (rate * (block.rows as f64 / block.columns as f64).max(1.0).sqrt()) as f32;
            let value = &mut self.value[block.range()];
            value.iter_mut().zip(step).for_each(|(v, s)| *v -= scale * s);
        }
    }

    fn ranger(&mut self, gradient: &[f32], rate: f64) {
        for block in &self.blocks {
            for row in 0..block.rows {
                let start = block.offset + row * block.columns;
                let range = start..start + block.columns;
                let own = &gradient[range.clone()];
                let mean = if block.columns > 1 {
                    own.iter().sum::<f32>() / block.columns as f32
                } else {
                    0.0
                };
                let centred = own.iter().map(|g| g - mean);
                RANGER.average(&mut self.first[range.clone()], centred.clone());
                RANGER.average_square(&mut self.second[range], centred);
            }
        }
        let stride = RANGER.rectified(self.step, rate);
        RANGER.step(&mut self.value, &self.first, &self.second, stride);
        if self.step.is_multiple_of(LOOKAHEAD_STEPS) {
            for (slow, fast) in self.slow.iter_mut().zip(&mut self.value) {
                *slow += LOOKAHEAD_SHARE * (*fast - *slow);
                *fast = *slow;
            }
        }
    }

    /// Whether every number of the state is finite.
    pub fn is_finite(&self) -> bool {
        let all = [&self.value, &self.first, &self.second, &self.slow];
        all.iter().all(|v| v.iter().all(|x| x.is_finite()))
    }
}
