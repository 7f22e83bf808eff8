//! Inputs that users really have, from `tests/cases`: each gives its correct value or an error that
//! names the cause.

mod datasets;
mod gaussians;
mod pictures;
mod placed;
mod results;

use std::path::{Path, PathBuf};
use std::process::Command;

use sharp_tests::copy_folder;

use super::support::Said;

/// A case copied into its own folder, with the output of its commands.
pub(crate) struct Case {
    folder: tempfile::TempDir,
    /// Output of each line of `cmd`.
    pub(crate) said: Vec<Said>,
}

impl Case {
    /// A path in the case's folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs one more command line in the case's folder.
    pub(crate) fn run(&self, line: &str) -> Said {
        run_line(self.folder.path(), line)
    }

    /// Standard output and error of all commands of `cmd`.
    pub(crate) fn all(&self) -> String {
        self.said.iter().map(|s| s.out.clone() + &s.err).collect()
    }

    /// A column of `FOLDER/scores.csv`, one value per row.
    pub(crate) fn scores(&self, folder: &str, column: &str) -> Vec<String> {
        let path = self.path(folder).join("scores.csv");
        let mut rows = csv::Reader::from_path(&path).unwrap();
        let at = rows.headers().unwrap().iter().position(|h| h == column);
        let at = at.unwrap_or_else(|| panic!("{}: no column {column}", path.display()));
        rows.records()
            .map(|row| row.unwrap()[at].to_owned())
            .collect()
    }

    /// The case, as if it had run only the commands with the outputs `said`.
    pub(crate) fn having(self, said: Vec<Said>) -> Self {
        Self { said, ..self }
    }

    /// Fails unless the manifest, the report's page and the output of some command all contain the text.
    pub(crate) fn is_said_everywhere(&self, run: &str, text: &str) {
        assert!(self.all().contains(text), "terminal: {}", self.all());
        let manifest = std::fs::read_to_string(self.path(run).join("manifest.json")).unwrap();
        assert!(manifest.contains(text), "manifest: {manifest}");
        self.run(&format!("sharp-bench report -q {run}"))
            .ends_with(0);
        let report = std::fs::read_to_string(self.path(run).join("report/report.md")).unwrap();
        assert!(report.contains(text), "report: {report}");
    }
}

/// Copies a case and runs its commands.
pub(crate) fn case(name: &str) -> Case {
    let case = untried(name);
    let lines = std::fs::read_to_string(case.path("cmd")).unwrap();
    let said = lines.lines().map(|line| case.run(line)).collect();
    case.having(said)
}

/// Copies a case and runs nothing.
pub(crate) fn untried(name: &str) -> Case {
    let case = empty();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/cases");
    copy_folder(&source.join(name), case.folder.path()).unwrap();
    case
}

/// A new, empty folder.
pub(crate) fn empty() -> Case {
    Case {
        folder: tempfile::tempdir().unwrap(),
        said: Vec::new(),
    }
}

/// Runs a shell command line in which `sharp-bench` is the program of this build and the user's own
/// files are not visible.
fn run_line(folder: &Path, line: &str) -> Said {
    let program = Path::new(env!("CARGO_BIN_EXE_sharp-bench"));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let paths = std::iter::once(program.parent().unwrap().to_owned());
    let paths = std::env::join_paths(paths.chain(std::env::split_paths(&path))).unwrap();
    let output = Command::new("sh")
        .args(["-c", line])
        .current_dir(folder)
        .env("PATH", paths)
        .env("XDG_CACHE_HOME", folder.join(".cache"))
        .env("SHARP_BENCH_WEIGHTS", folder.join(".weights"))
        .env_remove("TORCH_HOME")
        .output()
        .unwrap();
    Said {
        code: output.status.code().unwrap_or(-1),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}
