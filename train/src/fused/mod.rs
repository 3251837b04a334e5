//! Training without a graph: loss and gradients of a whole multilayer perceptron in one pass over tiles of
//! queries that never leave the cache.
//!
//! candle writes every intermediate tensor of a batch to memory and reads it back. Here some dozens of queries
//! go through all layers, through the loss and back, and only the sum of their weight gradients remains. The
//! arithmetic goes through the runtime's vectors, so every tier has it. Batches are cut into shards, by their
//! size alone: results do not depend on the number of threads.
//!
//! A row of a query is a *column*: column 0 holds values, the others the derivatives along as many tangents
//! (for a loss that needs the Jacobian by u: two), which the network maps by its chain rule; losses may depend
//! on all of them.

mod activation;
mod aligned;
mod loss;
mod operation;
mod packed;
mod product;
mod shape;
mod tile;

pub use loss::{Features, Outputs, OutputsMut, TileLoss};
pub use operation::FusedLoss;
pub use shape::{Nonlinearity, Shape};

use crate::error::Result;
use aligned::Aligned;
use bake_runtime::Error;
use bake_runtime::simd::{Simd, Tier, TierTask, Vector};
use packed::Layer;
use product::ROWS;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use tile::Tile;

/// Rows of a shard, over all columns, until there are [`SHARDS`]: what a shard's gradient costs to clear and to
/// add up is then below 3 % of finding it.
const SHARD_ROWS: usize = 256;
/// Most shards of a batch: they are of one size, so that up to as many cores have equal shares.
const SHARDS: usize = 16;

/// A network's buffers for a tier and a number of columns; they are kept from step to step.
pub struct Fused {
    tier: Tier,
    shape: Shape,
    columns: usize,
    lanes: usize,
    layers: Vec<Layer>,
    /// One per thread.
    tiles: Vec<Tile>,
    /// Gradient and loss of each shard.
    shards: Vec<Mutex<(Aligned, f64)>>,
}

impl Fused {
    /// Buffers for networks of `shape` whose queries have `columns` rows: 1 for values alone, 1 + the number of
    /// tangents with them.
    ///
    /// # Errors
    /// [`Error::Tier`] when the processor lacks `tier`, [`Error::Query`] for 0 columns.
    pub fn new(tier: Tier, shape: Shape, columns: usize) -> Result<Fused> {
        if columns == 0 {
            return Err(Error::query("columns", "is 0, but values are the first").into());
        }
        let lanes = tier.dispatch(Lanes)?;
        Ok(Fused {
            tier,
            layers: packed::zeros(&shape, lanes),
            shape,
            columns,
            lanes,
            tiles: Vec::new(),
            shards: Vec::new(),
        })
    }

    /// The network's shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Mean of `loss` over `queries` queries, and its gradient by every parameter; both flat as [`Shape`] says.
    ///
    /// # Errors
    /// [`Error::Query`] for a wrong number of parameters, or no queries.
    pub fn step(
        &mut self,
        parameters: &[f32],
        queries: usize,
        loss: &impl TileLoss,
    ) -> Result<(f64, Vec<f32>)> {
        self.pack(parameters, queries)?;
        let (blocks, most) = (queries.div_ceil(ROWS), tile::most_queries(self.columns));
        let shards = (queries * self.columns / SHARD_ROWS).clamp(1, SHARDS.min(blocks));
        let length = self.layers.iter().map(Layer::gradient).sum();
        while self.shards.len() < shards {
            self.shards.push(Mutex::new((Aligned::zeros(length), 0.0)));
        }
        let (tier, layers, slots) = (self.tier, &self.layers, &self.shards[..shards]);
        share(&mut self.tiles, shards, |tile, shard| {
            let (gradient, value) = &mut *unpoisoned(slots[shard].lock());
            let edge = |shard: usize| (shard * blocks / shards * ROWS).min(queries);
            *value = tier.dispatch(Shard {
                tile,
                layers,
                most,
                queries: edge(shard)..edge(shard + 1),
                loss,
                gradient,
            })?;
            Ok(())
        })?;
        let mut value = 0.0;
        let mut gradient = vec![0.0; self.shape.parameters()];
        for slot in &mut self.shards[..shards] {
            let (part, loss) = unpoisoned(slot.get_mut());
            packed::add_gradient(&self.layers, part, 1.0 / queries as f32, &mut gradient);
            value += *loss;
        }
        Ok((value / queries as f64, gradient))
    }

