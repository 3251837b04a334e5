//! Importance maps: what every solver gives, whatever it is made of.

/// A map from uniform numbers to positions on [−1, 1]², the orthographic disk of directions for a slice and the whole
/// square for a picture.
pub trait ImportanceMap: Sync {
    /// Position of `u` in `[0,1)²`.
    fn at(&self, u: [f64; 2]) -> [f64; 2];

    /// Determinant of the derivative at `u` in the map's own square, > 0 where the map keeps its orientation.
    fn determinant(&self, u: [f64; 2]) -> f64;

    /// Values of u₀ inside (0, 1) at which one chart ends and the next begins; the map jumps there.
    fn breaks(&self) -> Vec<f64> {
        Vec::new()
    }
}

/// The map as the paper stores it: positions of the cell centres of the unit square, bilinear between them.
#[derive(Clone, Debug, PartialEq)]
pub struct MapImage {
    /// Cells per side.
    pub side: usize,
    /// Positions on [−1, 1]², `side`², u₀ fastest.
    pub points: Vec<[f64; 2]>,
}
