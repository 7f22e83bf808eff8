//! The process of a method: started by the shell, queried line by line, and always terminated.
//!
//! Written by hand, because crates for process groups (`process-wrap`) only wrap std's `process_group`. They offer
//! neither deadlines for lines nor a way to kill the program if this process is killed.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::log::ProgramLog;
use super::protocol::{VERSION, excerpt, no_answer};

/// Maximum length of an answer line, in bytes.
const LONGEST_LINE: u64 = 1 << 20;

/// Maximum number of unread answer lines. A program that writes more is blocked until a line is read.
const LINES_AHEAD: usize = 2;

/// How long a program may run after its input is closed.
const GRACE: Duration = Duration::from_secs(5);

/// How long to wait for the remaining output of a program that exited.
const LAST_OUTPUT: Duration = Duration::from_millis(500);

/// Polling interval while waiting for an answer; needed because a program may exit while its child
/// keeps the pipe open.
const LOOK: Duration = Duration::from_millis(50);

#[derive(Debug, PartialEq, Eq)]
pub(super) enum Trouble {
    Ended,
    Silent,
    Garbage(String),
}

#[derive(Debug)]
enum Heard {
    Line(String),
    TooLong,
    NotText,
}

#[derive(Debug)]
pub(super) struct Process {
    child: Child,
    #[cfg(unix)]
    watchdog: Child,
    stdin: Option<ChildStdin>,
    heard: Receiver<Heard>,
    /// The last non-empty line of the program's standard error.
    last_error_line: Arc<Mutex<String>>,
    stderr: Option<JoinHandle<()>>,
}

#[derive(Debug)]
pub(super) struct Ended {
    status: Option<ExitStatus>,
    last_error_line: String,
}

impl Ended {
    /// Whether the program exited by itself with code 0.
    pub(super) fn succeeded(&self) -> bool {
        self.status.is_some_and(|status| status.success())
    }

    /// One line: what happened (`what`), the exit status, and the last line of standard error.
    pub(super) fn describe(&self, what: &str) -> String {
        let mut text = what.to_owned();
        if let Some(status) = self.status {
            text += &format!(" ({status})");
        }
        if !self.last_error_line.is_empty() {
            text += &format!("; its last output: {}", excerpt(&self.last_error_line));
        }
        text
    }
}

impl Process {
    /// Starts a command line through the shell and appends its standard error to a log. Errors do not name the method.
    pub(super) fn start(
        run: &str,
        folder: &Path,
        log: Option<Arc<Mutex<ProgramLog>>>,
    ) -> Result<Self, String> {
        write_to(log.as_deref(), format!("== started: {run}\n").as_bytes());
        let (say, heard) = sync_channel(LINES_AHEAD);
        let mut command = shell(run);
        if !folder.as_os_str().is_empty() {
            command.current_dir(folder);
        }
        let mut child = command
            .spawn()
            .map_err(|error| format!("cannot start a shell: {error}"))?;
        #[cfg(unix)]
        let watchdog = match watchdog(child.id()) {
            Ok(watchdog) => watchdog,
            Err(error) => {
                kill_group(&mut child);
                return Err(format!("cannot start a shell: {error}"));
            }
        };
        if let Some(stdout) = child.stdout.take() {
            thread::spawn(move || listen(stdout, &say));
        }
        let last_error_line = Arc::new(Mutex::new(String::new()));
        let stderr = child.stderr.take().map(|stderr| {
            let last_error_line = Arc::clone(&last_error_line);
            thread::spawn(move || copy_stderr(stderr, log.as_deref(), &last_error_line))
        });
        Ok(Self {
            stdin: child.stdin.take(),
            child,
            #[cfg(unix)]
            watchdog,
            heard,
            last_error_line,
            stderr,
        })
    }

    /// Sends a line and waits for an answer line.
    pub(super) fn ask(&mut self, line: &str, timeout: Duration) -> Result<String, Trouble> {
        match self.heard.try_recv() {
            Ok(heard) => return Err(unasked(&heard)),
            Err(TryRecvError::Disconnected) => return Err(Trouble::Ended),
            Err(TryRecvError::Empty) => {}
        }
        let Some(stdin) = self.stdin.as_mut() else {
            return Err(Trouble::Ended);
        };
        let sent = stdin
            .write_all(line.as_bytes())
            .and_then(|()| stdin.flush());
        if sent.is_err() {
            return Err(Trouble::Ended);
        }
        let mut deadline = Instant::now() + timeout;
        let mut has_ended = false;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.heard.recv_timeout(left.min(LOOK)) {
                Ok(Heard::Line(text)) => return Ok(text),
                Ok(heard) => return Err(unasked(&heard)),
                Err(RecvTimeoutError::Disconnected) => return Err(Trouble::Ended),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if !has_ended && self.has_ended() {
                has_ended = true;
                deadline = deadline.min(Instant::now() + LAST_OUTPUT);
            }
            if Instant::now() >= deadline {
                return Err(if has_ended {
                    Trouble::Ended
                } else {
                    Trouble::Silent
                });
            }
        }
    }

