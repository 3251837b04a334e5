//! Importance maps and what they draw as square tiles of codes, y upwards.

use crate::box_filter::box_filter;
use crate::map_picture::Square;
use crate::picture::{SHOULDER, srgb_code, tone};
use crate::sheet::{PAPER, mixed};

/// Side of a tile, pixels: four for each of 64 bins.
pub const TILE: usize = 256;

/// Share of the mass in cells that are shown without bending their highlights, so that a lobe shows its shape however
/// small it is.
const EXPOSED_MASS: f64 = 0.8;

/// Share of the sum of all differences in bins that the scale of colours spans; the rest takes the colour at its end.
const SPANNED: f64 = 0.9;

/// Codes of the far ends of differences: too little and too much was drawn there. No difference is paper.
const LESS: [u8; 3] = [84, 160, 255];
const MORE: [u8; 3] = [255, 92, 72];

/// Code of the rim of the disk, and half its width in pixels.
const RIM: ([u8; 3], f32) = ([110, 114, 122], 0.5);

/// The linear value at which [`weight`] shows the mean.
const MEAN_WEIGHT: f64 = 0.5;

/// `TILE`² codes, row by row from the top.
pub type Tile = Vec<[u8; 3]>;

/// One value of every cell of `square` in the pixels of a tile.
fn spread<T>(square: &Square<T>, value: impl Fn(&T) -> f64) -> Vec<f64> {
    let values: Vec<f64> = square.values.iter().map(value).collect();
    let size = [square.side; 2];
    let upwards = box_filter(&values, size, [0.0; 2], square.side as f64, TILE);
    upwards.rchunks(TILE).flatten().copied().collect()
}

/// What makes of the mass of a cell a density, whose mean is 1 when the masses sum to 1.
fn density(mass: &Square<f64>) -> f64 {
    (mass.side * mass.side) as f64
}

/// The value at or below which `share` of the sum of `values` ≥ 0 lies; 0 when there is none.
fn level(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let wanted = share * values.iter().sum::<f64>();
    let mut below = 0.0;
    let reached = values.iter().find(|v| {
        below += **v;
        below >= wanted
    });
    reached.copied().unwrap_or(0.0)
}

/// The density at which the bright end of pictures begins to bend: [`EXPOSED_MASS`] lies at or below it.
pub fn exposure(mass: &Square<f64>) -> f64 {
    level(mass.values.clone(), EXPOSED_MASS) * density(mass)
}

/// Masses per cell as a grey picture, exposed for the density `exposed`.
pub fn mass(mass: &Square<f64>, exposed: f64) -> Tile {
    let scale = f64::from(SHOULDER) * density(mass) / exposed.max(f64::MIN_POSITIVE);
    let grey = |v: &f64| [srgb_code(tone((v * scale) as f32, 0.0)); 3];
    spread(mass, |v| *v).iter().map(grey).collect()
}

/// Positions on [−1, 1]² as codes from 0 to 255, x red and y green.
pub fn map(map: &Square<[f32; 2]>) -> Tile {
    let [x, y] = [0, 1].map(|axis| spread(map, |p: &[f32; 2]| f64::from(p[axis])));
    let code = |v: f64| ((v + 1.0) / 2.0 * 255.0).round() as u8;
    x.iter().zip(&y).map(|(x, y)| [code(*x), code(*y), 0]).collect()
}

/// The size of differences at which colours end, by [`SPANNED`]; 0 when all are.
pub fn span(differences: impl Iterator<Item = f64>) -> f64 {
    level(differences.map(f64::abs).collect(), SPANNED)
}

/// The code of a difference as a share of the span.
pub fn diverging(share: f64) -> [u8; 3] {
    mixed(PAPER, if share < 0.0 { LESS } else { MORE }, share.abs() as f32)
}

/// Differences per bin, blue where negative and red where positive.
pub fn difference(differences: &Square<f64>, span: f64) -> Tile {
    let shares = spread(differences, |v| v / span.max(f64::MIN_POSITIVE));
    shares.into_iter().map(diverging).collect()
}

/// The mean of the channel in which it is largest.
fn mean_weight(weights: &Square<[f32; 3]>) -> f64 {
    let mean = |c: usize| weights.values.iter().map(|w| f64::from(w[c])).sum::<f64>();
    let largest = (0..3).map(mean).fold(0.0, f64::max);
    largest / weights.values.len().max(1) as f64
}

