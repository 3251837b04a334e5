//! The command line of `bake`: one file per subcommand, no mathematics.
#![forbid(unsafe_code)]

mod arguments;
mod backends;
mod commands;
mod help;
mod interrupt;
mod machine;
mod output;
mod progress;

use arguments::{Arguments, Command};
use clap::Parser;
use std::process::ExitCode;

/// candle allocates a tensor per operation; the system's allocator costs it a third of its speed.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Exit status of bad input and of everything else that stopped the work.
const FAILED: u8 = 2;
/// Exit status after Ctrl-C, as shells have it.
const INTERRUPTED: u8 = 130;

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            output::complain(&sentence(&error));
            ExitCode::from(if interrupt::requested() {
                INTERRUPTED
            } else {
                FAILED
            })
        }
    }
}

/// The error and its causes in one line; a cause that the text already gives is not said twice.
fn sentence(error: &anyhow::Error) -> String {
    let text = error
        .chain()
        .map(|cause| cause.to_string())
        .reduce(|text, cause| match text.contains(&cause) {
            true => text,
            false => format!("{text}: {cause}"),
        });
    text.unwrap_or_default()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

fn run(arguments: Arguments) -> anyhow::Result<()> {
    // Rows are answered as they come: there is nothing to save before Ctrl-C ends that.
    if !matches!(arguments.command, Command::Query(_)) {
        interrupt::listen()?;
    }
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads.get())
            .build_global()?;
    }
    match arguments.command {
        Command::Scene(options) => commands::scene::run(&options),
        Command::Train(options) => commands::train::run(&options),
        Command::Check(options) => commands::check::run(&options),
        Command::Rivals(options) => commands::rivals::run(&options),
        Command::Export(options) => commands::export::run(&options),
        Command::Query(options) => commands::query::run(&options),
        Command::Maps(options) => commands::maps::run(&options),
        Command::Material(options) => commands::material::run(&options),
        Command::Render(options) => commands::render::run(&options),
        Command::Bench(options) => commands::bench::run(&options),
    }
}