    /// Whether the program has exited. Leaves an exited program as a zombie, so that its id, which is also the id of
    /// its group, is not reused.
    fn has_ended(&mut self) -> bool {
        #[cfg(unix)]
        {
            // SAFETY: `siginfo_t` is a plain C struct, for which all zeros is a valid value.
            let mut info: libc::siginfo_t = unsafe { std::mem::zeroed() };
            let how = libc::WEXITED | libc::WNOHANG | libc::WNOWAIT;
            // SAFETY: the call writes only to `info`, which outlives it.
            let result = unsafe { libc::waitid(libc::P_PID, self.child.id(), &raw mut info, how) };
            // SAFETY: every variant of the union has this field; it is 0 while the child has not exited.
            result != 0 || unsafe { info.si_pid() } != 0
        }
        #[cfg(not(unix))]
        matches!(self.child.try_wait(), Ok(Some(_)))
    }

    /// Closes the program's input and kills the program if it is still running after [`GRACE`].
    pub(super) fn stop(mut self) -> Ended {
        self.end(GRACE)
    }

    pub(super) fn kill(mut self) -> Ended {
        self.end(Duration::ZERO)
    }

    fn end(&mut self, grace: Duration) -> Ended {
        // With a grace of zero, keep the program's input open: the program could react to the end of its input before
        // it is killed.
        if !grace.is_zero() {
            self.stdin = None;
        }
        let deadline = Instant::now() + grace;
        let mut has_ended = self.has_ended();
        while !has_ended && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(5));
            has_ended = self.has_ended();
        }
        // Even if the program exited by itself, its child processes may still run.
        kill_group(&mut self.child);
        let status = self.child.wait().ok();
        // Report the exit status only if the program exited by itself.
        let status = status.filter(|_| has_ended);
        #[cfg(unix)]
        dismiss(&mut self.watchdog);
        if let Some(stderr) = self.stderr.take() {
            let deadline = Instant::now() + LAST_OUTPUT;
            while !stderr.is_finished() && Instant::now() < deadline {
                thread::sleep(Duration::from_millis(5));
            }
        }
        let last_error_line = self.last_error_line.lock();
        Ended {
            status,
            last_error_line: last_error_line
                .unwrap_or_else(PoisonError::into_inner)
                .clone(),
        }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // `end` takes `stderr`; if it is still present, the process has not been ended yet.
        if self.stderr.is_some() {
            self.end(GRACE);
        }
    }
}

fn unasked(heard: &Heard) -> Trouble {
    Trouble::Garbage(match heard {
        Heard::Line(text) => no_answer(text),
        Heard::TooLong => format!("it wrote a line longer than {LONGEST_LINE} bytes"),
        Heard::NotText => "it wrote bytes that are not UTF-8".to_owned(),
    })
}

fn shell(run: &str) -> Command {
    let mut command = if cfg!(windows) {
        let mut command = Command::new("cmd");
        command.args(["/C", run]);
        command
    } else {
        let mut command = Command::new("sh");
        command.args(["-c", run]);
        command
    };
    command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .env("SHARP_BENCH_PROTOCOL", VERSION.to_string());
    #[cfg(unix)]
    {
        // Start the program in its own process group, so that its children can be terminated with it.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
    }
    command
}

