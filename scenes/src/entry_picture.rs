//! One entry of a database of importance maps: the slice, and for each of its charts the map, what it draws and its
//! weights, as Bai et al. show them in their Figs. 7 and 9.

use crate::error::{Error, Result};
use crate::label;
use crate::map_picture::{MapPanel, Square, tiles, width};
use crate::map_tile::{self, TILE};
use crate::sheet::{FAINT, INK, MARGIN, Sheet};
use crate::slice_picture::{DiskSlice, linear, logarithmic};
use std::path::Path;

/// Tiles in the row of a chart.
const COLUMNS: usize = 5;

/// Tiles in the row of the slice, before its text.
const SLICE_COLUMNS: usize = 2;

/// An entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The heading.
    pub title: String,
    /// What describes the entry; long lines are broken.
    pub lines: Vec<String>,
    /// f_cos over the disk, [`SLICE_SIDE`] pixels wide.
    pub slice: DiskSlice,
    /// Its charts, one or more.
    pub charts: Vec<ChartView>,
}

/// Width of the slice of an [`Entry`], pixels.
pub const SLICE_SIDE: usize = TILE;

/// One chart of an entry.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartView {
    /// The map with its histogram and truth; numbers stand below.
    pub panel: MapPanel,
    /// Whether the histogram's square holds the disk of directions, whose rim is drawn then.
    pub disk: bool,
    /// f_cos/pdf over the unit square of u, RGB, without unit.
    pub weight: Square<[f32; 3]>,
}

/// Writes the picture of an entry as PNG.
///
/// Above, the slice, linear and logarithmic, with a ring at `wo`. Below, a row per chart: the map (x red, y green, code
/// 0 for −1 and 255 for 1), drawn and true mass with one exposure, their difference, and the weight. White is twice the
/// mean weight, of the channel where the mean is largest, and is printed.
///
/// # Errors
/// [`Error::ImageSize`] when the slice is not [`SLICE_SIDE`] wide or a chart's bins differ in number;
/// [`Error::ImageFile`] when a square does not hold `side`² values; see also [`crate::picture::write_codes`].
pub fn write_entry(path: &Path, entry: &Entry) -> Result<()> {
    if entry.slice.size != SLICE_SIDE {
        return Err(Error::ImageSize {
            first: [entry.slice.size; 2],
            second: [SLICE_SIDE; 2],
        });
    }
    for chart in &entry.charts {
        chart.panel.check(path)?;
        chart
            .weight
            .check(path, &format!("the weight of `{}`", chart.panel.title))?;
    }
    let mut sheet = Sheet::new(width(COLUMNS) + 2 * MARGIN, 0);
    let top = sheet.paragraph([MARGIN; 2], width(COLUMNS), label::HEADING, INK, &entry.title);
    let mut top = draw_slice(&mut sheet, top + MARGIN, entry);
    for chart in &entry.charts {
        top = draw_chart(&mut sheet, top + MARGIN, chart) + MARGIN;
    }
    sheet.extend(top);
    sheet.write(path)
}

/// Draws the slice and the lines of the entry below `top`; gives the row below them.
fn draw_slice(sheet: &mut Sheet, top: usize, entry: &Entry) -> usize {
    let scale = entry.slice.scale();
    let captions = [
        format!("linear, bent above {:.1e} sr⁻¹", scale.exposed),
        format!("log, {} decades below {:.1e} sr⁻¹", scale.decades, scale.peak),
    ];
    let blank = captions.map(|caption| (caption, Vec::new()));
    let bottom = tiles(sheet, top, FAINT, &blank);
    let corner = bottom - MARGIN - TILE;
    sheet.disk([MARGIN, corner], &entry.slice, |rgb| linear(rgb, scale));
    sheet.disk([2 * MARGIN + TILE, corner], &entry.slice, |rgb| {
        logarithmic(rgb, scale)
    });
    let left = 2 * MARGIN + width(SLICE_COLUMNS);
    let room = width(COLUMNS - SLICE_COLUMNS);
    let mut end = corner;
    for line in &entry.lines {
        end = sheet.paragraph([left, end], room, label::HEIGHT, INK, line);
    }
    bottom.max(end)
}

/// Draws a chart below `top`; gives the row below it.
fn draw_chart(sheet: &mut Sheet, top: usize, chart: &ChartView) -> usize {
    let panel = &chart.panel;
    let exposed = map_tile::exposure(&panel.reference);
    let difference = panel.difference();
    let span = map_tile::span(difference.values.iter().copied());
    let (weight, white) = map_tile::weight(&chart.weight);
    let place = |tile| match chart.disk {
        true => map_tile::with_rim(tile),
        false => tile,
    };
    let row = [
        ("map".into(), map_tile::map(&panel.map)),
        ("drawn".into(), place(map_tile::mass(&panel.bins, exposed))),
        (
            format!("target in {0} × {0} bins", panel.reference.side),
            place(map_tile::mass(&panel.reference, exposed)),
        ),
        (
            format!("drawn less target, ±{span:.1e}"),
            place(map_tile::difference(&difference, span)),
        ),
        (format!("weight, white is {white:.3}"), weight),
    ];
    let top = sheet.paragraph([MARGIN, top], width(COLUMNS), label::HEADING, INK, &panel.title);
    let mut top = tiles(sheet, top, FAINT, &row);
    for line in &panel.lines {
        top = sheet.paragraph([MARGIN, top], width(COLUMNS), label::HEIGHT, INK, line);
    }
    top
}