/// Weights in their colours, and the weight that is white.
pub fn weight(weights: &Square<[f32; 3]>) -> (Tile, f64) {
    let white = mean_weight(weights) / MEAN_WEIGHT;
    let channels = [0, 1, 2].map(|c| spread(weights, |w| f64::from(w[c])));
    let code = |v: f64| srgb_code((v / white.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0) as f32);
    let tile = (0..TILE * TILE)
        .map(|k| [0, 1, 2].map(|c| code(channels[c][k])))
        .collect();
    (tile, white)
}

/// A tile over [−1, 1]² with the rim of the disk drawn into it.
pub fn with_rim(mut tile: Tile) -> Tile {
    let half = TILE as f32 / 2.0;
    for (k, pixel) in tile.iter_mut().enumerate() {
        let [x, y] = [k % TILE, k / TILE].map(|i| i as f32 + 0.5 - half);
        let distance = (half - RIM.1 - x.hypot(y)).abs();
        *pixel = mixed(*pixel, RIM.0, RIM.1 + 0.5 - distance);
    }
    tile
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square<T>(values: Vec<T>) -> Square<T> {
        Square {
            side: values.len().isqrt(),
            values,
        }
    }

    /// Rounding of weights, which are f32.
    const SINGLE: f64 = 1e-7;

    /// The four corners of a tile: top left, top right, bottom left, bottom right.
    fn corners(tile: &Tile) -> [[u8; 3]; 4] {
        [0, TILE - 1, TILE * (TILE - 1), TILE * TILE - 1].map(|k| tile[k])
    }

    #[test]
    fn maps_show_x_red_and_y_green_upwards() {
        let tile = map(&square(vec![[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]));
        assert_eq!(corners(&tile), [[0, 255, 0], [255, 255, 0], [0; 3], [255, 0, 0]]);
        assert_eq!(map(&square(vec![[f32::NAN, 0.0]]))[0], [0, 128, 0]);
    }

    #[test]
    fn masses_share_one_exposure_whatever_their_cells() {
        let coarse = square(vec![0.1, 0.2, 0.3, 0.4]);
        // Each cell in four of a quarter.
        let fine: Vec<f64> = (0..16)
            .map(|k| coarse.values[k % 4 / 2 + k / 8 * 2] / 4.0)
            .collect();
        let exposed = exposure(&coarse);
        assert_eq!(mass(&coarse, exposed), mass(&square(fine), exposed));
        // 0.6 of the mass is at or below 0.3, all of it at or below 0.4.
        assert_eq!(exposed, 1.6);
        assert_eq!(corners(&mass(&coarse, exposed))[1], [srgb_code(SHOULDER); 3]);
        let nothing = square(vec![0.0; 4]);
        assert_eq!(mass(&nothing, exposure(&nothing))[0], [0; 3]);
    }

    #[test]
    fn differences_are_blue_below_and_red_above() {
        let differences = square(vec![-2.0, 0.0, 1.0, 2.0]);
        let span = span(differences.values.iter().copied());
        assert_eq!(span, 2.0);
        assert_eq!(
            corners(&difference(&differences, span)),
            [diverging(0.5), MORE, LESS, PAPER]
        );
        let none = square(vec![0.0; 4]);
        assert_eq!(
            difference(&none, super::span(none.values.iter().copied()))[0],
            PAPER
        );
    }

    #[test]
    fn the_mean_weight_is_half_of_white() {
        let (tile, white) = weight(&square(vec![[0.4, 0.2, 0.0], [0.4; 3], [0.0; 3], [0.8; 3]]));
        // The mean of red is 0.4.
        assert!((white - 0.8).abs() < SINGLE, "{white}");
        assert_eq!(corners(&tile)[1], [255; 3]);
        assert_eq!(corners(&tile)[2], [srgb_code(0.5), srgb_code(0.25), 0]);
        assert_eq!(weight(&square(vec![[0.0; 3]])).0[0], [0; 3]);
    }

    #[test]
    fn the_rim_touches_the_edges() {
        let tile = with_rim(vec![[0; 3]; TILE * TILE]);
        assert_eq!(corners(&tile), [[0; 3]; 4]);
        assert_ne!(tile[TILE / 2], [0; 3]);
        assert_ne!(tile[TILE * (TILE / 2)], [0; 3]);
        assert_eq!(tile[TILE * (TILE / 2) + TILE / 2], [0; 3]);
    }
}
