//! Runs the binary and checks its output.

use std::path::Path;
use std::process::{Command, Output};

pub(crate) use sharp_tests::{holds, words};

/// The outcome of a command.
pub(crate) struct Said {
    /// Exit code.
    pub(crate) code: i32,
    /// Standard output.
    pub(crate) out: String,
    /// Standard error.
    pub(crate) err: String,
}

impl Said {
    /// Standard output as JSON.
    pub(crate) fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|e| panic!("{e}: {} {}", self.out, self.err))
    }

    /// Fails unless the command ended with exit code 1 and a single line that contains all parts.
    pub(crate) fn is_error_with(&self, parts: &[&str]) {
        self.is_line_with(1, parts);
    }

    /// Like [`Self::is_error_with`], for a request that is impossible: exit code 2.
    pub(crate) fn is_usage_error_with(&self, parts: &[&str]) {
        self.is_line_with(2, parts);
    }

    fn is_line_with(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code, code, "{}{}", self.out, self.err);
        let errors: Vec<&str> = self
            .err
            .lines()
            .filter(|l| l.starts_with("error: "))
            .collect();
        assert_eq!(errors.len(), 1, "{}", self.err);
        assert_eq!(
            self.err.lines().last(),
            errors.first().copied(),
            "{}",
            self.err
        );
        holds(errors[0], parts);
        assert!(!self.err.contains("panicked"), "{}", self.err);
    }

    /// Fails unless the exit code is the given one.
    pub(crate) fn ends_with(self, code: i32) -> Self {
        assert_eq!(self.code, code, "{}{}", self.out, self.err);
        self
    }
}

/// A PLY of Gaussians as 3D Gaussian Splatting stores them: a row has the mean, the constant coefficients, the opacity's logit,
/// the scales' logarithms and the quaternion.
pub(crate) fn ascii_ply(rows: &[[f32; 14]]) -> String {
    use std::fmt::Write as _;
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", rows.len());
    let names =
        "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    for name in names.split(' ') {
        let _ = writeln!(text, "property float {name}");
    }
    text += "end_header\n";
    for row in rows {
        let row: Vec<String> = row.iter().map(f32::to_string).collect();
        let _ = writeln!(text, "{}", row.join(" "));
    }
    text
}

/// Runs `sharp-bench` in a folder without access to the user's files: no cache of overlaps, no
/// weights.
pub(crate) fn sharp_bench(folder: &Path, args: &[&str]) -> Said {
    sharp_bench_with(folder, &[], args)
}

/// Runs `sharp-bench` in a folder with environment variables.
pub(crate) fn sharp_bench_with(folder: &Path, variables: &[(&str, &Path)], args: &[&str]) -> Said {
    let Output {
        status,
        stdout,
        stderr,
    } = Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .args(args)
        .env("XDG_CACHE_HOME", folder.join(".cache"))
        .env("SHARP_BENCH_WEIGHTS", folder.join(".weights"))
        .env_remove("TORCH_HOME")
        .envs(variables.iter().copied())
        .current_dir(folder)
        .output()
        .unwrap();
    Said {
        code: status.code().unwrap_or(-1),
        out: String::from_utf8(stdout).unwrap(),
        err: String::from_utf8(stderr).unwrap(),
    }
}

/// The text of a file.
pub(crate) fn read(path: impl AsRef<Path>) -> String {
    let path = path.as_ref();
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}
