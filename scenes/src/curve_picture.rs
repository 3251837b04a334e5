//! Learning curves to look at: a panel per network, values over steps, on white paper.

use crate::curve_axis::{Axis, even_ticks, number};
use crate::curve_paper::{FINE, Paper};
use crate::error::{Error, Result};
use crate::label;
use plotters::chart::{ChartContext, DualCoordChartContext};
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;
use std::path::Path;

#[cfg(test)]
mod tests;

/// Width and height of a panel, pixels.
pub const PANEL: [usize; 2] = [680, 420];
/// Panels in a row, as far as there are as many; four or more stand in pairs.
const COLUMNS: usize = 3;

/// Pixels from the edges of a panel to the frame of its plot: left, top, right, bottom. The numbers of the axes stand
/// there, and their names [`EDGE`] from the edge.
const BORDER: [f64; 4] = [96.0, 94.0, 30.0, 60.0];
/// Pixels of the border that stay blank.
const EDGE: f64 = 14.0;
/// Pixels between the heading and the name of the axis of time.
const HEADING_GAP: f64 = 10.0;
/// Length of ticks, pixels; plotters writes numbers as far again from the axis.
const TICK: f64 = 4.0;
/// Pixels from a frame or a line to the text at it.
const TEXT_GAP: f64 = 8.0;
/// Length of the piece of line in the legend, and height of its rows, pixels.
const LEGEND: [f64; 2] = [22.0, 20.0];
/// Share of what lies below the legend that it covers.
const LEGEND_COVER: f64 = 0.85;
/// Widths of curves and of thin lines, and radius of dots, pixels.
const CURVE: f64 = 2.0;
const HAIR: f64 = 1.0;
const DOT: f64 = 3.5;

/// Codes of text, of axes, and of the lines between ticks, strong and light.
const INK: RGBColor = RGBColor(38, 40, 44);
const FRAME: RGBColor = RGBColor(110, 114, 120);
const MESH: RGBColor = RGBColor(216, 219, 223);
const LIGHT_MESH: RGBColor = RGBColor(238, 239, 241);
/// Colours of the series, in order: those of Okabe and Ito 2008, which colour-blind people can tell apart.
const COLOURS: [RGBColor; 6] = [
    RGBColor(86, 180, 233),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(0, 114, 178),
    RGBColor(230, 159, 0),
];

/// The curves of one network.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CurvePanel {
    /// The heading.
    pub title: String,
    /// What is drawn: the first as a line, the others with a dot at every point.
    pub series: Vec<Series>,
    /// Step and seconds since the start, both rising: what the axis of time follows; without it that has no numbers.
    pub clock: Vec<[f64; 2]>,
    /// The last step before values mean something else, and what they mean then.
    pub mark: Option<(f64, String)>,
    /// Names of other axes than those of learning: both are logarithmic where all values are positive, and every point has
    /// a dot.
    pub axes: Option<Axes>,
}

/// What is drawn over what.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Name of the axis across.
    pub across: String,
    /// Name of the axis up.
    pub up: String,
}

/// Values over steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    /// What the values are.
    pub name: String,
    /// Step and value, by step. A value that is not finite or beyond f32 is left out, and the line has a gap there.
    pub points: Vec<[f64; 2]>,
}

/// Writes the picture of `panels` as PNG, whole or not at all.
///
/// Values stand on a logarithmic axis where all of a panel are positive. Below are the steps, above the time.
///
/// # Errors
/// [`Error::ImageFile`] when there is no panel; see also [`crate::picture::write_codes`].
pub fn write_curves(path: &Path, panels: &[CurvePanel]) -> Result<()> {
    if panels.is_empty() {
        return Err(Error::image_file(path, "there is no curve to draw"));
    }
    let columns = if panels.len() <= COLUMNS { panels.len() } else { 2 };
    let rows = panels.len().div_ceil(columns);
    let mut paper = Paper::new([columns * PANEL[0], rows * PANEL[1]]);
    let areas = paper.into_drawing_area().split_evenly((rows, columns));
    for (area, panel) in areas.iter().zip(panels) {
        draw(area, panel).map_err(|e| Error::image_file(path, e.to_string()))?;
    }
    drop(areas);
    paper.write(path)
}

type Area<'a> = DrawingArea<&'a mut Paper, Shift>;
type Plot<'c, 'a> = ChartContext<'c, &'a mut Paper, Cartesian2d<Axis, Axis>>;
type TimedPlot<'c, 'a> =
    DualCoordChartContext<'c, &'a mut Paper, Cartesian2d<Axis, Axis>, Cartesian2d<Axis, Axis>>;
type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;

/// `pixels` in fine ones.
fn fine(pixels: f64) -> i32 {
    (FINE as f64 * pixels).round() as i32
}

/// Text of a `height` in pixels.
fn text(height: usize, ink: RGBColor) -> TextStyle<'static> {
    // The paper has one font, whatever it is called.
    ("", fine(height as f64)).into_font().color(&ink)
}

