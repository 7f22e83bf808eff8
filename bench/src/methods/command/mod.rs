//! An external program as a method: one long-lived process that receives one line of JSON per pair
//! and answers with one line.
//!
//! * `protocol`: requests and answers.
//! * `words`: the files named in the command line.
//! * `process`: starting, reading lines with a deadline, stopping; `log`: standard error, bounded.

mod log;
mod process;
mod protocol;
mod words;

use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use sharp_datasets::format::npy;
use tempfile::TempDir;

use self::log::ProgramLog;
use self::process::{Process, Trouble};
use self::protocol::{Answer, PairRequest, SourceFiles};
use self::words::{NamedFiles, named_files};
use super::crop_and_resize::FitRules;
use super::method::{
    Approach, Method, MethodError, MethodIdentity, PicturePrediction, PredictPicture, SourceView,
    TargetCamera,
};
use super::privilege::{Privilege, TrueDepth};
use super::scale_sweep::{PredictAtScale, Scale};
use super::spec::{MethodSpec, SpecError};
use crate::io::atomic_files::{FileError, scratch_folder};
use crate::io::fingerprints;
use crate::io::hash::{FileStamp, HashedFile, StableHasher, sha256_hex};
use crate::io::rendering_files::write_png;

/// Runs a program for all pairs of a run.
///
/// The shell starts the program at the first pair; further pairs are sent to its standard input. If the program
/// crashes, exceeds the timeout or answers invalidly, only the current pair fails, and the program is restarted for the
/// next pair. After three starts without any answer, it is not started again.
///
/// The hashes of the files named in the command line and in `files=` are part of the identity. Anything else that
/// changes predictions, such as a Python environment or a folder of data, must be described in `version=`.
#[derive(Debug)]
pub struct Command {
    label: String,
    run: String,
    /// Working directory of the program; empty for that of this process. Not part of the identity.
    folder: PathBuf,
    version: String,
    /// Files named in the command line and in `files=`.
    files: Vec<HashedFile>,
    notes: Vec<String>,
    timeout: Duration,
    fit: FitRules,
    depth: TrueDepth,
    /// Path of the log, and the folder in which scratch folders are created; set when a run begins.
    places: OnceLock<(PathBuf, PathBuf)>,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    process: Option<Process>,
    log: Option<Arc<Mutex<ProgramLog>>>,
    scratch: Option<TempDir>,
    /// Contents of the scratch folder: SHA-256 of the source's picture and depth, and the stamps of their files.
    source: Option<(String, Vec<Option<FileStamp>>)>,
    has_answered: bool,
    /// Number of times that the program was started and ended without any answer.
    failed_starts: usize,
    /// Reason for not starting the program again.
    given_up: Option<String>,
}

/// Number of starts without any answer after which the program is not started again.
const STARTS: usize = 3;

impl Command {
    /// Default of `timeout=`, in seconds. It includes the time for starting the program.
    const TIMEOUT_SECS: u64 = 600;

