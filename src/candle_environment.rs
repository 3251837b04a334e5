//! Keeps candle from counting the processors before every matrix product.
//!
//! candle 0.11 asks for its number of threads in each product and, unless an environment variable answers,
//! reads the system's processor list to find out: a quarter of the time of networks as small as ours. Batches
//! are spread over the cores by `bake-train` itself, so one thread is the right answer. A running program
//! cannot change its environment safely, so it starts itself anew, once.

/// The variable that candle reads: the processors it may use.
const VARIABLE: &str = "CANDLE_CPU_MASK";

/// Replaces this process by itself with the variable set; returns when it is set already, or cannot be.
#[cfg(target_os = "linux")]
pub fn settle() {
    use std::os::unix::process::CommandExt;
    if std::env::var_os(VARIABLE).is_some() {
        return;
    }
    if let Ok(program) = std::env::current_exe() {
        let mut arguments = std::env::args_os();
        let mut command = std::process::Command::new(program);
        if let Some(name) = arguments.next() {
            command.arg0(name);
        }
        // Only returns when it fails, and then everything still works, slower.
        let _ = command.args(arguments).env(VARIABLE, "0").exec();
    }
}

/// Elsewhere candle does not read a processor list.
#[cfg(not(target_os = "linux"))]
pub fn settle() {}
