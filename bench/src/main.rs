//! `sharp-bench`, the command line of the harness.

use std::process::ExitCode;

fn main() -> ExitCode {
    set_environment();
    ExitCode::from(sharp_bench::cli::main(std::env::args_os().collect()))
}

/// Sets library options that exist only as environment variables, unless the user has set them.
fn set_environment() {
    let is_set = |name| std::env::var_os(name).is_some();
    let set = |name, value| {
        // SAFETY: called first in `main`, before any other thread that could read the environment exists.
        unsafe { std::env::set_var(name, value) };
    };
    // Candle's own threads busy-wait in elementwise operations; the network's work runs on our
    // threads.
    if !is_set("CANDLE_NUM_THREADS") {
        set("CANDLE_NUM_THREADS", "1");
    }
    // Without a desktop session, Mesa's device-select layer prints an error about the default GPU.
    // Disable the layer; we order adapters ourselves.
    if cfg!(target_os = "linux") && !is_set("XDG_RUNTIME_DIR") && !is_set("MESA_VK_DEVICE_SELECT") {
        set("NODEVICE_SELECT", "1");
    }
}
