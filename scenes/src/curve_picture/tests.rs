//! Pictures of curves: whose colours are where, and what becomes of values that cannot be drawn.

use super::*;

/// Width, height and codes of the picture of `panels`.
fn picture(panels: &[CurvePanel]) -> ([usize; 2], Vec<[u8; 3]>) {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let path = folder.path().join("curves.png");
    write_curves(&path, panels).expect("the folder is writable");
    let file = std::fs::File::open(&path).expect("just written");
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .expect("it is PNG");
    let mut bytes = vec![0; reader.output_buffer_size().expect("it is small")];
    reader.next_frame(&mut bytes).expect("it is whole");
    let size = [reader.info().width, reader.info().height].map(|v| v as usize);
    (size, bytes.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect())
}

/// Number of pixels of the colour of series `i` in the frame of panel `column`, of [`COLUMNS`] at most, and their
/// mean row.
fn found(([width, _], codes): &([usize; 2], Vec<[u8; 3]>), column: usize, i: usize) -> (usize, f64) {
    let RGBColor(r, g, b) = COLOURS[i];
    let [left, top, right, bottom] = BORDER.map(|border| border as usize);
    let rows = (top..PANEL[1] - bottom).flat_map(|y| {
        let columns = column * PANEL[0] + left..(column + 1) * PANEL[0] - right;
        columns
            .filter(move |x| codes[y * width + x] == [r, g, b])
            .map(move |_| y)
    });
    let (count, sum) = rows.fold((0, 0), |(count, sum), y| (count + 1, sum + y));
    (count, sum as f64 / count as f64)
}

fn series(name: &str, values: &[f64]) -> Series {
    let points = values.iter().enumerate();
    Series {
        name: name.into(),
        points: points.map(|(i, v)| [100.0 * i as f64, *v]).collect(),
    }
}

fn panel(series: Vec<Series>) -> CurvePanel {
    CurvePanel {
        title: "network".into(),
        clock: vec![[100.0, 10.0], [500.0, 90.0]],
        series,
        mark: None,
        axes: None,
    }
}

#[test]
fn every_series_is_drawn_in_its_panel() {
    let both = [series("loss", &[0.2; 6]), series("error", &[0.1; 6])];
    let drawn = picture(&[panel(both.to_vec()), panel(vec![both[1].clone()])]);
    assert_eq!(drawn.0, [2 * PANEL[0], PANEL[1]]);
    let [(high, high_row), (low, low_row)] = [0, 1].map(|i| found(&drawn, 0, i));
    let plot_width = PANEL[0] - (BORDER[0] + BORDER[2]) as usize;
    assert!(high > plot_width / 2 && low > plot_width / 2, "{high}, {low}");
    assert!(high_row < low_row, "{high_row}, {low_row}");
    assert!(found(&drawn, 1, 0).0 > plot_width / 2);
    assert_eq!(found(&drawn, 1, 1).0, 0);
    assert_eq!(drawn.1[0], [u8::MAX; 3]);
}

#[test]
fn panels_stand_in_a_row_or_in_pairs() {
    let one = panel(vec![series("loss", &[1.0, 0.5])]);
    assert_eq!(picture(&vec![one.clone(); 3]).0, [3 * PANEL[0], PANEL[1]]);
    assert_eq!(picture(&vec![one; 4]).0, [2 * PANEL[0], 2 * PANEL[1]]);
    let error = write_curves(Path::new("curves.png"), &[]).expect_err("nothing to draw");
    assert!(error.to_string().contains("there is no curve"), "{error}");
}

#[test]
fn what_cannot_be_drawn_leaves_a_gap() {
    let whole = [1.0, 0.5, 0.4, 0.3, 0.2, 0.2];
    let mut broken = whole;
    (broken[2], broken[3]) = (f64::NAN, f64::INFINITY);
    let mut zero = whole;
    zero[3] = 0.0;
    let three = [whole, broken, zero].map(|values| panel(vec![series("loss", &values)]));
    let drawn = picture(&three);
    let [whole, broken, zero] = [0, 1, 2].map(|column| found(&drawn, column, 0).0);
    assert!(
        0 < broken && broken < whole && zero > 0,
        "{broken}, {whole}, {zero}"
    );
    let none = series("loss", &[f64::NAN; 3]);
    let single = series("loss", &[-1.0]);
    let marked = CurvePanel {
        mark: Some((f64::from(f32::MAX), "far".into())),
        ..panel(vec![series("loss", &whole_range())])
    };
    let drawn = picture(&[panel(vec![none]), panel(vec![single]), marked]);
    let counts = [0, 1, 2].map(|column| found(&drawn, column, 0).0);
    assert!(counts[0] == 0 && counts[1] > 0, "{counts:?}");
    assert_eq!(picture(&[CurvePanel::default()]).0, PANEL);
}

/// The largest and smallest values that are drawn.
fn whole_range() -> [f64; 3] {
    [f64::from(f32::MIN), 0.0, f64::from(f32::MAX)]
}

#[test]
fn the_axis_of_time_follows_the_clock() {
    // The first half of the steps takes a quarter of the time.
    let (unit, ticks) = times(&[[500.0, 25.0], [1000.0, 100.0]], 1000.0);
    assert_eq!(unit, "seconds");
    assert_eq!(ticks[..3], [[0.0, 0.0], [400.0, 20.0], [600.0, 40.0]]);
    assert_eq!(ticks.last(), Some(&[1000.0, 100.0]));
    assert_eq!(times(&[[10.0, 600.0]], 10.0).0, "minutes");
    assert_eq!(times(&[[10.0, 9000.0]], 10.0).0, "hours");
    assert_eq!(times(&[], 10.0), ("seconds", Vec::new()));
}
