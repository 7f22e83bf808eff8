//! Runs that are killed, starved and disturbed: in all cases, the scores equal those of an
//! undisturbed run. If a test needs something that a machine may lack (a small disk of its own,
//! Slurm), it is reported as ignored, by name.
//!
//! `SHARP_BENCH_KILLS=N` kills N times instead of 10; `SHARP_BENCH_SOAK=MINUTES` also disturbs one
//! run for that long.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "test code outside of #[test] functions"
)]

mod memory;
mod slurm;
#[allow(dead_code, reason = "shared with the other tests of the binary")]
mod support;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant, SystemTime};

use libtest_mimic::{Arguments, Trial};
use sharp_tests::copy_folder;
use support::sharp_bench;

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let trial = |name: &str, test: fn()| {
        Trial::test(name, move || {
            test();
            Ok(())
        })
    };
    let trials = vec![
        trial("kills at random moments, under changing shards", kills),
        trial("kills and errors at exact system calls", at_system_calls)
            .with_ignored_flag(!has_strace()),
        trial("spoilt units, other clocks and a second process", disturbed),
        trial("an input that vanishes and comes back", vanished_input),
        trial(
            "signals and time budgets end after the unit at hand",
            stopped,
        ),
        trial("pictures by some shards, scores by others", stages),
        trial(
            "a plan runs what it was planned with, and nothing else",
            planned,
        ),
        trial("memory stays within its limit", memory::limit)
            .with_ignored_flag(memory::peak_bytes(std::process::id()).is_none()),
        trial("memory does not grow over a long run", memory::soak)
            .with_ignored_flag(memory::minutes().is_none()),
        trial("a disk that is full, then has room", full_disk).with_ignored_flag(!can_mount()),
        trial("a folder that cannot be written", read_only).with_ignored_flag(!can_mount()),
        trial("Slurm, with a node that dies", slurm::survives_a_dead_node)
            .with_ignored_flag(!slurm::is_there()),
    ];
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// 24 pairs and three methods.
const WHAT: [&str; 11] = [
    "--dataset",
    "S:synthetic=size=96x72,views=20",
    "--method",
    "target",
    "--method",
    "copy",
    "--method",
    "depth-splat:resolution=256",
    "--metrics",
    "psnr,ssim-gauss11-valid",
    "--limit=24",
];

pub(crate) fn run(folder: &Path, args: &[&str]) -> support::Said {
    sharp_bench(folder, &[&["run"], args].concat())
}

/// The scores of an undisturbed run, and a plan of the same evaluation.
pub(crate) fn undisturbed(folder: &Path) -> Vec<u8> {
    run(folder, &[&WHAT[..], &["--out", "alone"]].concat()).ends_with(0);
    run(
        folder,
        &[&WHAT[..], &["--plan-only", "--out", "P"]].concat(),
    )
    .ends_with(0);
    fs::read(folder.join("alone/scores.csv")).unwrap()
}

fn shard(folder: &Path, shard: &str) -> support::Said {
    run(folder, &["--plan", "P", "--shard", shard])
}

/// Starts a shard of the plan in the background.
pub(crate) fn start(folder: &Path, shard: &str, more: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .args(["run", "--plan", "P", "--shard", shard])
        .args(more)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Sends a signal; false if the process had already ended.
pub(crate) fn send(signal: &str, child: &Child) -> bool {
    Command::new("kill")
        .args(["-s", signal, &child.id().to_string()])
        .status()
        .unwrap()
        .success()
}

/// The scores after merging the plan.
pub(crate) fn merged(folder: &Path) -> Vec<u8> {
    sharp_bench(folder, &["merge", "P"]).ends_with(0);
    fs::read(folder.join("P/scores.csv")).unwrap()
}

/// Reproducible pseudorandom numbers.
pub(crate) fn random(state: &mut u64, below: u64) -> u64 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) % below
}

pub(crate) fn unit_files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder.join("P/units"))
        .into_iter()
        .flatten()
        .flat_map(|entry| fs::read_dir(entry.unwrap().path()).unwrap())
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}