/// A line `width` pixels wide.
fn stroke(colour: RGBColor, width: f64) -> ShapeStyle {
    colour.stroke_width(fine(width) as u32)
}

/// Whether a point can be drawn.
fn is_drawable(point: &[f64; 2]) -> bool {
    point.iter().all(|v| v.abs() <= f64::from(f32::MAX))
}

fn draw(area: &Area, panel: &CurvePanel) -> Drawn {
    let points = panel.series.iter().flat_map(|s| &s.points);
    let points = points.filter(|p| is_drawable(p));
    let marked = panel.mark.iter().map(|(step, _)| *step);
    let last = points.clone().map(|p| p[0]).chain(marked).fold(1.0, f64::max);
    let values = Axis::around(points.clone().map(|p| p[1]));
    let across = match &panel.axes {
        None => Axis::even(last, even_ticks([0.0, last])),
        Some(_) => Axis::around(points.map(|p| p[0])),
    };
    let (unit, times) = times(&panel.clock, last);

    let [left, top, right, bottom] = BORDER.map(|border| border - EDGE);
    let time_height = top - label::HEADING as f64 - HEADING_GAP;
    let mut chart = ChartBuilder::on(area)
        .margin(fine(EDGE))
        .margin_top(fine(EDGE + top - time_height))
        .margin_right(fine(EDGE + right))
        .y_label_area_size(fine(left))
        .top_x_label_area_size(fine(time_height))
        .x_label_area_size(fine(bottom))
        .build_cartesian_2d(across, values.clone())?
        .set_secondary_coord(Axis::even(last, times.iter().map(|t| t[0]).collect()), values);
    let [x_name, y_name] = match (&panel.axes, &panel.series[..]) {
        (Some(axes), _) => [&axes.across[..], &axes.up],
        (None, [only]) => ["steps", &only.name],
        (None, _) => ["steps", "loss and errors"],
    };
    chart
        .configure_mesh()
        .axis_style(stroke(FRAME, HAIR))
        .bold_line_style(stroke(MESH, HAIR))
        .light_line_style(stroke(LIGHT_MESH, HAIR))
        .set_all_tick_mark_size(fine(TICK))
        .label_style(text(label::HEIGHT, INK))
        .x_label_formatter(&|step| number(*step))
        .y_label_formatter(&|value| number(*value))
        .x_desc(x_name)
        .y_desc(y_name)
        .draw()?;
    if panel.axes.is_none() {
        draw_times(&mut chart, unit, &times)?;
    }
    write_heading(area, &panel.title)?;
    if let Some((step, meaning)) = &panel.mark {
        draw_mark(area, &mut chart, *step, meaning)?;
    }
    for (i, series) in panel.series.iter().enumerate() {
        let dotted = i > 0 || panel.axes.is_some();
        let style = stroke(COLOURS[i % COLOURS.len()], CURVE);
        draw_series(
            &mut chart,
            series,
            style,
            dotted,
            panel.mark.as_ref().map(|m| m.0),
        )?;
    }
    match panel.series.len() {
        0 | 1 => Ok(()),
        _ => draw_legend(area, &panel.series, panel.axes.is_some()),
    }
}

/// Draws the axis of time above the plot.
fn draw_times(chart: &mut TimedPlot, unit: &str, times: &[[f64; 2]]) -> Drawn {
    let time = |step: &f64| {
        let found = times.iter().find(|t| t[0] == *step);
        found.map_or(String::new(), |t| number(t[1]))
    };
    chart
        .configure_secondary_axes()
        .axis_style(stroke(FRAME, HAIR))
        .set_all_tick_mark_size(fine(TICK))
        .label_style(text(label::HEIGHT, INK))
        .x_label_formatter(&time)
        .x_desc(unit)
        .draw()?;
    Ok(())
}

fn write_heading(area: &Area, title: &str) -> Drawn {
    let [left, _, right, _] = BORDER;
    let middle = (left + PANEL[0] as f64 - right) / 2.0;
    let style = text(label::HEADING, INK).pos(Pos::new(HPos::Center, VPos::Top));
    Ok(area.draw_text(title, &style, (fine(middle), fine(EDGE)))?)
}

/// Draws a line at `step` and writes at its foot, which falling curves leave free, what values mean from there on.
fn draw_mark(area: &Area, chart: &mut Plot, step: f64, meaning: &str) -> Drawn {
    let Range { start, end } = chart.y_range();
    let line = PathElement::new(vec![(step, start), (step, end)], stroke(FRAME, HAIR));
    chart.draw_series([line])?;
    let foot = chart.backend_coord(&(step, start));
    let corner = area.get_base_pixel();
    let at = (
        foot.0 - corner.0 + fine(TEXT_GAP),
        foot.1 - corner.1 - fine(TEXT_GAP),
    );
    let style = text(label::HEIGHT, FRAME).pos(Pos::new(HPos::Left, VPos::Bottom));
    Ok(area.draw_text(meaning, &style, at)?)
}

