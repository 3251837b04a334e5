//! Pictures of a BSDF: f_cos over the disk of directions to the light, for one direction to the camera each.
//!
//! A pixel stands for the `wi` whose x points right and whose y points up, seen from above the surface. There f_cos
//! spans many orders of magnitude, so the contact sheet shows every slice twice: linear, exposed for the lobe, and by
//! its logarithm, which shows the tails.

use crate::error::{Error, Result};
use crate::exr_file;
use crate::label;
use crate::picture::{SHOULDER, srgb_code, tone};
use crate::sheet::{INK, MARGIN, PAPER, Sheet, mixed};
use bake_runtime::Bsdf;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Share of the disk that the linear pictures show without bending its highlights.
const EXPOSED_SHARE: f64 = 0.995;

/// Share of the disk that may be darker than what the logarithmic pictures tell from black.
const DARK_SHARE: f64 = 0.01;

/// Most orders of magnitude of a logarithmic picture: more would leave the lobe itself without contrast.
const DECADES_MAX: f32 = 8.0;

/// Code of the mark at `wo`.
const MARK: [u8; 3] = [96, 165, 250];

/// Radius of the ring at `wo`, and half its width, pixels.
const RING: (f32, f32) = (5.0, 1.2);

/// f_cos over the disk.
#[derive(Clone, Debug, PartialEq)]
pub struct DiskSlice {
    /// Polar angle and azimuth of `wo`, degrees.
    pub wo_deg: [f64; 2],
    /// Width and height in pixels.
    pub size: usize,
    /// f_cos at the centre of every pixel, sr⁻¹, row by row from the top left; 0 outside the disk.
    pub rgb: Vec<[f32; 3]>,
}

/// How a slice was scaled for its pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Largest f_cos of any channel and pixel, sr⁻¹: white in the logarithmic picture.
    pub peak: f32,
    /// f_cos that is exactly as bright as [`SHOULDER`] in the linear picture; brighter ones are bent below white.
    pub exposed: f32,
    /// Whole orders of magnitude below the peak at which the logarithmic picture is black, ≥ 1.
    pub decades: f32,
}

impl DiskSlice {
    /// Draws the slice of `bsdf` at `wo_deg` = θ, φ in degrees, on the threads of the current rayon pool.
    ///
    /// `walks` random walks, keyed by `seed`, serve all pixels of a stochastic model ([`Bsdf::slice`]). `tick` is
    /// called with (rows done, rows in all); `Break` cancels.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn draw(
        bsdf: &dyn Bsdf,
        wo_deg: [f64; 2],
        size: usize,
        walks: usize,
        seed: u64,
        tick: &(dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
    ) -> Result<DiskSlice> {
        let wo = bake_runtime::bsdf::direction(wo_deg[0], wo_deg[1]);
        let slice = bsdf.slice(wo, walks, seed);
        let (done, cancelled) = (AtomicU64::new(0), AtomicBool::new(false));
        let rows: Vec<Vec<[f32; 3]>> = (0..size)
            .into_par_iter()
            .map(|row| {
                if cancelled.load(Ordering::Relaxed) {
                    return Vec::new();
                }
                let pixels = (0..size).map(|column| {
                    let [x, y] = position(column, row, size);
                    let z2 = 1.0 - x * x - y * y;
                    match z2 > 0.0 {
                        true => slice.eval(DVec3::new(x, y, z2.sqrt())).as_vec3().to_array(),
                        false => [0.0; 3],
                    }
                });
                let pixels = pixels.collect();
                let rows = done.fetch_add(1, Ordering::Relaxed) + 1;
                if tick(rows, size as u64).is_break() {
                    cancelled.store(true, Ordering::Relaxed);
                }
                pixels
            })
            .collect();
        if cancelled.into_inner() {
            return Err(Error::Cancelled);
        }
        Ok(DiskSlice {
            wo_deg,
            size,
            rgb: rows.concat(),
        })
    }

    /// Writes linear f_cos as OpenEXR, with `wo` in degrees as text attributes.
    ///
    /// # Errors
    /// See [`exr_file::write_rgb`].
    pub fn write_exr(&self, path: &Path) -> Result<()> {
        let [theta, phi] = self.wo_deg.map(|angle| angle.to_string());
        let attributes = [("bake.wo_theta_deg", theta), ("bake.wo_phi_deg", phi)];
        let attributes = BTreeMap::from(attributes.map(|(key, value)| (key.to_string(), value)));
        exr_file::write_rgb(path, [self.size; 2], &self.rgb, &attributes)
    }