fn kills() {
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    let kills = std::env::var("SHARP_BENCH_KILLS").map_or(10, |n| n.parse().unwrap());
    let mut seed = 7;
    let mut killed = 0;
    let mut last = (0, 0);
    for attempt in 0..100 * kills {
        let count = [1, 3, 7][random(&mut seed, 3) as usize];
        let index = 1 + random(&mut seed, count);
        let mut child = start(dir.path(), &format!("{index}/{count}"), &[]);
        // Up to a second: from before the first unit until after the last of a small shard.
        std::thread::sleep(Duration::from_millis(random(&mut seed, 1000)));
        if child.try_wait().unwrap().is_none() {
            child.kill().unwrap();
            killed += 1;
        }
        child.wait().unwrap();
        last = (killed, attempt);
        if killed == kills {
            break;
        }
        // If everything is finished, start again, so that there is something to kill.
        if unit_files(dir.path()).len() == 72 {
            let _ = fs::remove_dir_all(dir.path().join("P/units"));
        }
    }
    assert_eq!(
        last.0, kills,
        "killed {} times in {} attempts",
        last.0, last.1
    );
    for index in 1..=3 {
        shard(dir.path(), &format!("{index}/3")).ends_with(0);
    }
    assert!(merged(dir.path()) == expected);
    // The next process that has the folder to itself removes the files left by the killed ones.
    run(dir.path(), &[&WHAT[..], &["--out", "P"]].concat()).ends_with(0);
    let left = walk(&dir.path().join("P"));
    let left: Vec<_> = left
        .iter()
        .filter(|name| name.contains("/.partial") || name.contains("/.scratch"))
        .collect();
    assert!(left.is_empty(), "{left:?}");
    assert!(fs::read(dir.path().join("P/scores.csv")).unwrap() == expected);
}

fn walk(folder: &Path) -> Vec<String> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        all.push(path.display().to_string());
        if path.is_dir() {
            all.extend(walk(&path));
        }
    }
    all
}

fn disturbed() {
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    // Two processes for one shard, and one for another.
    let mut children = ["1/2", "1/2", "2/2"].map(|shard| start(dir.path(), shard, &[]));
    for child in &mut children {
        assert!(child.wait().unwrap().success());
    }
    let files = unit_files(dir.path());
    assert_eq!(files.len(), 72);
    for (i, file) in files.iter().enumerate() {
        // Clocks that are wrong in both directions.
        let time = match i % 2 {
            0 => SystemTime::UNIX_EPOCH + Duration::from_secs(1),
            _ => SystemTime::now() + Duration::from_secs(400_000_000),
        };
        fs::File::options()
            .write(true)
            .open(file)
            .unwrap()
            .set_modified(time)
            .unwrap();
        let text = fs::read(file).unwrap();
        match i {
            // Change a digit, the end or everything, or write another unit's content.
            3 => {
                let text = String::from_utf8(text).unwrap();
                let at = text.find("\"baseline_m\": 0.").unwrap() + 16;
                let digit = if &text[at..=at] == "1" { "2" } else { "1" };
                fs::write(file, format!("{}{digit}{}", &text[..at], &text[at + 1..])).unwrap();
            }
            10 => fs::write(file, &text[..text.len() / 2]).unwrap(),
            17 => fs::write(file, "").unwrap(),
            24 => fs::write(file, fs::read(&files[25]).unwrap()).unwrap(),
            _ => {}
        }
    }
    let status = sharp_bench(dir.path(), &["status", "P", "--json"])
        .ends_with(75)
        .json();
    assert_eq!(
        (&status["damaged"], &status["all"]["missing"]),
        (&4.into(), &4.into())
    );
    sharp_bench(dir.path(), &["merge", "P"]).ends_with(75);
    assert!(!plan_file(dir.path(), "scores.csv").exists());
    let said = sharp_bench(dir.path(), &["status", "P", "--unfinished-shards", "12"]).ends_with(0);
    let unfinished = said.out.trim().split(',').count();
    assert!((1..=4).contains(&unfinished), "{}", said.out);
    for index in 1..=3 {
        shard(dir.path(), &format!("{index}/3")).ends_with(0);
    }
    let none = sharp_bench(dir.path(), &["status", "P", "--unfinished-shards", "12"]).ends_with(0);
    assert_eq!(none.out.trim(), "");
    assert!(merged(dir.path()) == expected);
}

