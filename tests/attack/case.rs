//! A case: a folder, a sequence of random numbers, and limits for the binary.

use std::fs::File;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use sharp_tests::mutants::Random;
use tempfile::TempDir;

/// Address space of one invocation, KiB.
const MEMORY_KIB: u64 = 3 << 20;

/// Maximum resident memory of one invocation, bytes.
const RESIDENT: u64 = 1 << 30;

/// Maximum time of one invocation; most take a tenth of a second.
const PATIENCE: Duration = Duration::from_secs(40);

/// Maximum number of bytes that an invocation may write to each of its outputs.
const OUTPUT: u64 = 1 << 20;

/// The acceptable outcomes of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// Refused, or recorded as a failure, with a reason that names the cause.
    Error,
    /// The same number as the oracle's.
    Number,
}

/// The output of an invocation.
pub(crate) struct Said {
    pub(crate) code: i32,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Said {
    pub(crate) fn json(&self) -> Result<serde_json::Value, String> {
        serde_json::from_str(&self.out).map_err(|error| format!("no JSON ({error}): {}", self.out))
    }
}

pub(crate) struct Case {
    kind: &'static str,
    seed: u64,
    dir: TempDir,
    pub(crate) random: Random,
    /// Steps done so far, for repeating the case.
    history: Vec<String>,
    /// Words by which an error message may name the cause, in addition to paths in the case's
    /// folder.
    names: Vec<String>,
}

impl Case {
    pub(crate) fn new(kind: &'static str, seed: u64) -> Self {
        let mixed = kind.bytes().fold(seed, |sum, byte| {
            sum.wrapping_mul(0x100_0000_01B3) ^ u64::from(byte)
        });
        Self {
            kind,
            seed,
            dir: tempfile::Builder::new()
                .prefix("attack-")
                .tempdir()
                .unwrap(),
            random: Random::new(mixed),
            history: Vec::new(),
            names: Vec::new(),
        }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> String {
        String::from_utf8_lossy(&std::fs::read(self.path(name)).unwrap_or_default()).into_owned()
    }

    /// Records a step, and a word by which an error message may name it.
    pub(crate) fn note(&mut self, what: impl Into<String>, name: &str) {
        self.history.push(what.into());
        self.may_name(name);
    }

    /// Adds a word by which an error message may name the cause.
    pub(crate) fn may_name(&mut self, name: &str) {
        self.names.push(name.to_owned());
    }

    /// The message on a failed case, with its steps and how to repeat it. Keeps its folder.
    pub(crate) fn failure(mut self, what: &str) -> String {
        self.dir.disable_cleanup(true);
        format!(
            "{what}\n  {}\n  in {}\n  repeat: SHARP_ATTACK_SEED={} SHARP_ATTACK_CASES=1 cargo test --workspace --release --test \
             attack -- {} --exact",
            self.history.join("\n  "),
            self.dir.path().display(),
            self.seed,
            self.kind
        )
    }

    /// Runs the binary in the case's folder. Whatever the request, it must end by itself, in time,
    /// within its memory, without a panic and with a documented exit code, and it must not write
    /// anything that a terminal would interpret.
    pub(crate) fn run(&mut self, args: &[&str]) -> Result<Said, String> {
        let quoted: Vec<String> = args.iter().map(|arg| format!("'{arg}'")).collect();
        self.history
            .push(format!("sharp-bench {}", quoted.join(" ")));
        let outputs = ["stdout", "stderr"].map(|name| self.path(&format!(".{name}")));
        let [out, err] = [0, 1].map(|i| File::create(&outputs[i]).unwrap());
        let mut child = Command::new("sh")
            .args(["-c", "ulimit -v \"$0\" && exec \"$@\""])
            .arg(MEMORY_KIB.to_string())
            .arg(env!("CARGO_BIN_EXE_sharp-bench"))
            .args(args)
            .env("XDG_CACHE_HOME", self.path(".cache"))
            .env("SHARP_BENCH_WEIGHTS", self.path(".weights"))
            .env_remove("TORCH_HOME")
            .current_dir(self.dir.path())
            .stdin(Stdio::null())
            .stdout(out)
            .stderr(err)
            .process_group(0)
            .spawn()
            .unwrap();
        let begin = Instant::now();
        let mut resident = 0;
        let status = loop {
            resident = resident.max(peak_bytes(child.id()));
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            if begin.elapsed() > PATIENCE {
                let group = format!("-{}", child.id());
                let _ = Command::new("kill")
                    .args(["-s", "KILL", "--", &group])
                    .status();
                let _ = child.wait();
                return Err(format!("still running after {} s", PATIENCE.as_secs()));
            }
            std::thread::sleep(Duration::from_millis(3));
        };
        if resident > RESIDENT {
            return Err(format!("{} MiB of memory", resident >> 20));
        }
        let said = said(status, &outputs)?;
        self.judge(&said)?;
        Ok(said)
    }

    fn judge(&self, said: &Said) -> Result<(), String> {
        let Said { code, out, err } = said;
        if err.contains("panicked") {
            return Err(format!("panicked: {err}"));
        }
        if !matches!(code, 0..=5 | 75) {
            return Err(format!("exit code {code}: {err}"));
        }
        for text in [out, err] {
            if let Some(found) = text.chars().find(|c| is_obeyed(*c)) {
                return Err(format!("{found:?} in the output: {text:?}"));
            }
        }
        match code {
            1 => self.judge_error(err),
            // clap adds suggestions.
            2 if !err.contains("error: ") => {
                Err(format!("exit code 2 without an error message: {err}"))
            }
            _ => Ok(()),
        }
    }

    /// The error must be a single line, the last one, and name a file, an option or something
    /// noted.
    fn judge_error(&self, err: &str) -> Result<(), String> {
        let mut errors = err.lines().filter(|line| line.starts_with("error: "));
        let (Some(error), None) = (errors.next(), errors.next()) else {
            return Err(format!("the error is not a single line: {err}"));
        };
        if err.lines().last() != Some(error) {
            return Err(format!("the error is not the last line: {err}"));
        }
        self.judge_reason(error)
    }

    /// A reason must be a single line of limited length that names something.
    pub(crate) fn judge_reason(&self, reason: &str) -> Result<(), String> {
        let known = self.names.iter().any(|name| reason.contains(name.as_str()));
        let folder = self.dir.path().file_name().unwrap().to_string_lossy();
        if !known && !reason.contains(&*folder) && !reason.contains("--") {
            return Err(format!(
                "the message names neither a file nor an option: {reason}"
            ));
        }
        if reason.len() > 8000 || reason.contains('\n') {
            Err(format!("no short line: {reason}"))
        } else {
            Ok(())
        }
    }

    /// Runs an invocation that must not succeed.
    pub(crate) fn refused(&mut self, args: &[&str]) -> Result<Verdict, String> {
        let said = self.run(args)?;
        match said.code {
            0 => Err(format!("accepted: {}{}", said.out, said.err)),
            _ => Ok(Verdict::Error),
        }
    }
}

/// Peak resident memory of a process so far.
fn peak_bytes(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = peak.and_then(|text| text.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok());
    kib.unwrap_or(0) << 10
}

fn said(status: ExitStatus, outputs: &[PathBuf; 2]) -> Result<Said, String> {
    let read = |path: &Path| -> Result<String, String> {
        let bytes = path.metadata().unwrap().len();
        if bytes > OUTPUT {
            return Err(format!("wrote {bytes} bytes of output, more than {OUTPUT}"));
        }
        String::from_utf8(std::fs::read(path).unwrap()).map_err(|error| error.to_string())
    };
    let (out, err) = (read(&outputs[0])?, read(&outputs[1])?);
    match (status.code(), status.signal()) {
        (Some(code), _) => Ok(Said { code, out, err }),
        (None, signal) => Err(format!("ended by signal {signal:?}: {err}")),
    }
}

/// Characters that a terminal or a page would interpret: control characters, and marks that change
/// the direction of text.
pub(crate) fn is_obeyed(c: char) -> bool {
    let turns = matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns || (c.is_control() && c != '\n' && c != '\t')
}