    /// The scale of its pictures.
    pub fn scale(&self) -> Scale {
        let inside = |k: &usize| {
            let [x, y] = position(k % self.size, k / self.size, self.size);
            x * x + y * y < 1.0
        };
        let brightest = |k: usize| self.rgb[k].iter().copied().fold(0.0, f32::max);
        let mut values: Vec<f32> = (0..self.rgb.len()).filter(inside).map(brightest).collect();
        values.sort_by(f32::total_cmp);
        let peak = values.last().copied().unwrap_or(0.0);
        let quantile = |share: f64| values.get((values.len() as f64 * share) as usize).copied();
        let span = |dark: f32| (peak / dark).log10().ceil();
        Scale {
            peak,
            exposed: quantile(EXPOSED_SHARE).filter(|v| *v > 0.0).unwrap_or(peak),
            // A black slice has no span: 0/0.
            decades: quantile(DARK_SHARE)
                .map(span)
                .filter(|d| *d >= 1.0)
                .map_or(1.0, |d| d.min(DECADES_MAX)),
        }
    }
}

/// x and y of the direction at the centre of a pixel.
fn position(column: usize, row: usize, size: usize) -> [f64; 2] {
    let at = |i: usize| (2 * i + 1) as f64 / size as f64 - 1.0;
    [at(column), -at(row)]
}

/// The code of a linear picture.
pub(crate) fn linear(rgb: [f32; 3], scale: Scale) -> [u8; 3] {
    rgb.map(|v| srgb_code(tone(SHOULDER * v / scale.exposed.max(f32::MIN_POSITIVE), 0.0)))
}

/// The code of a logarithmic picture: the brightest channel by its logarithm, the hue kept.
pub(crate) fn logarithmic(rgb: [f32; 3], scale: Scale) -> [u8; 3] {
    let brightest = rgb.iter().copied().fold(0.0, f32::max);
    let value = 1.0 + (brightest / scale.peak.max(f32::MIN_POSITIVE)).log10() / scale.decades;
    match value > 0.0 {
        true => rgb.map(|v| (f32::from(srgb_code(v / brightest)) * value).round() as u8),
        false => [0; 3],
    }
}

/// Writes a contact sheet, a column per slice under its θ: linear above, logarithmic below, a ring at `wo`.
///
/// # Errors
/// [`Error::ImageSize`] when slices differ in size; see also [`crate::picture::write_codes`].
pub fn write_sheet(path: &Path, slices: &[DiskSlice]) -> Result<()> {
    let size = slices.first().map_or(1, |slice| slice.size);
    if let Some(other) = slices.iter().find(|slice| slice.size != size) {
        return Err(Error::ImageSize {
            first: [size; 2],
            second: [other.size; 2],
        });
    }
    let step = size + MARGIN;
    let top = 2 * MARGIN + label::HEIGHT;
    let mut sheet = Sheet::new(MARGIN + slices.len() * step, top + 2 * step);
    for (i, slice) in slices.iter().enumerate() {
        let left = MARGIN + i * step;
        let scale = slice.scale();
        let text = format!("θ {}°", slice.wo_deg[0]);
        let centred = left + size.saturating_sub(label::width(&text, label::HEIGHT)) / 2;
        sheet.text([centred, MARGIN], label::HEIGHT, INK, &text);
        sheet.disk([left, top], slice, |rgb| linear(rgb, scale));
        sheet.disk([left, top + step], slice, |rgb| logarithmic(rgb, scale));
    }
    sheet.write(path)
}

impl Sheet {
    /// Draws `slice` with its top left corner at `corner`, its edge and the ring smoothed over a pixel.
    pub(crate) fn disk(&mut self, corner: [usize; 2], slice: &DiskSlice, code: impl Fn([f32; 3]) -> [u8; 3]) {
        let wo = bake_runtime::bsdf::direction(slice.wo_deg[0], slice.wo_deg[1]);
        let half = slice.size as f32 / 2.0;
        for row in 0..slice.size {
            for column in 0..slice.size {
                let [x, y] = position(column, row, slice.size);
                let covered = (1.0 - x.hypot(y)) as f32 * half + 0.5;
                let pixel = mixed(PAPER, code(slice.rgb[row * slice.size + column]), covered);
                self.put(corner[0] + column, corner[1] + row, pixel);
            }
        }
        let centre = [wo.x as f32, -wo.y as f32].map(|v| (v + 1.0) * half - 0.5);
        self.ring([corner[0] as f32 + centre[0], corner[1] as f32 + centre[1]]);
    }