fn vanished_input() {
    let dir = tempfile::tempdir().unwrap();
    undisturbed(dir.path());
    let imported = ["--method", "imported:label=mine,dir=there"];
    fs::rename(
        dir.path().join("alone/predictions/copy"),
        dir.path().join("there"),
    )
    .unwrap();
    run(
        dir.path(),
        &[&WHAT[..], &imported, &["--out", "all"]].concat(),
    )
    .ends_with(0);
    let expected = fs::read(dir.path().join("all/scores.csv")).unwrap();
    run(
        dir.path(),
        &[&WHAT[..], &imported, &["--plan-only", "--out", "Q"]].concat(),
    )
    .ends_with(0);
    fs::rename(dir.path().join("there/S"), dir.path().join("gone")).unwrap();
    let on_plan = |shard: &str| run(dir.path(), &["--plan", "Q", "--shard", shard]);
    for shard in ["1/2", "2/2"] {
        on_plan(shard).ends_with(4);
    }
    let failed = sharp_bench(dir.path(), &["merge", "Q", "--json"])
        .ends_with(4)
        .json();
    assert_eq!(
        (&failed["failed"], &failed["missing"]),
        (&24.into(), &0.into())
    );
    fs::rename(dir.path().join("gone"), dir.path().join("there/S")).unwrap();
    // Failures count as results unless a retry is requested; a shard always retries them.
    let unfinished = |more: &[&str]| {
        let args = [&["status", "Q", "--unfinished-shards", "2"], more].concat();
        sharp_bench(dir.path(), &args)
            .ends_with(0)
            .out
            .trim()
            .to_owned()
    };
    assert_eq!(
        (unfinished(&[]), unfinished(&["--retry-failed"])),
        (String::new(), "1-2".to_owned())
    );
    for shard in ["1/3", "2/3", "3/3"] {
        on_plan(shard).ends_with(0);
    }
    sharp_bench(dir.path(), &["merge", "Q"]).ends_with(0);
    assert!(fs::read(dir.path().join("Q/scores.csv")).unwrap() == expected);
}

