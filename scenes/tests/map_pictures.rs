//! Pictures of importance maps: their layout, known pixels, and squares that are not squares.

use bake_runtime::conductor::Conductor;
use bake_scenes::Error;
use bake_scenes::entry_picture::{ChartView, Entry, SLICE_SIDE, write_entry};
use bake_scenes::map_picture::{Comparison, MapPanel, Square, write_sheet};
use bake_scenes::slice_picture::DiskSlice;
use std::fs::File;
use std::io::BufReader;
use std::ops::ControlFlow;
use std::path::Path;

/// Side of a tile, distance of tiles, and margin of the sheet, pixels.
const TILE: usize = 256;
const STEP: usize = 268;
const MARGIN: usize = 12;

/// Top of the first row of tiles: below margin, heading of one line, margin and caption.
const FIRST_ROW: usize = 12 + 26 + 12 + 20;

/// From the top of one row of tiles to that of the next: tile, margin and caption.
const ROW: usize = 256 + 12 + 20;

/// Cells per side of all squares; a cell is four pixels of a tile.
const SIDE: usize = 64;

/// Codes of the corners of the identity: the cell centres −63/64 and 63/64.
const LOW: u8 = 2;
const HIGH: u8 = 253;

struct Picture {
    width: usize,
    height: usize,
    codes: Vec<u8>,
}

impl Picture {
    fn read(path: &Path) -> Picture {
        let decoder = png::Decoder::new(BufReader::new(File::open(path).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut codes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut codes).unwrap();
        Picture {
            width: info.width as usize,
            height: info.height as usize,
            codes,
        }
    }

    /// Code of a pixel of a tile, from its top left, as the tile of `column` in the row that starts at `top`.
    fn at(&self, column: usize, top: usize, x: usize, y: usize) -> [u8; 3] {
        let first = 3 * ((top + y) * self.width + MARGIN + column * STEP + x);
        [0, 1, 2].map(|c| self.codes[first + c])
    }
}

fn square<T>(value: impl Fn([f64; 2]) -> T) -> Square<T> {
    let at = |i: usize| (2 * i + 1) as f64 / SIDE as f64 - 1.0;
    Square {
        side: SIDE,
        values: (0..SIDE * SIDE)
            .map(|k| value([at(k % SIDE), at(k / SIDE)]))
            .collect(),
    }
}

/// The identity on the even density, but for one bin on the top left that is drawn twice as often, and one on the
/// bottom right that is never drawn.
fn panel() -> MapPanel {
    let reference = square(|_| 1.0 / (SIDE * SIDE) as f64);
    let mut bins = reference.clone();
    bins.values[SIDE * (SIDE - 1)] *= 2.0;
    bins.values[SIDE - 1] = 0.0;
    MapPanel {
        title: "identity".into(),
        lines: vec!["binning L1  0.0005".into()],
        map: square(|p| p.map(|v| v as f32)),
        bins,
        reference,
    }
}

fn comparison(panels: usize) -> Comparison {
    Comparison {
        title: "even density".into(),
        lines: vec!["a square".into()],
        target: square(|_| 7.0),
        disk: false,
        panels: vec![panel(); panels],
    }
}

fn entry(charts: usize) -> Entry {
    let conductor = Conductor::new([0.3, 0.3], [1.0; 3]).unwrap();
    let go_on = |_, _| ControlFlow::Continue(());
    let chart = ChartView {
        panel: panel(),
        disk: false,
        weight: square(|[x, _]| [0.5 + 0.5 * x as f32, 0.0, 0.0]),
    };
    Entry {
        title: "entry 1".into(),
        lines: vec!["α 0.3".into()],
        slice: DiskSlice::draw(&conductor, [45.0, 0.0], SLICE_SIDE, 16, 1, &go_on).unwrap(),
        charts: vec![chart; charts],
    }
}

/// Checks the tiles that comparisons and entries share, `column` of each and the row it starts in.
fn assert_tiles(picture: &Picture, map: [usize; 2], drawn: [usize; 2], truth: [usize; 2]) {
    let last = TILE - 1;
    let corners = [[0, 0], [last, 0], [0, last], [last, last]];
    let expected = [[LOW, HIGH, 0], [HIGH, HIGH, 0], [LOW, LOW, 0], [HIGH, LOW, 0]];
    assert_eq!(corners.map(|[x, y]| picture.at(map[0], map[1], x, y)), expected);
    let [first, middle, end] = [0, TILE / 2, last].map(|i| picture.at(drawn[0], drawn[1], i, i)[0]);
    assert!(
        first > middle && middle > end && end == 0,
        "{first}, {middle}, {end}"
    );
    assert_eq!(picture.at(truth[0], truth[1], 0, 0), [middle; 3], "one exposure");
}

fn assert_difference(picture: &Picture, column: usize, top: usize) {
    let [more, none, less] = [0, TILE / 2, TILE - 1].map(|i| picture.at(column, top, i, i));
    assert!(
        more[0] > none[0] && none[2] < less[2],
        "{more:?}, {none:?}, {less:?}"
    );
    assert!(more[0] > more[2] && less[2] > less[0], "{more:?}, {less:?}");
}

#[test]
fn sheets_hold_a_column_per_solver_and_stack() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.png");
    let heights = [1, 2].map(|count| {
        write_sheet(&path, &vec![comparison(2); count]).unwrap();
        let picture = Picture::read(&path);
        assert_eq!(picture.width, MARGIN + 3 * STEP);
        for column in [1, 2] {
            let [map, drawn, difference] = [0, 1, 2].map(|row| FIRST_ROW + row * ROW);
            assert_tiles(&picture, [column, map], [column, drawn], [0, drawn]);
            assert_eq!(picture.at(0, map, 0, 0), picture.at(0, drawn, 0, 0), "target");
            assert_difference(&picture, column, difference);
        }
        picture.height
    });
    assert_eq!(heights[1], 2 * heights[0]);
    // The rim of the disk touches the middle of the target's edge, and long text makes the sheet higher.
    let mut changed = comparison(1);
    changed.disk = true;
    changed.panels[0].lines = vec!["a line that takes more than the width of a tile".into()];
    write_sheet(&path, &[changed]).unwrap();
    let picture = Picture::read(&path);
    assert_ne!(
        picture.at(0, FIRST_ROW, TILE / 2, 0),
        picture.at(0, FIRST_ROW, 0, 0)
    );
    assert!(picture.height > heights[0]);
}

