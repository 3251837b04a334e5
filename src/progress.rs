//! Progress bars on standard error; plain lines where that is not a terminal.

use crate::interrupt;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::time::Instant;

/// One long piece of work after another, each with a bar.
pub struct Stages {
    current: Mutex<Option<Stage>>,
}

struct Stage {
    label: String,
    started: Instant,
    bar: ProgressBar,
}

impl Stages {
    /// No stage yet.
    pub fn new() -> Stages {
        Stages {
            current: Mutex::new(None),
        }
    }

    /// Reports (done, total) of the stage called `label`, starting it if it is not the current one; tells the
    /// work to stop after Ctrl-C.
    pub fn report(&self, label: &str, done: u64, total: u64) -> ControlFlow<()> {
        let mut current = self.current.lock().unwrap_or_else(|e| e.into_inner());
        let other = current.as_ref().is_none_or(|s| s.label != label);
        if other {
            finish(current.take());
            *current = Some(Stage {
                label: label.to_string(),
                started: Instant::now(),
                bar: bar(label, total),
            });
        }
        if let Some(stage) = current.as_ref() {
            if stage.bar.length() != Some(total) {
                stage.bar.set_length(total);
            }
            // Threads report out of order.
            if done > stage.bar.position() || done == 0 {
                stage.bar.set_position(done);
            }
        }
        interrupt::flow()
    }

    /// Ends the current stage.
    pub fn finish(&self) {
        finish(self.current.lock().unwrap_or_else(|e| e.into_inner()).take());
    }
}

impl Drop for Stages {
    fn drop(&mut self) {
        self.finish();
    }
}

fn bar(label: &str, total: u64) -> ProgressBar {
    let template = "{msg:<28} {bar:32} {percent:>3}%  {elapsed_precise} elapsed, {eta_precise} left";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(total)
        .with_style(style)
        .with_message(label.to_string())
}

fn finish(stage: Option<Stage>) {
    let Some(stage) = stage else { return };
    stage.bar.finish_and_clear();
    if std::io::stderr().is_terminal() || !interrupt::requested() {
        eprintln!(
            "{:<28} {:.1} s",
            stage.label,
            stage.started.elapsed().as_secs_f64()
        );
    }
}