/// Starts a shell that watches this process by waiting for a line on standard input. If this process dies, the input
/// ends without a line, and the shell kills the process group `group`.
#[cfg(unix)]
fn watchdog(group: u32) -> io::Result<Child> {
    use std::os::unix::process::CommandExt;
    Command::new("sh")
        .args(["-c", "read -r _ || kill -s KILL -- \"-$0\""])
        .arg(group.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        // In a group of its own, the watchdog survives signals that the terminal sends to this process.
        .process_group(0)
        .spawn()
}

#[cfg(unix)]
fn dismiss(watchdog: &mut Child) {
    if let Some(mut stdin) = watchdog.stdin.take() {
        let _ = stdin.write_all(b"done\n");
    }
    let _ = watchdog.wait();
}

/// Kills the program and everything it started.
fn kill_group(child: &mut Child) {
    #[cfg(unix)]
    if let Ok(group) = libc::pid_t::try_from(child.id()) {
        // SAFETY: a system call without pointers. The child has not been waited for, so its id, which is also that of
        // its group, cannot have been reused.
        unsafe { libc::kill(-group, libc::SIGKILL) };
    }
    // In case there are no process groups, or the program left its group.
    let _ = child.kill();
}

/// Forwards lines until the output ends or the receiver is gone.
fn listen(stdout: ChildStdout, say: &SyncSender<Heard>) {
    let mut stdout = BufReader::new(stdout);
    loop {
        let mut line = Vec::new();
        let read = (&mut stdout)
            .take(LONGEST_LINE)
            .read_until(b'\n', &mut line);
        let heard = match read {
            Err(_) | Ok(0) => return,
            Ok(n) if n as u64 == LONGEST_LINE => Heard::TooLong,
            Ok(_) => match String::from_utf8(line) {
                Ok(text) => Heard::Line(text.trim_end().to_owned()),
                Err(_) => Heard::NotText,
            },
        };
        if say.send(heard).is_err() {
            return;
        }
    }
}

/// Appends to the log, ignoring errors: a full disk must not stop the program.
fn write_to(log: Option<&Mutex<ProgramLog>>, bytes: &[u8]) {
    if let Some(log) = log {
        let mut log = log.lock().unwrap_or_else(PoisonError::into_inner);
        let _ = log.write(bytes);
    }
}

fn copy_stderr(
    mut stderr: impl Read,
    log: Option<&Mutex<ProgramLog>>,
    last_error_line: &Mutex<String>,
) {
    const RECENT: usize = 4096;
    let mut buffer = vec![0; 1 << 16];
    let mut recent = Vec::new();
    loop {
        let read = match stderr.read(&mut buffer) {
            Err(_) | Ok(0) => return,
            Ok(read) => &buffer[..read],
        };
        write_to(log, read);
        recent.extend_from_slice(&read[read.len().saturating_sub(RECENT)..]);
        recent.drain(..recent.len().saturating_sub(RECENT));
        let text = String::from_utf8_lossy(&recent);
        let mut lines = text.lines().rev().map(str::trim);
        if let Some(line) = lines.find(|line| !line.is_empty()) {
            line.clone_into(
                &mut last_error_line
                    .lock()
                    .unwrap_or_else(PoisonError::into_inner),
            );
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    const SOON: Duration = Duration::from_secs(20);

    #[test]
    fn a_line_for_a_line() {
        let mut process = Process::start(
            "while read x; do echo \"got $x\"; done",
            Path::new(""),
            None,
        )
        .unwrap();
        assert_eq!(process.ask("one\n", SOON), Ok("got one".to_owned()));
        assert_eq!(process.ask("two\n", SOON), Ok("got two".to_owned()));
        let ended = process.stop();
        assert!(ended.status.unwrap().success());
    }

    #[test]
    fn crashes_silence_and_noise_are_told_apart() {
        let mut crash =
            Process::start("read x; echo why >&2; exit 3", Path::new(""), None).unwrap();
        assert_eq!(crash.ask("x\n", SOON), Err(Trouble::Ended));
        let told = crash.stop().describe("ended");
        assert!(told.contains("exit status: 3"), "{told}");
        assert!(told.contains("why"), "{told}");

        let mut silent = Process::start("sleep 1000", Path::new(""), None).unwrap();
        let short = Duration::from_millis(50);
        assert_eq!(silent.ask("x\n", short), Err(Trouble::Silent));
        assert!(silent.kill().status.is_none());

        let mut noisy = Process::start("echo hello; cat", Path::new(""), None).unwrap();
        while noisy.heard.try_recv().is_err() {
            thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(noisy.ask("x\n", SOON), Ok("x".to_owned()));
        let mut chatty =
            Process::start("read x; echo a; echo b; cat", Path::new(""), None).unwrap();
        assert_eq!(chatty.ask("x\n", SOON), Ok("a".to_owned()));
        thread::sleep(Duration::from_millis(200));
        assert!(matches!(chatty.ask("y\n", SOON), Err(Trouble::Garbage(_))));
    }

    #[test]
    fn what_it_started_ends_with_it() {
        let dir = tempfile::tempdir().unwrap();
        let mark = dir.path().join("mark");
        // A grandchild that would create a file later.
        let run = format!("(sleep 1; touch {}) & echo x; wait", mark.display());
        let mut process = Process::start(&run, Path::new(""), None).unwrap();
        while process.heard.try_recv().is_err() {
            thread::sleep(Duration::from_millis(5));
        }
        let _ = process.ask("x\n", Duration::from_millis(10));
        process.kill();
        thread::sleep(Duration::from_millis(1500));
        assert!(!mark.exists());
    }

    #[test]
    fn children_of_a_program_that_ended_by_itself_end_too() {
        let dir = tempfile::tempdir().unwrap();
        let pid = dir.path().join("pid");
        // The child keeps the output open, and the program exits without an answer.
        let run = format!("sleep 1000 & echo $! > {}; read x", pid.display());
        let mut process = Process::start(&run, Path::new(""), None).unwrap();
        assert_eq!(
            process.ask("x\n", Duration::from_secs(1000)),
            Err(Trouble::Ended)
        );
        assert!(process.stop().succeeded());
        let child = std::fs::read_to_string(&pid).unwrap();
        let is_alive = || {
            let state = std::fs::read_to_string(format!("/proc/{}/stat", child.trim()));
            state.is_ok_and(|state| !state.contains(") Z "))
        };
        let deadline = Instant::now() + SOON;
        while is_alive() && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(5));
        }
        assert!(!is_alive());
    }

    #[test]
    fn standard_error_goes_into_the_log() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("logs/mine.log");
        let log = Arc::new(Mutex::new(ProgramLog::open(&path).unwrap()));
        for word in ["one", "two"] {
            let run = format!("echo {word} >&2; cat");
            let mut process = Process::start(&run, Path::new(""), Some(Arc::clone(&log))).unwrap();
            assert_eq!(process.ask("x\n", SOON), Ok("x".to_owned()));
            process.stop();
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 4, "{text}");
        assert_eq!((lines[1], lines[3]), ("one", "two"));
    }
}