    /// Outputs `[columns][queries][outputs]` for rows of features `[columns][queries][inputs]`.
    ///
    /// # Errors
    /// [`Error::Query`] for a wrong number of parameters, or rows that are not whole.
    pub fn forward(&mut self, parameters: &[f32], rows: &[f32]) -> Result<Vec<f32>> {
        let (inputs, outputs) = (self.shape.inputs(), self.shape.outputs());
        let queries = rows.len() / (self.columns * inputs);
        if !rows.len().is_multiple_of(self.columns * inputs) {
            let reason = format!(
                "have {} numbers, not a multiple of {} columns of {inputs}",
                rows.len(),
                self.columns
            );
            return Err(Error::query("rows", reason).into());
        }
        self.pack(parameters, queries)?;
        let per_tile = tile::most_queries(self.columns);
        let (tier, layers, columns) = (self.tier, &self.layers, self.columns);
        let slots: Vec<Mutex<Vec<f32>>> = (0..queries.div_ceil(per_tile))
            .map(|_| Mutex::default())
            .collect();
        share(&mut self.tiles, slots.len(), |tile, index| {
            let first = index * per_tile;
            *unpoisoned(slots[index].lock()) = tier.dispatch(Evaluation {
                tile,
                layers,
                rows,
                inputs,
                queries: first..(first + per_tile).min(queries),
                all: queries,
                columns,
            })?;
            Ok(())
        })?;
        let mut out = vec![0.0; columns * queries * outputs];
        for (index, planes) in slots.into_iter().enumerate() {
            let planes = unpoisoned(planes.into_inner());
            let count = planes.len() / (columns * outputs);
            for (i, plane) in planes.chunks_exact(count).enumerate() {
                let (column, output) = (i / outputs, i % outputs);
                let start = (column * queries + index * per_tile) * outputs + output;
                for (out, value) in out[start..].iter_mut().step_by(outputs).zip(plane) {
                    *out = *value;
                }
            }
        }
        Ok(out)
    }

    /// Packs `parameters`, and sees that there is a tile for every thread.
    fn pack(&mut self, parameters: &[f32], queries: usize) -> Result<()> {
        let expected = self.shape.parameters();
        if parameters.len() != expected {
            let reason = format!("are {}, but the network has {expected}", parameters.len());
            return Err(Error::query("parameters", reason).into());
        }
        if queries == 0 {
            return Err(Error::query("queries", "are 0, of which there is no mean").into());
        }
        packed::fill(&mut self.layers, self.lanes, parameters);
        let (layers, nonlinearity, columns) = (&self.layers, self.shape.nonlinearity(), self.columns);
        self.tiles.resize_with(rayon::current_num_threads(), || {
            Tile::new(layers, nonlinearity, columns)
        });
        Ok(())
    }
}

/// Runs `work` for each of `jobs`: whichever thread is free takes the next one, with a tile of its own, which
/// stays in its cache.
fn share(
    tiles: &mut [Tile],
    jobs: usize,
    work: impl Fn(&mut Tile, usize) -> Result<()> + Sync,
) -> Result<()> {
    let next = AtomicUsize::new(0);
    tiles.par_iter_mut().try_for_each(|tile| {
        loop {
            let job = next.fetch_add(1, Ordering::Relaxed);
            if job >= jobs {
                return Ok(());
            }
            work(tile, job)?;
        }
    })
}

/// What a lock guards; if its holder panicked, that panic is already on its way.
fn unpoisoned<T>(lock: std::result::Result<T, PoisonError<T>>) -> T {
    lock.unwrap_or_else(PoisonError::into_inner)
}

/// Tells a tier's number of lanes.
struct Lanes;

impl TierTask for Lanes {
    type Out = usize;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> usize {
        S::Vector::LANES
    }
}

/// The tiles of one shard, one after the other; gives the sum of their losses.
struct Shard<'a, L> {
    tile: &'a mut Tile,
    layers: &'a [Layer],
    /// Most queries of a tile.
    most: usize,
    queries: Range<usize>,
    loss: &'a L,
    gradient: &'a mut [f32],
}

impl<L: TileLoss> TierTask for Shard<'_, L> {
    type Out = f64;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f64 {
        self.gradient.fill(0.0);
        let mut value = 0.0;
        let all = self.queries.len();
        let per_tile = all.div_ceil(all.div_ceil(self.most)).next_multiple_of(ROWS);
        for first in self.queries.clone().step_by(per_tile) {
            let queries = first..(first + per_tile).min(self.queries.end);
            value += self
                .tile
                .train(simd, self.layers, self.loss, queries, self.gradient);
        }
        value
    }
}

/// The outputs of one tile, plane after plane.
struct Evaluation<'a> {
    tile: &'a mut Tile,
    layers: &'a [Layer],
    rows: &'a [f32],
    inputs: usize,
    queries: Range<usize>,
    all: usize,
    columns: usize,
}

impl TierTask for Evaluation<'_> {
    type Out = Vec<f32>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Vec<f32> {
        let Range { start, end } = self.queries;
        let planes = self.tile.evaluate(simd, self.layers, end - start, |features| {
            for column in 0..self.columns {
                for query in start..end {
                    let row = &self.rows[(column * self.all + query) * self.inputs..][..self.inputs];
                    features.row(column, query - start).copy_from_slice(row);
                }
            }
        });
        planes.to_vec()
    }
}