    /// Parses the options; the program is started at the first prediction.
    pub fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        let run = spec.option("run").unwrap_or_default().trim().to_owned();
        if run.is_empty() {
            return Err(spec.error("needs run='PROGRAM ARGUMENTS'"));
        }
        let timeout = match spec.option("timeout") {
            None => Duration::from_secs(Self::TIMEOUT_SECS),
            Some(text) => text
                .parse()
                .ok()
                .filter(|secs: &f64| *secs > 0.0)
                .and_then(|secs| Duration::try_from_secs_f64(secs).ok())
                .ok_or_else(|| spec.error(format!("timeout={text}: expected seconds")))?,
        };
        let fit = FitRules::parse(|key| spec.option(key)).map_err(|reason| spec.error(reason))?;
        if fit.needs_file() {
            return Err(spec.error(
                "crop=center and crop=sidecar need files; for a program use crop=x:y:w:h or \
                 crop=center:W:H",
            ));
        }
        let folder = spec.option("cwd").map(PathBuf::from).unwrap_or_default();
        if !folder.as_os_str().is_empty() && !folder.is_dir() {
            return Err(spec.refused(format!("cwd={} is not a folder", folder.display())));
        }
        let mut files = named_files(&run, &folder, &|name| std::env::var(name).ok());
        if let Some(pattern) = spec.option("files") {
            let pattern = folder.join(pattern);
            let more =
                matching(&pattern.to_string_lossy()).map_err(|reason| spec.refused(reason))?;
            files.found.extend(more);
            files.found.sort();
            files.found.dedup();
            files.unseen.retain(|folder| {
                let is_in_it = |file: &PathBuf| file.starts_with(folder);
                !files.found.iter().any(is_in_it)
            });
        }
        let hashed: Result<Vec<HashedFile>, FileError> = files
            .found
            .iter()
            .map(|path| HashedFile::read(path))
            .collect();
        Ok(Self {
            label: spec.label.clone(),
            run,
            folder,
            notes: notes_of(&files),
            files: hashed.map_err(|error| spec.refused(error))?,
            version: spec.option("version").unwrap_or_default().to_owned(),
            timeout,
            fit,
            depth: spec.depth(TrueDepth::SourceDepth)?,
            places: OnceLock::new(),
            state: Mutex::default(),
        })
    }

    fn failure(&self, reason: impl Into<String>) -> MethodError {
        MethodError::Program {
            run: self.run.clone(),
            reason: reason.into(),
        }
    }

    /// The log, opened on first use; `None` outside a run.
    fn log(&self, state: &mut State) -> Result<Option<Arc<Mutex<ProgramLog>>>, MethodError> {
        if state.log.is_none()
            && let Some((path, _)) = self.places.get()
        {
            let log = ProgramLog::open(path).map_err(|error| MethodError::file(path, error))?;
            state.log = Some(Arc::new(Mutex::new(log)));
        }
        Ok(state.log.clone())
    }

    /// Sends a request and waits for its answer.
    fn ask(&self, state: &mut State, request: &PairRequest) -> Result<Answer, MethodError> {
        if let Some(reason) = &state.given_up {
            return Err(self.failure(reason));
        }
        let line = request
            .to_line()
            .map_err(|error| self.failure(error.to_string()))?;
        loop {
            let (mut process, fresh) = match state.process.take() {
                Some(process) => (process, false),
                None => {
                    let log = self.log(state)?;
                    let process = Process::start(&self.run, &self.folder, log);
                    (process.map_err(|reason| self.failure(reason))?, true)
                }
            };
            let trouble = match process.ask(&line, self.timeout) {
                Ok(text) => match Answer::parse(&text, request.pair_id()) {
                    Ok(answer) => {
                        state.process = Some(process);
                        state.has_answered = true;
                        return Ok(answer);
                    }
                    Err(reason) => reason,
                },
                Err(Trouble::Ended) => {
                    let ended = process.stop();
                    // A program may exit successfully after an answer. Then start it again for this pair.
                    if !fresh && ended.succeeded() {
                        continue;
                    }
                    if fresh && !state.has_answered {
                        state.failed_starts += 1;
                    }
                    if state.failed_starts == STARTS {
                        let what = format!(
                            "not started again, because it ended {STARTS} times before any answer"
                        );
                        let reason = ended.describe(&what);
                        state.given_up = Some(reason.clone());
                        return Err(self.failure(reason));
                    }
                    return Err(self.failure(ended.describe("ended before it answered")));
                }
                Err(Trouble::Silent) => {
                    let secs = self.timeout.as_secs_f64();
                    format!("no answer within {secs} s (timeout=), so it was stopped")
                }
                Err(Trouble::Garbage(text)) => text,
            };
            return Err(self.failure(process.kill().describe(&trouble)));
        }
    }
}

/// Warnings about files in the command line whose changes may go unnoticed.
fn notes_of(files: &NamedFiles) -> Vec<String> {
    let absent = files.absent.iter().map(|word| {
        format!(
            "its command line names {word}, which looks like a file but does not exist; if the program reads it, \
             name it with files=PATTERN, so that results are recomputed when it changes"
        )
    });
    let unseen = files.unseen.iter().map(|word| {
        format!(
            "its command line names {word}, which may stand for files that are not hashed; list them with \
             files=PATTERN, so that results are recomputed when they change"
        )
    });
    absent.chain(unseen).collect()
}

