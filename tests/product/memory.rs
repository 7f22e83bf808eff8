//! Memory stays within its limit, and does not grow from the fifth to the twentieth minute of a run
//! that is disturbed all the time.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::support::{sharp_bench, words};
use super::{random, run, send, start, unit_files};

const MIB: u64 = 1 << 20;

/// Eight predictions of a picture as wide as ETH3D's, whose features need most of the memory;
/// scored once all together, and once within a limit that fits only a few of them.
pub(crate) fn limit() {
    let dir = tempfile::tempdir().unwrap();
    let labels: Vec<String> = (0..8).map(|i| format!("copy:label=copy{i}")).collect();
    let methods = labels.iter().flat_map(|label| ["--method", label]);
    let pictures: Vec<&str> = [
        "--dataset",
        "S:synthetic=size=6000x64,views=2",
        "--pair-options=sets=whole,threshold=0,at-threshold=in",
        "--limit=1",
        "--stage=pictures",
        "--metrics=dists,psnr",
    ]
    .into_iter()
    .chain(methods)
    .collect();
    let mut scores = Vec::new();
    for (name, limit, holds) in [("all", "4G", false), ("few", "900M", true)] {
        run(dir.path(), &[&pictures[..], &["--out", name]].concat()).ends_with(0);
        let mut child = Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
            .args(format!("score {name} --metrics=dists,psnr --memory-limit {limit}").split(' '))
            .current_dir(dir.path())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let mut peak = 0;
        while child.try_wait().unwrap().is_none() {
            peak = peak.max(peak_bytes(child.id()).unwrap_or(0));
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(child.wait().unwrap().success());
        assert_eq!(peak <= 900 * MIB, holds, "{name}: {} MiB", peak / MIB);
        scores.push(fs::read(dir.path().join(name).join("scores.csv")).unwrap());
    }
    assert!(scores[0] == scores[1]);
}

/// Peak memory of a process; `None` if unknown.
pub(crate) fn peak_bytes(process: u32) -> Option<u64> {
    of_process(process, "VmHWM:")
}

fn of_process(process: u32, key: &str) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find(|line| line.starts_with(key))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}

/// Minutes requested by `SHARP_BENCH_SOAK`, at least 6.
pub(crate) fn minutes() -> Option<usize> {
    let minutes: usize = std::env::var("SHARP_BENCH_SOAK").ok()?.parse().ok()?;
    Some(minutes.max(6))
}

/// A program that in turn answers, refuses, floods, lies, hangs and dies, and continues the
/// sequence after each restart.
const PROGRAM: &str = r#"
field() { printf '%s' "$line" | sed "s/.*\"$1\":\"\([^\"]*\)\".*/\1/"; }
while read -r line; do
  turn=$(( ($(cat turn 2>/dev/null || echo 0) + 1) % 6 )); echo $turn > turn
  id=$(field pair_id)
  case $turn in
    1) head -c 4000000 /dev/zero | tr '\0' x >&2; echo "{\"pair_id\":\"$id\",\"error\":\"flooded\"}";;
    2) echo 'not an answer';;
    3) echo "{\"pair_id\":\"$id\",\"error\":\"refused\"}";;
    4) sleep 9;;
    5) exit 3;;
    *) cp "$(field source_picture)" "$(field write_to)"; echo "{\"pair_id\":\"$id\"}";;
  esac
done
"#;

#[allow(
    clippy::print_stderr,
    reason = "prints the figures for whoever set SHARP_BENCH_SOAK"
)]
pub(crate) fn soak() {
    let Some(minutes) = minutes() else { return };
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    sharp_bench(root, &["demo", "--out", "demo", "--metrics", "psnr"]).ends_with(0);
    fs::rename(root.join("demo/run/predictions/copy"), root.join("there")).unwrap();
    fs::write(root.join("program.sh"), PROGRAM).unwrap();
    let methods = [
        "target",
        "depth-splat",
        "copy",
        "mean",
        "imported:label=gone,dir=there",
        "command:label=faulty,timeout=2,run=sh program.sh",
    ];
    let plan = words(
        "run --plan-only --out P --dataset Middlebury:middlebury=demo/data \
         --dataset Synthetic:synthetic=size=480x360,views=48 \
         --pair-options=sets=whole,threshold=0,at-threshold=in,limit=all",
    );
    let methods = methods.iter().flat_map(|method| ["--method", method]);
    let plan: Vec<&str> = plan.into_iter().chain(methods).collect();
    sharp_bench(root, &plan).ends_with(0);
    let budget = format!("{minutes}m");
    let options = ["--allow-programs", "--time-budget", &budget];
    let mut child = start(root, "1/1", &options);
    let started = Instant::now();
    let (mut peaks, mut faults, mut seed) = (vec![0; minutes], 0, 3);
    while child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_secs(1));
        let minute = started.elapsed().as_secs() as usize / 60;
        let resident = of_process(child.id(), "VmRSS:").unwrap_or(0);
        if let Some(peak) = peaks.get_mut(minute) {
            *peak = resident.max(*peak);
        }
        if random(&mut seed, 4) == 0 {
            let fault = random(&mut seed, 5) as usize;
            disturb(root, fault, &child, &mut seed);
            faults += 1;
        }
    }
    let ended = child.wait().unwrap();
    let mib: Vec<u64> = peaks.iter().map(|bytes| bytes / MIB).collect();
    let told = format!("{faults} faults; resident at most, MiB, minute by minute: {mib:?}");
    eprintln!("{told}");
    // The time budget must have stopped it; otherwise there was too little work.
    assert_eq!(ended.code(), Some(75), "{told}");
    assert!(
        peaks[minutes - 1] as f64 <= 1.05 * peaks[4] as f64,
        "{told}"
    );
    assert!(unit_files(root).len() > minutes);
}

fn disturb(root: &Path, fault: usize, child: &Child, seed: &mut u64) {
    let units = unit_files(root);
    match fault {
        // Damage a unit.
        0 if !units.is_empty() => {
            let path = &units[random(seed, units.len() as u64) as usize];
            let text = fs::read_to_string(path).unwrap_or_default();
            let _ = fs::write(path, text.replacen('1', "2", 1));
        }
        // Remove kept pictures.
        1 => {
            let _ = fs::remove_dir_all(root.join("P/predictions/mean"));
        }
        // Remove a method's input for a while.
        2 => {
            let (here, away) = (root.join("there"), root.join("away"));
            fs::rename(&here, &away).unwrap();
            std::thread::sleep(Duration::from_millis(random(seed, 3000)));
            fs::rename(&away, &here).unwrap();
        }
        // Run the same shard in another process, and kill that.
        3 => {
            let mut other = start(root, "1/1", &["--allow-programs"]);
            std::thread::sleep(Duration::from_millis(random(seed, 4000)));
            other.kill().unwrap();
            other.wait().unwrap();
        }
        // Stop the process for a while.
        _ => {
            send("STOP", child);
            std::thread::sleep(Duration::from_millis(random(seed, 2000)));
            send("CONT", child);
        }
    }
}
