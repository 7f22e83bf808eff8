//! The option `--memory-limit`.

use super::output;
use crate::evaluate::MEMORY_LIMIT_BYTES;
use crate::io::machine::peak_bytes;

#[derive(Debug, clap::Args)]
pub(super) struct MemoryArgs {
    /// Memory limit, such as 512M or 4G: Gaussians beyond a quarter of the limit are stored on disk, and a pair's
    /// predictions are made and scored in parts. Network weights and single pictures cannot be split; if they make the
    /// process exceed a limit set with this option, a warning is printed [default: 2G]
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    memory_limit: Option<u64>,
}

impl MemoryArgs {
    pub(super) fn limit_bytes(&self) -> u64 {
        self.memory_limit.unwrap_or(MEMORY_LIMIT_BYTES)
    }

    /// Warns if a requested limit was exceeded.
    pub(super) fn say_if_exceeded(&self) {
        let (Some(limit), Some(peak)) = (self.memory_limit, peak_bytes()) else {
            return;
        };
        if peak > limit {
            let mib = |bytes: u64| bytes.div_ceil(1 << 20);
            output::remark(format!(
                "warning: memory reached {} MiB, above --memory-limit ({} MiB), because network weights and single \
                 pictures cannot be split",
                mib(peak),
                mib(limit)
            ));
        }
    }
}

/// Parses a size such as `512M`, `2G` or `1048576`; units are powers of 1024.
fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || "expected a size such as 512M or 2G".to_owned();
    let unit = text.trim_end_matches("iB").trim_end_matches('B');
    let (number, shift) = match unit.chars().last() {
        Some('K' | 'k') => (&unit[..unit.len() - 1], 10),
        Some('M') => (&unit[..unit.len() - 1], 20),
        Some('G') => (&unit[..unit.len() - 1], 30),
        Some('T') => (&unit[..unit.len() - 1], 40),
        _ => (unit, 0),
    };
    let number: u64 = number.trim().parse().map_err(|_| wrong())?;
    let bytes = number.checked_mul(1 << shift);
    bytes.filter(|bytes| *bytes >= 1 << 20).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_have_units() {
        for (text, expected) in [
            ("1048576", 1 << 20),
            ("512M", 512 << 20),
            ("2G", 2 << 30),
            ("3072KiB", 3 << 20),
        ] {
            assert_eq!(bytes(text), Ok(expected));
        }
        for text in ["", "M", "2X", "-1", "1.5G", "99999999999999T", "4", "3K"] {
            assert!(bytes(text).is_err(), "{text}");
        }
    }
}