    /// Draws the ring around `centre`.
    fn ring(&mut self, centre: [f32; 2]) {
        let reach = (RING.0 + RING.1).ceil() as usize + 1;
        let [left, top] = centre.map(|v| (v as usize).saturating_sub(reach));
        for y in top..=top + 2 * reach {
            for x in left..=left + 2 * reach {
                let distance = (x as f32 - centre[0]).hypot(y as f32 - centre[1]);
                let share = RING.1 - (distance - RING.0).abs() + 0.5;
                let pixel = mixed(self.at(x, y), MARK, share);
                self.put(x, y, pixel);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_runtime::conductor::Conductor;

    fn go_on(_: u64, _: u64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn gold() -> DiskSlice {
        let conductor = Conductor::new([0.3, 0.1], [1.0, 0.782, 0.344]).unwrap();
        DiskSlice::draw(&conductor, [45.0, 0.0], 33, 64, 1, &go_on).unwrap()
    }

    #[test]
    fn the_lobe_lies_opposite_the_camera() {
        let slice = gold();
        let brightest = (0..33 * 33)
            .max_by(|a, b| slice.rgb[*a][0].total_cmp(&slice.rgb[*b][0]))
            .unwrap();
        let [x, y] = position(brightest % 33, brightest / 33, 33);
        // The lobe of a rough surface leans further than the mirror direction, x = −0.71, and is symmetric in y.
        assert!((-0.95..-0.6).contains(&x) && y == 0.0, "{x}, {y}");
        assert_eq!(slice.rgb[0], [0.0; 3], "outside the disk");
        let scale = slice.scale();
        assert_eq!(scale.peak, slice.rgb[brightest][0]);
        assert!(scale.exposed > 0.0 && scale.exposed <= scale.peak);
        assert!(scale.decades >= 1.0 && scale.decades.fract() == 0.0);
    }

    #[test]
    fn codes_span_both_scales() {
        let scale = Scale {
            peak: 1000.0,
            exposed: 10.0,
            decades: 4.0,
        };
        assert_eq!(linear([10.0; 3], scale), [srgb_code(SHOULDER); 3]);
        assert_eq!(logarithmic([1000.0, 1000.0, 0.0], scale), [255, 255, 0]);
        assert_eq!(logarithmic([10.0; 3], scale), [128; 3]);
        assert_eq!(logarithmic([1e-9; 3], scale), [0; 3]);
        let black = Scale {
            peak: 0.0,
            exposed: 0.0,
            decades: 1.0,
        };
        assert_eq!(
            (linear([0.0; 3], black), logarithmic([0.0; 3], black)),
            ([0; 3], [0; 3])
        );
    }

    #[test]
    fn sheets_and_exr_are_written_and_cancelling_stops() {
        let folder = tempfile::tempdir().unwrap();
        let (sheet, exr) = (folder.path().join("sheet.png"), folder.path().join("slice.exr"));
        let slice = gold();
        write_sheet(&sheet, &[slice.clone(), slice.clone()]).unwrap();
        slice.write_exr(&exr).unwrap();
        let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&sheet).unwrap()));
        let info = decoder.read_info().unwrap();
        let expected = (3 * MARGIN + 2 * 33, 4 * MARGIN + label::HEIGHT + 2 * 33);
        assert_eq!(
            (info.info().width as usize, info.info().height as usize),
            expected
        );
        let smaller = DiskSlice {
            size: 1,
            rgb: vec![[0.0; 3]],
            ..slice
        };
        let mismatch = write_sheet(&sheet, &[gold(), smaller]);
        assert!(matches!(mismatch, Err(Error::ImageSize { .. })));
        let conductor = Conductor::new([0.3, 0.1], [1.0; 3]).unwrap();
        let stopped = DiskSlice::draw(&conductor, [45.0, 0.0], 8, 1, 1, &|_, _| ControlFlow::Break(()));
        assert!(matches!(stopped, Err(Error::Cancelled)));
    }
}