/// A command that is disturbed at a system call and then repeated undisturbed: wherever the
/// disturbance occurs, it ends successfully and leaves no partial file.
fn at_system_calls() {
    const RUN: &str = "run --quiet --no-cache --dataset synthetic=views=3,size=64x48 --method copy --metrics psnr --out";
    let dir = tempfile::tempdir().unwrap();
    let left_alone = |line: &str| {
        let args: Vec<&str> = line.split(' ').collect();
        sharp_bench(dir.path(), &args).ends_with(0);
    };
    let disturbed = |call: &str, how: &str, line: &str| {
        let injected = format!("inject={call}:{how}");
        let mut strace = Command::new("strace");
        strace.args([
            "-f",
            "-qq",
            "-o",
            "/dev/null",
            "-e",
            &format!("trace={call}"),
        ]);
        strace.args(["-e", &injected, env!("CARGO_BIN_EXE_sharp-bench")]);
        strace.args(line.split(' ')).current_dir(dir.path());
        strace.stdout(Stdio::null()).stderr(Stdio::null());
        strace.status().unwrap();
        left_alone(line);
        let mut open = vec![dir.path().to_owned()];
        while let Some(folder) = open.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let entry = entry.unwrap();
                let name = entry.file_name().into_string().unwrap();
                assert!(
                    !name.starts_with(".partial"),
                    "{name} after {how} at {call} of {line}"
                );
                if entry.file_type().unwrap().is_dir() {
                    open.push(entry.path());
                }
            }
        }
    };
    left_alone(&format!("{RUN} a"));
    let expected = fs::read(dir.path().join("a/scores.csv")).unwrap();
    let is_whole = |run: &str| {
        let found = fs::read(dir.path().join(run).join("scores.csv")).unwrap();
        assert!(found == expected, "{run}");
    };
    for at in 1..=6 {
        disturbed(
            "renameat",
            &format!("signal=KILL:when={at}"),
            &format!("{RUN} r{at}"),
        );
        is_whole(&format!("r{at}"));
    }
    for (n, how) in ["signal=KILL", "error=EIO", "error=ENOSPC"]
        .iter()
        .enumerate()
    {
        disturbed(
            "fsync",
            &format!("{how}:when=1"),
            &format!("merge a --out m{n}"),
        );
        is_whole(&format!("m{n}"));
    }
    let config = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../tests/golden/model/tiny_config.json"
    );
    let stage = "steps = 1\nbatch = 1\nside = 192\nschedule = { peak = 1e-3, last = 1e-4, warmup_steps = 0 }\n";
    let training = format!(
        "network.file = \"{config}#tiny\"\nlosses.percep = 0.0\n[stage1]\n{stage}[stage2]\n{stage}[intervals]\n\
         validation = 1\ncheckpoint = 1\n"
    );
    fs::write(dir.path().join("t.toml"), training).unwrap();
    for (call, line) in [
        ("renameat", "report a --quiet"),
        (
            "renameat",
            "cameras export --dataset synthetic=views=3,size=64x48 --out e",
        ),
        ("fsync", "bundle a --out b.zip"),
        ("fsync", "history add h a --label x --date 2026-01-01"),
        (
            "renameat",
            "train t.toml --out t --validation synthetic=size=64x48,views=20 --validation-pairs 1 --metrics psnr --quiet",
        ),
    ] {
        disturbed(call, "signal=KILL:when=1", line);
    }
}

fn has_strace() -> bool {
    let probe = Command::new("strace")
        .args(["-f", "-o", "/dev/null", "true"])
        .status();
    probe.is_ok_and(|status| status.success())
}

