//! An external program that receives one request per pair.

use sharp_tests::holds;

use super::*;

/// A shell program that returns the source, or misbehaves, depending on the number of pairs requested so far.
#[cfg(unix)]
const PROGRAM: &str = r#"
echo "hello from $$" >&2
while IFS= read -r line; do
  field() { printf '%s' "$line" | sed "s/.*\"$1\":\"\([^\"]*\)\",\"$2\".*/\1/"; }
  id=$(field pair_id source_picture); source=$(field source_picture write_to); to=$(field write_to pair)
  n=$(($(cat count 2>/dev/null || echo 0) + 1)); echo $n > count
  case $n in
    2) echo "out of memory" >&2; exit 3 ;;
    3) echo "Loading checkpoint shards" ; continue ;;
    4) cp small.png "$to" ;;
    5) sleep 1000 ;;
    6) echo "{\"pair_id\":\"$id\",\"error\":\"no face found\"}"; continue ;;
    7) echo "{\"pair_id\":\"$id\"}"; continue ;;
    *) cp "$source" "$to" ;;
  esac
  echo "{\"pair_id\":\"$id\",\"extras\":{\"steps\":$n}}"
done
echo "input ended" >&2
"#;

#[cfg(unix)]
#[test]
fn a_program_is_asked_pair_by_pair_and_each_failure_is_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("my.sh"), PROGRAM).unwrap();
    RgbImage::new(5, 5).save(dir.join("small.png")).unwrap();
    let method = [
        "--method",
        "command:label=mine,run='sh my.sh',timeout=8",
        "--method",
        "copy",
        "--limit",
        "9",
    ];
    let said = run(dir, "r", &method).ends_with(4);
    assert!(said.err.contains("6 of 18 units failed"), "{}", said.err);
    let found = scores(dir, "r");
    let (mine, copy) = (&found["mine"], &found["copy"]);
    for (n, part) in [
        (2, "exit status: 3"),
        (2, "out of memory"),
        (3, "Loading checkpoint"),
        (4, "5x5"),
        (5, "no answer within 8 s"),
        (6, "no face found"),
        (7, "prediction.png"),
    ] {
        let row = &mine[n - 1];
        assert_eq!(row["status"], "failed", "{n}");
        assert!(row["reason"].contains(part), "{n}: {}", row["reason"]);
    }
    for n in [1, 8, 9] {
        assert_eq!(
            mine[n - 1]["status"],
            "ok",
            "{n}: {}",
            mine[n - 1]["reason"]
        );
        assert_eq!(mine[n - 1]["psnr"], copy[n - 1]["psnr"]);
        assert_eq!(mine[n - 1]["steps"], n.to_string());
    }
    // Started once at first, then again after the crash, the noise and the silence.
    let log = read(dir.join("r/logs/mine.log"));
    let count = |text: &str| log.lines().filter(|l| l.contains(text)).count();
    assert_eq!(count("== started: sh my.sh"), 4, "{log}");
    assert_eq!(count("hello from"), 4, "{log}");
    assert_eq!(count("input ended"), 1, "{log}");

    // Only failed pairs are requested again; a changed script is another method.
    let json = run(dir, "r", &[&method[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    assert_eq!((&json["reused"], &json["failed"]), (&12.into(), &0.into()));
    std::fs::write(dir.join("my.sh"), format!("{PROGRAM}#\n")).unwrap();
    let json = run(dir, "r", &[&method[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    assert_eq!(json["reused"], 9);
    let settings = &json["manifest"]["methods"][0]["identity"]["settings"];
    assert_eq!(
        (&settings["run"], &settings["version"]),
        (&"sh my.sh".into(), &"".into())
    );
    assert_eq!(settings["content"].as_str().map(str::len), Some(16));
}

/// Each answer has as many names as allowed, but different ones; together they exceed the limit.
#[cfg(unix)]
#[test]
fn the_columns_of_a_program_are_bounded_over_all_of_its_answers() {
    let dir = tempfile::tempdir().unwrap();
    let program = r#"
n=10
while IFS= read -r line; do
  field() { printf '%s' "$line" | sed "s/.*\"$1\":\"\([^\"]*\)\",\"$2\".*/\1/"; }
  cp "$(field source_picture write_to)" "$(field write_to pair)"
  n=$((n + 1)); extras="\"shared\":$n"
  for i in 0 1 2 3 4 5 6 7 8 9; do extras="$extras,\"a${n}_$i\":$i"; done
  echo "{\"pair_id\":\"$(field pair_id source_picture)\",\"extras\":{$extras}}"
done
"#;
    std::fs::write(dir.path().join("many.sh"), program).unwrap();
    let method = ["--method", "command:run='sh many.sh'", "--limit", "6"];
    run(dir.path(), "r", &method).ends_with(0);
    let rows = &scores(dir.path(), "r")["command"];
    assert_eq!(rows.len(), 6);
    let names: Vec<&String> = rows[0].keys().filter(|k| k.starts_with('a')).collect();
    // The columns are the first names in alphabetical order, which are from three answers and a part of the fourth.
    // Each value is in the row of its own pair.
    assert_eq!(names.len(), 32, "{names:?}");
    assert!(!rows[0].contains_key("shared") && names.contains(&&"a14_1".to_owned()));
    for (n, row) in (11..).zip(rows) {
        let own = row
            .iter()
            .filter(|(k, v)| k.starts_with('a') && !v.is_empty());
        let own: Vec<&String> = own.map(|(k, _)| k).collect();
        let count = [10, 10, 10, 2, 0, 0][n - 11];
        assert_eq!(own.len(), count, "{n}");
        assert!(
            own.iter().all(|k| k.starts_with(&format!("a{n}_"))),
            "{own:?}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_program_may_serve_one_pair_only() {
    let dir = tempfile::tempdir().unwrap();
    let script = PROGRAM.replace(
        "while IFS= read -r line; do",
        "IFS= read -r line; for x in 1; do",
    );
    std::fs::write(dir.path().join("one.sh"), script).unwrap();
    std::fs::write(dir.path().join("count"), "10").unwrap();
    let method = ["--method", "command:run='sh one.sh'", "--limit", "3"];
    run(dir.path(), "r", &method).ends_with(0);
    let log = read(dir.path().join("r/logs/command.log"));
    assert_eq!(log.matches("== started").count(), 3, "{log}");
}

#[test]
fn programs_that_are_not_there_fail_pair_by_pair() {
    let dir = tempfile::tempdir().unwrap();
    let method = words("--method command:run=no-such-program-here --limit 2");
    run(dir.path(), "r", &method).ends_with(4);
    for row in &scores(dir.path(), "r")["command"] {
        holds(&row["reason"], &["no-such-program-here"]);
    }
    for (method, part) in [
        ("command", "run="),
        ("command:run=x,timeout=never", "timeout=never"),
        ("command:run=x,speed=2", "speed"),
    ] {
        run(dir.path(), "s", &["--method", method]).is_usage_error_with(&[part]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn nothing_that_a_program_started_outlives_a_run_that_is_ended() {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};
    // A shell without job control makes background processes ignore interrupts. This process, and
    // all that it starts, may be one of them.
    let status = read("/proc/self/status");
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = u64::from_str_radix(ignored.unwrap().trim(), 16).unwrap();
    let signals = match ignored & 2 {
        0 => &["KILL", "TERM", "INT"][..],
        _ => &["KILL", "TERM"],
    };
    for signal in signals {
        let dir = tempfile::tempdir().unwrap();
        // The process to check is neither the first shell nor the program, but a process started by
        // the program.
        let script = "sleep 1000 & echo $! > pid.new; mv pid.new pid; wait";
        std::fs::write(dir.path().join("my.sh"), script).unwrap();
        let mut run = Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
            .args(format!("run --dataset {DATASET} --metrics psnr --out r").split(' '))
            .args(["--method", "command:run='sh my.sh; true'"])
            .current_dir(dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let wait = |what: &str, done: &dyn Fn() -> bool| {
            let start = Instant::now();
            while !done() {
                assert!(
                    start.elapsed() < Duration::from_secs(60),
                    "{signal}: {what}"
                );
                std::thread::sleep(Duration::from_millis(20));
            }
        };
        wait("the program did not start", &|| {
            dir.path().join("pid").exists()
        });
        let pid = read(dir.path().join("pid"));
        let process = format!("/proc/{}/comm", pid.trim());
        assert!(Path::new(&process).exists());
        let number = run.id().to_string();
        // At the first SIGTERM, it would wait for the program.
        while run.try_wait().unwrap().is_none() {
            let _ = Command::new("kill")
                .args(["-s", signal, &number])
                .stderr(Stdio::null())
                .status();
            std::thread::sleep(Duration::from_millis(200));
        }
        wait("a process that the run started is still alive", &|| {
            std::fs::read_to_string(&process).map_or(true, |name| name.trim() != "sleep")
        });
    }
}

/// The Python program of bench/docs/your-method.md, with a model that returns its input.
#[cfg(unix)]
#[test]
#[ignore = "needs python3"]
fn the_python_program_of_the_docs_is_a_method() {
    let dir = tempfile::tempdir().unwrap();
    let model = r#"
import shutil

class Copy:
    def __init__(self, path):
        self.path = path

    def save(self, path):
        shutil.copy(self.path, path)

def predict(path, pair):
    assert len(pair["K_s"]) == 9 and len(pair["target_from_source"]) == 16
    return Copy(path)
"#;
    let docs = read(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/your-method.md"));
    let mut programs = docs.split("```python").skip(1);
    let program = programs.find(|text| text.contains("sys.stdin")).unwrap();
    let program = program.split("```").next().unwrap();
    std::fs::write(dir.path().join("my.py"), format!("{model}{program}")).unwrap();
    let methods = [
        "--method",
        "command:label=mine,run='python3 my.py'",
        "--method",
        "copy",
        "--limit",
        "5",
    ];
    run(dir.path(), "r", &methods).ends_with(0);
    let found = scores(dir.path(), "r");
    assert_eq!(found["mine"].len(), 5);
    for (mine, copy) in found["mine"].iter().zip(&found["copy"]) {
        assert_eq!(mine["psnr"], copy["psnr"]);
        assert_eq!(mine["steps"], "50");
    }
}

#[cfg(unix)]
#[test]
fn a_program_that_never_answers_is_started_three_times() {
    let dir = tempfile::tempdir().unwrap();
    let method = [
        "--method",
        "command:label=mine,run='echo no licence >&2; exit 7'",
    ];
    let limit = ["--limit", "8"];
    run(dir.path(), "r", &[&method[..], &limit].concat()).ends_with(4);
    let log = read(dir.path().join("r/logs/mine.log"));
    assert_eq!(log.matches("== started").count(), 3, "{log}");
    let rows = &scores(dir.path(), "r")["mine"];
    assert_eq!(rows.len(), 8);
    for row in &rows[2..] {
        assert_eq!(row["reason"], rows[2]["reason"]);
    }
    for part in [
        "not started again",
        "3 times",
        "exit status: 7",
        "no licence",
    ] {
        assert!(rows[7]["reason"].contains(part), "{}", rows[7]["reason"]);
    }
}

#[cfg(unix)]
#[test]
fn the_sources_depth_is_handed_to_a_program_with_that_privilege() {
    let dir = tempfile::tempdir().unwrap();
    let script = r#"
while IFS= read -r line; do
  field() { printf '%s' "$line" | sed -n "s/.*\"$1\":\"\([^\"]*\)\".*/\1/p"; }
  id=$(printf '%s' "$line" | sed 's/.*"pair_id":"\([^"]*\)","source_picture".*/\1/')
  depth=$(printf '%s' "$line" | sed -n 's/.*"source_depth":"\([^"]*\)".*/\1/p')
  if [ -n "$depth" ]; then bytes=$(wc -c < "$depth"); else bytes=0; fi
  echo "{\"pair_id\":\"$id\",\"picture\":\"gray.png\",\"extras\":{\"bytes\":$bytes}}"
done
"#;
    std::fs::write(dir.path().join("my.sh"), script).unwrap();
    RgbImage::from_pixel(96, 72, Rgb([9; 3]))
        .save(dir.path().join("gray.png"))
        .unwrap();
    let methods = [
        "--method",
        "command:label=blind,run='sh my.sh'",
        "--method",
        "command:label=told,run='sh my.sh',depth=privileged",
        "--limit",
        "2",
    ];
    run(dir.path(), "r", &methods).ends_with(0);
    let found = scores(dir.path(), "r");
    assert!(found["blind"].iter().all(|row| row["bytes"] == "0"));
    // A header of 128 bytes and 96 x 72 floats.
    assert!(
        found["told"]
            .iter()
            .all(|row| row["bytes"] == (128 + 4 * 96 * 72).to_string())
    );
    let manifest: serde_json::Value =
        serde_json::from_str(&read(dir.path().join("r/manifest.json"))).unwrap();
    assert_eq!(manifest["methods"][1]["privilege"], "source_depth");
}

#[cfg(unix)]
#[test]
fn a_program_that_spoils_its_source_gets_a_fresh_one_for_the_next_pair() {
    let dir = tempfile::tempdir().unwrap();
    RgbImage::new(96, 72)
        .save(dir.path().join("black.png"))
        .unwrap();
    let script = r#"
while IFS= read -r line; do
  field() { printf '%s' "$line" | sed "s/.*\"$1\":\"\([^\"]*\)\",\"$2\".*/\1/"; }
  id=$(field pair_id source_picture); source=$(field source_picture write_to); to=$(field write_to pair)
  cp "$source" "$to"; cp black.png "$source"
  echo "{\"pair_id\":\"$id\"}"
done
"#;
    std::fs::write(dir.path().join("my.sh"), script).unwrap();
    let methods = [
        "--method",
        "command:run='sh my.sh'",
        "--method",
        "copy",
        "--limit",
        "20",
    ];
    run(dir.path(), "r", &methods).ends_with(0);
    let found = scores(dir.path(), "r");
    let sources: std::collections::BTreeSet<_> =
        found["copy"].iter().map(|r| &r["source"]).collect();
    assert!(sources.len() < 20, "no source has two targets");
    for (program, copy) in found["command"].iter().zip(&found["copy"]) {
        assert_eq!(program["psnr"], copy["psnr"], "{}", copy["pair_id"]);
    }
}

/// The scripts of a cluster, each run as its scheduler would.
#[cfg(unix)]
#[test]
fn shards_start_a_program_only_with_leave() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("my.sh"), PROGRAM).unwrap();
    // Start counting after the pairs that fail.
    std::fs::write(dir.join("count"), "7").unwrap();
    let planned = [
        "--method",
        "command:label=mine,run='sh my.sh'",
        "--plan-only",
    ];
    run(dir, "r", &planned).ends_with(0);
    let scale = [
        "scale", "slurm", "--plan", "r", "--shards", "2", "--out", "jobs",
    ];
    let script = |name: &str, task: &str| {
        let status = std::process::Command::new("bash")
            .arg(dir.join("jobs").join(name))
            .current_dir(dir)
            .envs([("SHARD_OFFSET", "0"), ("SLURM_ARRAY_TASK_ID", task)])
            .output();
        status.unwrap().status.success()
    };
    let said = sharp_bench(dir, &scale).ends_with(0);
    holds(&said.err, &["again with --allow-programs"]);
    assert!(!script("pictures.sbatch", "1") && !dir.join("r/units").exists());
    let allowed = [&scale[..], &["--allow-programs"]].concat();
    let said = sharp_bench(dir, &allowed).ends_with(0);
    assert!(said.err.is_empty(), "{}", said.err);
    for name in ["pictures.sbatch", "score.sbatch"] {
        assert!(script(name, "1") && script(name, "2"), "{name}");
    }
    assert!(script("merge.sbatch", "0"));
    let found = scores(dir, "r");
    assert!(found["mine"].iter().all(|row| row["status"] == "ok"));
}