#[test]
fn entries_hold_a_row_per_chart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("entry.png");
    let heights = [1, 2].map(|count| {
        write_entry(&path, &entry(count)).unwrap();
        let picture = Picture::read(&path);
        assert_eq!(picture.width, MARGIN + 5 * STEP);
        // Below the slice: margin, the chart's heading and its caption.
        let top = FIRST_ROW + TILE + 2 * MARGIN + 26 + 20;
        assert_tiles(&picture, [0, top], [1, top], [2, top]);
        assert_difference(&picture, 3, top);
        // Weights rise from 0 to twice the mean, which is white, in red alone.
        let [dark, bright] = [0, TILE - 1].map(|x| picture.at(4, top, x, 0));
        assert!(
            dark[0] < 30 && bright[0] > 250 && bright[1] == 0,
            "{dark:?}, {bright:?}"
        );
        picture.height
    });
    assert!(heights[1] > heights[0] + TILE, "{heights:?}");
}

#[test]
fn squares_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.png");
    let refused = |comparison: Comparison, part: &str| {
        let text = write_sheet(&path, &[comparison]).unwrap_err().to_string();
        assert!(text.contains(part), "{text}");
    };
    let mut short = comparison(1);
    short.target.values.pop();
    refused(short, "the target has 4095 values for 64 × 64 cells");
    let mut empty = comparison(1);
    empty.panels[0].map = Square {
        side: 0,
        values: Vec::new(),
    };
    refused(empty, "the map of `identity` has 0 values");
    let mut coarse = comparison(1);
    coarse.panels[0].reference = Square {
        side: 1,
        values: vec![1.0],
    };
    refused(coarse, "64×64 and 1×1");
    assert!(matches!(write_sheet(&path, &[]), Err(Error::ImageFile { .. })));
    let mut weightless = entry(1);
    weightless.charts[0].weight.values.clear();
    assert!(matches!(
        write_entry(&path, &weightless),
        Err(Error::ImageFile { .. })
    ));
    let mut small = entry(1);
    small.slice.size = 1;
    assert!(matches!(write_entry(&path, &small), Err(Error::ImageSize { .. })));
    assert!(!path.exists());
}

#[test]
fn values_that_are_none_leave_the_rest_in_sight() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sheet.png");
    let mut broken = comparison(1);
    broken.target.values.fill(0.0);
    broken.panels[0].bins.values[0] = f64::NAN;
    broken.panels[0].map.values[0] = [f32::NAN; 2];
    write_sheet(&path, &[broken]).unwrap();
    let picture = Picture::read(&path);
    let corner = TILE - 1;
    assert_eq!(picture.at(1, FIRST_ROW, corner, 0), [HIGH, HIGH, 0]);
}
