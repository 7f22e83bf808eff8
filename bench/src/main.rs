//! `sharp-bench`, the command line of the harness.

use std::process::ExitCode;

fn main() -> ExitCode {
    quieten_mesa();
    ExitCode::from(sharp_bench::cli::main(std::env::args_os().collect()))
}

/// Without a session, Mesa's device-select layer complains on standard error that it cannot ask the desktop which GPU
/// is the default one. The layer is left out then; adapters are ordered by ourselves anyway.
#[cfg(target_os = "linux")]
fn quieten_mesa() {
    let set = |name| std::env::var_os(name).is_some();
    if !set("XDG_RUNTIME_DIR") && !set("MESA_VK_DEVICE_SELECT") {
        // SAFETY: called first in `main`, before there is another thread that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

#[cfg(not(target_os = "linux"))]
fn quieten_mesa() {}
