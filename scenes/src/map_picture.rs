//! Importance maps of several solvers side by side, as Bai et al. show them in their Figs. 6 and 9.
//!
//! A column per solver: the map, the histogram of what it draws, how far that is from the truth, and numbers. On the
//! left is what they should draw.

use crate::error::{Error, Result};
use crate::label;
use crate::map_tile::{self, TILE, Tile};
use crate::sheet::{FAINT, INK, LEADING, MARGIN, PAPER, Sheet};
use std::path::Path;

/// Height of the bar that explains the colours of differences, pixels.
const BAR: usize = 16;

/// Values in the cells of a square.
#[derive(Clone, Debug, PartialEq)]
pub struct Square<T> {
    /// Cells per side, ≥ 1.
    pub side: usize,
    /// `side`² values, x (or u₀) fastest, y (or u₁) upwards.
    pub values: Vec<T>,
}

/// What one solver made.
#[derive(Clone, Debug, PartialEq)]
pub struct MapPanel {
    /// The solver.
    pub title: String,
    /// A few numbers as text; long lines are broken.
    pub lines: Vec<String>,
    /// Positions on [−1, 1]² of the cell centres of the unit square of u.
    pub map: Square<[f32; 2]>,
    /// Mass that was drawn in every bin of [−1, 1]²; the sum is 1, or less when some fell outside.
    pub bins: Square<f64>,
    /// Mass that should have been, in the same bins; the sum is 1.
    pub reference: Square<f64>,
}

/// Several solvers on one target.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The heading.
    pub title: String,
    /// What describes the target; long lines are broken.
    pub lines: Vec<String>,
    /// The target on [−1, 1]², ≥ 0, in any unit.
    pub target: Square<f64>,
    /// Whether [−1, 1]² holds the disk of directions, whose rim is drawn then.
    pub disk: bool,
    /// The solvers. The first one's reference stands under the target.
    pub panels: Vec<MapPanel>,
}

impl<T> Square<T> {
    /// Refuses a square that does not hold `side`² values, as a mistake in the picture at `path`.
    pub(crate) fn check(&self, path: &Path, what: &str) -> Result<()> {
        let (side, found) = (self.side, self.values.len());
        match side > 0 && found == side * side {
            true => Ok(()),
            false => {
                let reason = format!("{what} has {found} values for {side} × {side} cells");
                Err(Error::image_file(path, reason))
            }
        }
    }
}

impl MapPanel {
    pub(crate) fn check(&self, path: &Path) -> Result<()> {
        let title = &self.title;
        self.map.check(path, &format!("the map of `{title}`"))?;
        self.bins.check(path, &format!("the histogram of `{title}`"))?;
        self.reference
            .check(path, &format!("the reference of `{title}`"))?;
        let (first, second) = (self.bins.side, self.reference.side);
        match first == second {
            true => Ok(()),
            false => Err(Error::ImageSize {
                first: [first; 2],
                second: [second; 2],
            }),
        }
    }

    /// Drawn less true mass.
    pub(crate) fn difference(&self) -> Square<f64> {
        let pairs = self.bins.values.iter().zip(&self.reference.values);
        Square {
            side: self.bins.side,
            values: pairs.map(|(drawn, truth)| drawn - truth).collect(),
        }
    }
}

/// The common span of the differences of `panels`.
fn common_span(panels: &[MapPanel]) -> f64 {
    map_tile::span(panels.iter().flat_map(|panel| panel.difference().values))
}

/// Writes `comparisons`, one below the other, as PNG.
///
/// Target and histograms of a comparison share one exposure, bent in the brightest fifth of the target's mass; its
/// differences share one scale, which is printed. Maps show the code 0 for −1 and 255 for 1, x red and y green.
///
/// # Errors
/// [`Error::ImageFile`] when there is none, or when a square does not hold `side`² values; [`Error::ImageSize`] when
/// a panel's bins differ in number; see also [`crate::picture::write_codes`].
pub fn write_sheet(path: &Path, comparisons: &[Comparison]) -> Result<()> {
    for comparison in comparisons {
        comparison.target.check(path, "the target")?;
        comparison.panels.iter().try_for_each(|panel| panel.check(path))?;
    }
    let Some(panels) = comparisons.iter().map(|c| c.panels.len()).max() else {
        return Err(Error::image_file(path, "there is no comparison to show"));
    };
    let mut sheet = Sheet::new(width(panels + 1) + 2 * MARGIN, 0);
    let mut top = MARGIN;
    for comparison in comparisons {
        top = draw(&mut sheet, top, comparison) + MARGIN;
        sheet.extend(top);
        top += MARGIN;
    }
    sheet.write(path)
}

