//! The machine that this process runs on, and the process's peak memory.

use std::sync::OnceLock;
use std::time::{Duration, Instant};

use super::counts::counted;

/// Peak resident size, bytes. `None` if the system does not report it (Linux reports it).
pub fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

/// Resets [`peak_bytes`]; false if the system does not allow it.
pub fn reset_peak() -> bool {
    std::fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// Time since the first call, by a monotonic clock.
pub fn monotonic() -> Duration {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed()
}

/// The processor and number of threads, `AMD EPYC 7R13, 8 threads`. Timings are comparable only
/// for the same processor and number of threads. `None` if the system reports neither.
pub fn cpu_and_threads() -> Option<String> {
    static CPU: OnceLock<Option<String>> = OnceLock::new();
    let cpu = CPU.get_or_init(|| {
        let info = std::fs::read_to_string("/proc/cpuinfo").ok()?;
        let line = info.lines().find(|line| line.starts_with("model name"))?;
        Some(line.split_once(':')?.1.trim().to_owned())
    });
    let threads = counted(rayon::current_num_threads(), "thread");
    cpu.as_ref().map(|cpu| format!("{cpu}, {threads}"))
}