/// Draws a series, with a gap behind the step `mark`.
fn draw_series(
    chart: &mut Plot,
    series: &Series,
    style: ShapeStyle,
    dotted: bool,
    mark: Option<f64>,
) -> Drawn {
    let before = series
        .points
        .partition_point(|p| mark.is_some_and(|mark| p[0] <= mark));
    let (before, behind) = series.points.split_at(before);
    let pieces = [before, behind]
        .into_iter()
        .flat_map(|part| part.split(|p| !is_drawable(p)));
    for piece in pieces {
        let places: Vec<(f64, f64)> = piece.iter().map(|p| (p[0], p[1])).collect();
        // One by one, with round joints: the outline of a whole jagged line overlaps itself.
        let lines = places.windows(2);
        chart.draw_series(lines.map(|ends| PathElement::new(ends.to_vec(), style)))?;
        let radius = if dotted || places.len() == 1 {
            DOT
        } else {
            CURVE / 2.0
        };
        let dots = places.iter();
        chart.draw_series(dots.map(|at| Circle::new(*at, fine(radius), style.filled())))?;
    }
    Ok(())
}

/// Says what the colours mean: where there is no axis of time (`is_above_free`) in a line in its place if it fits, else at the
/// top right, which falling curves leave free.
fn draw_legend(area: &Area, series: &[Series], is_above_free: bool) -> Drawn {
    let widths = series.iter().map(|s| label::width(&s.name, label::HEIGHT));
    let entry = LEGEND[0] + 3.0 * TEXT_GAP;
    let [frame, edge] = [0, 2].map(|side| BORDER[side]);
    let room = PANEL[0] as f64 - frame - edge;
    let line = widths.clone().map(|width| entry + width as f64).sum::<f64>();
    if is_above_free && line <= room {
        let y = (EDGE + label::HEADING as f64 + BORDER[1]) / 2.0;
        let mut left = frame + (room - line) / 2.0;
        for (i, (series, width)) in series.iter().zip(widths).enumerate() {
            draw_entry(area, &series.name, i, [left, y])?;
            left += entry + width as f64;
        }
        return Ok(());
    }
    let width = entry + widths.max().unwrap_or(0) as f64;
    let height = TEXT_GAP + series.len() as f64 * LEGEND[1];
    let right = PANEL[0] as f64 - BORDER[2] - TEXT_GAP;
    let (left, top) = (right - width, BORDER[1] + TEXT_GAP);
    let corners = [(fine(left), fine(top)), (fine(right), fine(top + height))];
    area.draw(&Rectangle::new(corners, WHITE.mix(LEGEND_COVER).filled()))?;
    for (i, Series { name, .. }) in series.iter().enumerate() {
        let y = top + TEXT_GAP / 2.0 + (i as f64 + 0.5) * LEGEND[1];
        draw_entry(area, name, i, [left, y])?;
    }
    Ok(())
}

/// Draws a piece of series `i`'s line from `left` on, at the height `y`, and its `name`.
fn draw_entry(area: &Area, name: &str, i: usize, [left, y]: [f64; 2]) -> Drawn {
    let [start, end] = [TEXT_GAP, TEXT_GAP + LEGEND[0]].map(|x| fine(left + x));
    let y = fine(y);
    let style = stroke(COLOURS[i % COLOURS.len()], CURVE);
    area.draw(&PathElement::new([(start, y), (end, y)], style))?;
    let style = text(label::HEIGHT, INK).pos(Pos::new(HPos::Left, VPos::Center));
    Ok(area.draw_text(name, &style, (end + fine(TEXT_GAP), y))?)
}

/// Units of time, in seconds, and from how many of them on each is used.
const UNITS: [(&str, f64, f64); 3] = [
    ("hours", 3600.0, 2.0),
    ("minutes", 60.0, 2.0),
    ("seconds", 1.0, 0.0),
];

/// The unit of the axis of time, and step and time at each of its ticks up to the step `last`.
fn times(clock: &[[f64; 2]], last: f64) -> (&'static str, Vec<[f64; 2]>) {
    let end = clock.last().map_or(0.0, |[_, seconds]| *seconds);
    let [.., shortest] = UNITS;
    let found = UNITS.into_iter().find(|(_, unit, least)| end >= least * unit);
    let (name, unit, _) = found.unwrap_or(shortest);
    let step_at = |seconds: f64| {
        let later = clock.iter().position(|[_, s]| *s >= seconds)?;
        let [x1, s1] = clock[later];
        let [x0, s0] = if later > 0 { clock[later - 1] } else { [0.0; 2] };
        let share = if s1 > s0 { (seconds - s0) / (s1 - s0) } else { 1.0 };
        Some(x0 + share * (x1 - x0)).filter(|step| *step <= last)
    };
    let ticks = even_ticks([0.0, end / unit]);
    let places = ticks.into_iter().filter_map(|t| Some([step_at(t * unit)?, t]));
    (name, places.collect())
}
