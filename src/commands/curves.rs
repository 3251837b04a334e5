//! The picture of the learning curves of a bake.

use anyhow::Result;
use bake_scenes::curve_picture::{CurvePanel, Series, write_curves};
use bake_train::bake::Stage;
use bake_train::presets::Preset;
use bake_train::training::curve::Curve;
use bake_train::training::sample::map_steps;
use std::path::Path;

/// The picture in the folder of a model.
pub const CURVES_FILE: &str = "curves.png";

/// Stages that train a network, in their order.
const NETWORKS: [Stage; 4] = [Stage::Charts, Stage::Sample, Stage::Eval, Stage::Pdf];

/// Draws what learning curves of `preset` lie in `work` as [`CURVES_FILE`] in `folder`; nothing where there are none.
///
/// # Errors
/// Where a curve is damaged, or the picture cannot be written.
pub fn draw(work: &Path, preset: Preset, folder: &Path) -> Result<()> {
    let mut panels = Vec::new();
    for stage in NETWORKS {
        let path = work.join(Curve::file_name(stage.key()));
        if path.exists() {
            panels.push(panel(stage, preset, &Curve::read(&path)?));
        }
    }
    if !panels.is_empty() {
        write_curves(&folder.join(CURVES_FILE), &panels)?;
    }
    Ok(())
}

/// What the picture shows of a finished `curve`.
fn panel(stage: Stage, preset: Preset, curve: &Curve) -> CurvePanel {
    let loss = Series {
        name: "training loss".into(),
        points: curve.rows.iter().map(|row| [row.step as f64, row.loss]).collect(),
    };
    let errors = curve.names.iter().enumerate().map(|(i, name)| Series {
        name: name.clone(),
        points: curve
            .rows
            .iter()
            .filter_map(|row| Some([row.step as f64, *row.errors.get(i)?]))
            .collect(),
    });
    let steps = curve.rows.last().map_or(0, |row| row.step);
    let changes = stage == Stage::Sample && preset == Preset::Warp;
    CurvePanel {
        title: stage.label().into(),
        series: std::iter::once(loss).chain(errors).collect(),
        clock: curve
            .rows
            .iter()
            .map(|row| [row.step as f64, row.seconds])
            .collect(),
        mark: changes.then(|| (map_steps(steps) as f64, "from here on the density's loss".into())),
        axes: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bake_train::training::curve::Row;

    fn curve(names: &[&str]) -> Curve {
        let row = |step: u64| Row {
            step,
            seconds: 0.01 * step as f64,
            learning_rate: 1e-3,
            loss: 1.0 / step as f64,
            errors: match step % 500 {
                0 => vec![0.5; names.len()],
                _ => Vec::new(),
            },
        };
        Curve {
            rows: (1..=10).map(|i| row(100 * i)).collect(),
            ..Curve::new(names)
        }
    }

    #[test]
    fn a_panel_has_loss_errors_and_the_change_of_the_loss() {
        let shown = panel(Stage::Sample, Preset::Warp, &curve(&["binning_l1"]));
        assert_eq!(shown.title, "sampling network");
        assert_eq!(shown.series[0].points.len(), 10);
        assert_eq!(shown.series[1].name, "binning_l1");
        assert_eq!(shown.series[1].points, [[500.0, 0.5], [1000.0, 0.5]]);
        assert_eq!(shown.clock[9], [1000.0, 10.0]);
        assert_eq!(shown.mark.map(|m| m.0), Some(map_steps(1000) as f64));
        assert_eq!(panel(Stage::Eval, Preset::Warp, &curve(&[])).mark, None);
        assert_eq!(panel(Stage::Sample, Preset::Paper, &curve(&[])).mark, None);
    }

    #[test]
    fn what_curves_there_are_become_a_picture() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let (work, picture) = (folder.path(), folder.path().join(CURVES_FILE));
        draw(work, Preset::Warp, work).expect("no curves are no mistake");
        assert!(!picture.exists());
        let path = work.join(Curve::file_name("sample"));
        curve(&[]).save(&path).expect("the folder is writable");
        draw(work, Preset::Warp, work).expect("the curve is whole");
        assert!(picture.exists());
        std::fs::write(&path, "step,loss\n").expect("the folder is writable");
        let error = draw(work, Preset::Warp, work).expect_err("no curve").to_string();
        assert!(error.contains("its columns are `step,loss`"), "{error}");
    }
}
