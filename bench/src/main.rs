//! `sharp-bench`, the command line of the harness.

use std::process::ExitCode;

fn main() -> ExitCode {
    set_environment();
    ExitCode::from(sharp_bench::cli::main(std::env::args_os().collect()))
}

/// Settings of libraries that only the environment takes, unless the user has made them.
fn set_environment() {
    let is_set = |name| std::env::var_os(name).is_some();
    let set = |name, value| {
        // SAFETY: called first in `main`, before there is another thread that could read the environment.
        unsafe { std::env::set_var(name, value) };
    };
    // Threads that candle keeps for elementwise operations wait by spinning. Ours do the network's work.
    if !is_set("CANDLE_NUM_THREADS") {
        set("CANDLE_NUM_THREADS", "1");
    }
    // Without a session, Mesa's device-select layer complains on standard error that it cannot ask the desktop which GPU
    // is the default one. The layer is left out then; adapters are ordered by ourselves anyway.
    if cfg!(target_os = "linux") && !is_set("XDG_RUNTIME_DIR") && !is_set("MESA_VK_DEVICE_SELECT") {
        set("NODEVICE_SELECT", "1");
    }
}