/// The files that match a pattern, searched for below the pattern's longest prefix without wildcards.
fn matching(pattern: &str) -> Result<Vec<PathBuf>, String> {
    let matcher = globset::GlobBuilder::new(pattern)
        .literal_separator(true)
        .build();
    let matcher = matcher
        .map_err(|error| format!("files={pattern}: {error}"))?
        .compile_matcher();
    let is_plain = |part: &&Component<'_>| {
        !part
            .as_os_str()
            .to_string_lossy()
            .contains(['*', '?', '[', '{'])
    };
    let parts: Vec<Component<'_>> = Path::new(pattern).components().collect();
    let root: PathBuf = parts.iter().take_while(is_plain).collect();
    let mut found = Vec::new();
    let mut open = vec![root];
    while let Some(path) = open.pop() {
        if path.is_file() {
            found.extend(matcher.is_match(&path).then_some(path));
            continue;
        }
        let folder = if path.as_os_str().is_empty() {
            Path::new(".")
        } else {
            &path
        };
        let entries = std::fs::read_dir(folder)
            .map_err(|error| format!("files={pattern}: {}: {error}", folder.display()))?;
        for entry in entries.flatten() {
            // Do not follow links to folders, which could form a cycle.
            if entry.file_type().is_ok_and(|kind| !kind.is_symlink()) || entry.path().is_file() {
                open.push(path.join(entry.file_name()));
            }
        }
    }
    if found.is_empty() {
        Err(format!("files={pattern}: no file matches"))
    } else {
        Ok(found)
    }
}

impl State {
    /// Writes the source's picture and depth into a scratch folder, unless they are already there.
    fn source_files(
        &mut self,
        source: &SourceView,
        scratch_in: &Path,
    ) -> Result<SourceFiles, MethodError> {
        if self.scratch.is_none() {
            let made = scratch_folder(scratch_in);
            self.scratch = Some(made.map_err(|error| MethodError::file(scratch_in, error))?);
        }
        let folder = self.scratch.as_ref().map_or(scratch_in, TempDir::path);
        let files = SourceFiles {
            picture: folder.join("source.png"),
            depth: source.depth().map(|_| folder.join("source_depth.npy")),
        };
        let depth = source.depth().map(npy::to_bytes);
        let mut hash = StableHasher::default();
        hash.add("size", &format!("{:?}", source.image().dimensions()))
            .add("picture", &sha256_hex(source.image().as_raw()))
            .add("depth", &sha256_hex(depth.as_deref().unwrap_or_default()));
        let hash = hash.finish();
        let stamps = || {
            let paths = [Some(&files.picture), files.depth.as_ref()].into_iter();
            paths
                .flatten()
                .map(|path| FileStamp::of(path).ok())
                .collect()
        };
        // Write the source's files again if the source changed or the program modified them.
        if self.source.as_ref() != Some(&(hash.clone(), stamps())) {
            let written = write_png(&files.picture, source.image());
            written.map_err(|error| MethodError::file(&files.picture, error))?;
            if let (Some(path), Some(bytes)) = (&files.depth, depth) {
                std::fs::write(path, bytes).map_err(|error| MethodError::file(path, error))?;
            }
            self.source = Some((hash, stamps()));
        }
        Ok(files)
    }
}

impl Method for Command {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        let mut settings = self.fit.settings();
        settings.insert("run".to_owned(), self.run.clone());
        settings.insert("version".to_owned(), self.version.clone());
        if !self.files.is_empty() {
            let mut hash = StableHasher::default();
            // Hash only contents, in sorted order, so that the files' names and locations do not matter.
            let mut hashes: Vec<&str> = self.files.iter().map(HashedFile::sha256).collect();
            hashes.sort_unstable();
            for one in hashes {
                hash.add("file", one);
            }
            let mut hash = hash.finish();
            hash.truncate(16);
            settings.insert("content".to_owned(), hash);
        }
        MethodIdentity {
            kind: "command".to_owned(),
            settings,
        }
    }

    fn sources(&self) -> &'static str {
        fingerprints::COMMAND
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn begin(&self, logs: &Path, scratch_in: &Path) {
        // Only the first call has an effect: if this instance is used in a second run, it continues the first run's
        // log.
        let log = logs.join(format!("{}.log", self.label));
        let _ = self.places.set((log, scratch_in.to_owned()));
    }

    fn privilege(&self) -> Privilege {
        Privilege::of_depth(self.depth)
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Pictures(self)
    }
}