fn stopped() {
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    run(
        dir.path(),
        &["--plan", "P", "--shard", "1/1", "--time-budget", "0s"],
    )
    .ends_with(75);
    assert!(unit_files(dir.path()).is_empty());
    let mut ended_early = 0;
    for signal in ["TERM", "USR1", "TERM", "USR1"] {
        let mut child = start(dir.path(), "1/1", &["--threads", "1"]);
        let before = unit_files(dir.path()).len();
        let patience = Instant::now() + Duration::from_secs(60);
        while unit_files(dir.path()).len() < before + 3 && Instant::now() < patience {
            if child.try_wait().unwrap().is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let sent = send(signal, &child);
        let code = child.wait().unwrap().code();
        // Any other exit code would mean that the signal killed the process.
        assert!(matches!(code, Some(75 | 0)), "{signal}: {code:?}");
        ended_early += usize::from(sent && code == Some(75));
    }
    assert!(ended_early >= 1);
    // A plain run behaves the same, and leaves no table that looks complete.
    let budget = [&WHAT[..], &["--out", "plain", "--time-budget", "0s"]].concat();
    run(dir.path(), &budget).ends_with(75);
    assert!(!dir.path().join("plain/scores.csv").exists());
    run(dir.path(), &[&WHAT[..], &["--out", "plain"]].concat()).ends_with(0);
    assert!(fs::read(dir.path().join("plain/scores.csv")).unwrap() == expected);
    shard(dir.path(), "1/1").ends_with(0);
    assert!(merged(dir.path()) == expected);
}

fn planned() {
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    // From another folder: the plan's paths are relative to the folder where it was made.
    let elsewhere = tempfile::tempdir().unwrap();
    let plan = dir.path().join("P");
    let plan = plan.to_str().unwrap();
    run(elsewhere.path(), &["--plan", plan, "--shard", "1/1"]).ends_with(0);
    assert!(!plan_file(dir.path(), "scores.csv").exists());
    assert!(merged(dir.path()) == expected);
    // Another class of kernels is refused, because one table would contain scores with different last digits.
    run(
        dir.path(),
        &["--plan", "P", "--shard", "1/1", "--simd", "portable"],
    )
    .is_error_with(&["portable", "--simd"]);
    run(
        dir.path(),
        &["--plan", "P", "--shard", "1/1", "--method", "mean"],
    )
    .is_usage_error_with(&["--method"]);
    for option in ["--dry-run", "--estimate", "--out=elsewhere", "--limit=2"] {
        let said = run(dir.path(), &["--plan", "P", "--shard", "1/1", option]);
        assert_eq!(said.code, 2, "{}", said.err);
        let name = option.split('=').next().unwrap();
        assert!(said.err.contains(name), "{}", said.err);
    }
    // Changes made since the plan are reported, not worked around.
    for (name, from, to) in [
        ("run.toml", "limit = 24", "limit = 3"),
        // A plan must not be able to allow its own programs.
        (
            "run.toml",
            "limit = 24",
            "limit = 24\nallow-programs = true",
        ),
        ("pairs.csv", "view_0", "view_9"),
    ] {
        let path = plan_file(dir.path(), name);
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let said = run(dir.path(), &["--plan", "P", "--shard", "1/1"]);
        assert!(
            [1, 2].contains(&said.code),
            "{name}: {}{}",
            said.out,
            said.err
        );
        assert!(said.err.contains(name), "{}", said.err);
        fs::write(&path, text).unwrap();
    }
    let pairs = fs::read_to_string(plan_file(dir.path(), "pairs.csv")).unwrap();
    let shorter = pairs.trim_end().rsplit_once('\n').unwrap().0;
    fs::write(plan_file(dir.path(), "pairs.csv"), format!("{shorter}\n")).unwrap();
    for args in [
        &["run", "--plan", "P", "--shard", "1/1"][..],
        &["score", "P", "--shard", "1/1"],
        &["status", "P"],
        &["merge", "P"],
    ] {
        sharp_bench(dir.path(), args).is_error_with(&["pairs.csv"]);
    }
    fs::write(plan_file(dir.path(), "pairs.csv"), pairs).unwrap();
    for args in [
        &["--plan", "alone", "--shard", "1/1"][..],
        &["--plan", "nowhere", "--shard", "1/1"],
    ] {
        run(dir.path(), args).is_error_with(&[args[1]]);
    }
    for args in [
        &["--plan", "P"][..],
        &["--plan", "P", "--shard", "0/3"],
        &["--plan", "P", "--shard", "4/3"],
        &["--shard", "1/3"],
    ] {
        assert_eq!(run(dir.path(), args).code, 2, "{args:?}");
    }
    let job = [
        "scale", "slurm", "--plan", "P", "--shards", "3", "--out", "jobs",
    ];
    sharp_bench(dir.path(), &[&job[..], &["--sbatch", "gpu=1"]].concat())
        .is_usage_error_with(&["gpu=1", "pictures"]);
    // A folder with another run's results cannot be used for a plan.
    run(
        dir.path(),
        &[&WHAT[..10], &["--limit=3", "--plan-only", "--out", "alone"]].concat(),
    )
    .is_error_with(&["alone", "merge"]);
    // Programs of a plan from elsewhere start only if this is requested.
    let program = ["--method", "command:label=p,run='touch started; cat'"];
    run(
        dir.path(),
        &[
            &WHAT[..],
            &program,
            &["--limit=1", "--plan-only", "--out", "Q"],
        ]
        .concat(),
    );
    let _ = fs::remove_file(dir.path().join("started"));
    run(dir.path(), &["--plan", "Q", "--shard", "1/1"])
        .is_usage_error_with(&["--allow-programs", "touch started"]);
    assert!(!dir.path().join("started").exists());
}

fn stages() {
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    let score = |shard: &str| sharp_bench(dir.path(), &["score", "P", "--shard", shard, "--json"]);
    // Nothing to score yet.
    assert_eq!(score("1/1").ends_with(75).json()["waiting"], 72);
    for shard in ["1/2", "2/2"] {
        run(
            dir.path(),
            &["--plan", "P", "--shard", shard, "--stage", "pictures"],
        )
        .ends_with(0);
    }
    let status = sharp_bench(dir.path(), &["status", "P", "--json"])
        .ends_with(75)
        .json();
    assert_eq!(status["all"]["unscored"], 72);
    let scored: u64 = ["1/3", "2/3", "3/3"]
        .map(|shard| score(shard).ends_with(0).json()["scored"].as_u64().unwrap())
        .iter()
        .sum();
    assert_eq!(scored, 72);
    assert!(merged(dir.path()) == expected);
    // The plan determines the metrics.
    let other = ["score", "P", "--shard", "1/1", "--metrics", "psnr"];
    assert_eq!(sharp_bench(dir.path(), &other).code, 2);
    // The plan also determines the class of kernels, even if this machine has a faster one.
    let pinned = ["--simd=portable", "--limit=2", "--plan-only", "--out", "R"];
    run(dir.path(), &[&WHAT[..], &pinned].concat()).ends_with(0);
    run(
        dir.path(),
        &["--plan", "R", "--shard", "1/1", "--stage", "pictures"],
    )
    .ends_with(0);
    sharp_bench(dir.path(), &["score", "R", "--shard", "1/1"]).ends_with(0);
    sharp_bench(dir.path(), &["merge", "R"]).ends_with(0);
}

fn plan_file(folder: &Path, name: &str) -> PathBuf {
    folder.join("P").join(name)
}

/// A file system in memory, unmounted when it is dropped.
struct Mount(PathBuf);

impl Mount {
    fn new(at: &Path, options: &str) -> Option<Self> {
        fs::create_dir_all(at).ok()?;
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", options, "tmpfs"])
            .arg(at)
            .stderr(Stdio::null())
            .status();
        mounted
            .is_ok_and(|status| status.success())
            .then(|| Self(at.to_owned()))
    }

    fn remount(&self, options: &str) {
        let status = Command::new("mount")
            .args(["-o", &format!("remount,{options}")])
            .arg(&self.0)
            .status();
        assert!(status.unwrap().success());
    }
}

impl Drop for Mount {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

fn can_mount() -> bool {
    let dir = tempfile::tempdir().unwrap();
    Mount::new(&dir.path().join("m"), "size=64k").is_some()
}

fn full_disk() {
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    let mount = Mount::new(&dir.path().join("small"), "size=400k").unwrap();
    fs::rename(dir.path().join("P"), dir.path().join("Q")).unwrap();
    copy_folder(&dir.path().join("Q"), &dir.path().join("small/P")).unwrap();
    let small = dir.path().join("small");
    // Run until the disk is full, then again: finished units remain, and no partial file is used as
    // a result.
    let said = run(&small, &["--plan", "P", "--shard", "1/1"]);
    said.is_error_with(&["No space left"]);
    let done = unit_files(&small).len();
    assert!(done > 0);
    run(&small, &["--plan", "P", "--shard", "1/1"]).is_error_with(&["No space left"]);
    assert!(unit_files(&small).len() >= done);
    mount.remount("size=200m");
    shard(&small, "1/1").ends_with(0);
    assert!(merged(&small) == expected);
}

fn read_only() {
    let dir = tempfile::tempdir().unwrap();
    let expected = undisturbed(dir.path());
    let mount = Mount::new(&dir.path().join("small"), "size=200m").unwrap();
    let small = dir.path().join("small");
    copy_folder(&dir.path().join("P"), &small.join("P")).unwrap();
    shard(&small, "1/2").ends_with(0);
    mount.remount("ro");
    shard(&small, "2/2").is_error_with(&["P", "Read-only"]);
    sharp_bench(&small, &["merge", "P"]).is_error_with(&["Read-only"]);
    // Reading needs no further space.
    sharp_bench(&small, &["status", "P"]).ends_with(75);
    mount.remount("rw");
    shard(&small, "2/2").ends_with(0);
    assert!(merged(&small) == expected);
}