/// Draws a comparison below `top`; gives the row below it.
fn draw(sheet: &mut Sheet, top: usize, comparison: &Comparison) -> usize {
    let panels = &comparison.panels;
    let target = scaled_to_mass(&comparison.target);
    let exposed = map_tile::exposure(&target);
    let span = common_span(panels);
    let place = |tile: Tile| match comparison.disk {
        true => map_tile::with_rim(tile),
        false => tile,
    };
    let mass = |mass: &Square<f64>| place(map_tile::mass(mass, exposed));

    let mut maps = vec![("target".to_string(), mass(&target))];
    let mut drawn = Vec::new();
    if let Some(MapPanel { reference, .. }) = panels.first() {
        drawn.push((
            format!("target in {0} × {0} bins", reference.side),
            mass(reference),
        ));
    }
    let mut differences = vec![("drawn less target".to_string(), bar())];
    for panel in panels {
        maps.push((panel.title.clone(), map_tile::map(&panel.map)));
        drawn.push(("drawn".to_string(), mass(&panel.bins)));
        let difference = map_tile::difference(&panel.difference(), span);
        differences.push(("drawn less target".to_string(), place(difference)));
    }

    let top = sheet.paragraph(
        [MARGIN, top],
        width(panels.len() + 1),
        label::HEADING,
        INK,
        &comparison.title,
    );
    let top = tiles(sheet, top + MARGIN, INK, &maps);
    let top = tiles(sheet, top, FAINT, &drawn);
    let top = tiles(sheet, top, FAINT, &differences);
    let below_bar = top - MARGIN - TILE + BAR + LEADING;
    for (text, share) in [
        (format!("−{span:.1e}"), 0.0),
        ("0".into(), 0.5),
        (format!("+{span:.1e}"), 1.0),
    ] {
        let room = TILE - label::width(&text, label::HEIGHT);
        let left = MARGIN + (room as f64 * share) as usize;
        sheet.text([left, below_bar], label::HEIGHT, FAINT, &text);
    }
    let unit = below_bar + label::HEIGHT + LEADING;
    sheet.text([MARGIN, unit], label::HEIGHT, FAINT, "of the whole mass, per bin");

    let columns = panels.iter().map(|panel| &panel.lines[..]);
    texts(
        sheet,
        top,
        INK,
        std::iter::once(&comparison.lines[..]).chain(columns),
    )
}

/// `values` ≥ 0 divided by their sum.
fn scaled_to_mass(values: &Square<f64>) -> Square<f64> {
    let total = values.values.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    Square {
        side: values.side,
        values: values.values.iter().map(|v| v / total).collect(),
    }
}

/// The bar that explains the colours of differences, on paper.
fn bar() -> Tile {
    let code = |k: usize| match k / TILE < BAR {
        true => map_tile::diverging((2 * (k % TILE) + 1) as f64 / TILE as f64 - 1.0),
        false => PAPER,
    };
    (0..TILE * TILE).map(code).collect()
}

/// Left edge of a column of tiles.
fn left(column: usize) -> usize {
    MARGIN + column * (TILE + MARGIN)
}

/// Width of `columns` of tiles with what is between them.
pub(crate) fn width(columns: usize) -> usize {
    (columns * (TILE + MARGIN)).saturating_sub(MARGIN)
}

/// Lays down a row of tiles under their captions, which start at `top`; gives the row below their margin.
pub(crate) fn tiles(sheet: &mut Sheet, top: usize, ink: [u8; 3], row: &[(String, Tile)]) -> usize {
    let captions = row.iter().map(|(caption, _)| std::slice::from_ref(caption));
    let top = texts(sheet, top, ink, captions);
    sheet.extend(top + TILE + MARGIN);
    for (i, (_, tile)) in row.iter().enumerate() {
        sheet.tile([left(i), top], TILE, tile);
    }
    top + TILE + MARGIN
}

/// Writes paragraphs of text in the columns of tiles, from `top` on; gives the row below the longest column.
pub(crate) fn texts<'a>(
    sheet: &mut Sheet,
    top: usize,
    ink: [u8; 3],
    columns: impl Iterator<Item = &'a [String]>,
) -> usize {
    let mut bottom = top;
    for (i, lines) in columns.enumerate() {
        let mut end = top;
        for line in lines {
            end = sheet.paragraph([left(i), end], TILE, label::HEIGHT, ink, line);
        }
        bottom = bottom.max(end);
    }
    bottom
}