impl PredictPicture for Command {
    fn predict(
        &self,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError> {
        self.request(None, source, target)
    }
}

impl PredictAtScale for Command {
    fn predict_at(
        &self,
        (_, scale): &Scale,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError> {
        self.request(Some(*scale), source, target)
    }
}

impl Command {
    /// Requests a prediction and reads its picture.
    fn request(
        &self,
        scale: Option<f64>,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError> {
        let region = self.fit.region(target.size(), None, None);
        let region = region.map_err(|reason| self.failure(reason))?;
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if self.depth == TrueDepth::SourceDepth && source.depth().is_none() {
            let reason = "the source view has no depth, which depth=privileged needs";
            return Err(self.failure(reason));
        }
        let elsewhere = std::env::temp_dir();
        let scratch_in = self.places.get().map_or(&elsewhere, |(_, folder)| folder);
        let files = state.source_files(source, scratch_in)?;
        let write_to = files.picture.with_file_name("prediction.png");
        // A file left by an earlier pair could be mistaken for this pair's picture.
        if let Err(error) = std::fs::remove_file(&write_to)
            && error.kind() != std::io::ErrorKind::NotFound
        {
            return Err(MethodError::file(&write_to, error));
        }
        let request = PairRequest::new(source, target, &files, scale, &write_to);
        let answer = self.ask(&mut state, &request)?;
        if let Some(reason) = answer.error {
            return Err(self.failure(format!("the program says: {reason}")));
        }
        if let Some(file) = self.files.iter().find(|file| !file.is_unchanged()) {
            return Err(MethodError::file(file.path(), "it changed during the run"));
        }
        let path = answer.picture.unwrap_or(write_to);
        let mut prediction = self.fit.read(&path, region, target.size())?;
        prediction.extras = answer.extras;
        Ok(prediction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_are_checked() {
        for (text, part) in [
            ("command", "needs run="),
            ("command:run=' '", "needs run="),
            ("command:run=x,timeout=0", "seconds"),
            ("command:run=x,timeout=soon", "seconds"),
            ("command:run=x,crop=sidecar", "crop=x:y:w:h"),
            ("command:run=x,resize=cubic", "cubic"),
            ("command:run=x,cwd=nowhere", "cwd=nowhere is not a folder"),
        ] {
            let spec: MethodSpec = text.parse().unwrap();
            let error = Command::from_spec(&spec).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
        let spec: MethodSpec = "command:run='a b',version=2".parse().unwrap();
        let command = Command::from_spec(&spec).unwrap();
        assert_eq!(command.identity().to_string(), "command(run=a b,version=2)");
        assert_eq!(command.timeout, Duration::from_secs(600));
    }

    #[test]
    fn files_of_the_command_line_are_part_of_the_identity() {
        let dir = tempfile::tempdir().unwrap();
        let script = dir.path().join("my.py");
        std::fs::write(&script, "x").unwrap();
        let text = format!("command:run='python3 {} --fast'", script.display());
        let content = |command: &Command| command.identity().settings["content"].clone();
        let before = content(&Command::from_spec(&text.parse().unwrap()).unwrap());
        std::fs::write(&script, "y").unwrap();
        let after = content(&Command::from_spec(&text.parse().unwrap()).unwrap());
        assert_ne!(before, after);
        let more = dir.path().join("weights/a/w.bin");
        std::fs::create_dir_all(more.parent().unwrap()).unwrap();
        std::fs::write(&more, "x").unwrap();
        let with = |pattern: &str| {
            Command::from_spec(
                &format!("{text},files='{}/{pattern}'", dir.path().display())
                    .parse()
                    .unwrap(),
            )
        };
        let command = with("weights/**/*.bin").unwrap();
        assert_ne!(content(&command), after);
        // A folder in the command line causes a warning unless its files are listed in `files=`.
        let text = format!("{text},run='x {}/weights/a'", dir.path().display());
        let text = text.replace(&format!("run='python3 {} --fast',", script.display()), "");
        let command = Command::from_spec(&text.parse().unwrap()).unwrap();
        assert_eq!(command.notes().len(), 1, "{:?}", command.notes());
        let text = format!("{text},files='{}/weights/a/*'", dir.path().display());
        let command = Command::from_spec(&text.parse().unwrap()).unwrap();
        assert_eq!(command.notes(), Vec::<String>::new());
        let error = with("*.none").unwrap_err().to_string();
        assert!(error.contains("no file matches"), "{error}");
    }
}
