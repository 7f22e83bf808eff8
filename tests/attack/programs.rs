//! External programs that misbehave.

use sharp_tests::words;

use super::case::{Case, Verdict};
use super::oracle::{Known, judge_run, rows, same};

/// Behaviours of a program for a pair: what it does, and how. A star marks those that still return the source.
const DEEDS: &str = r#"is silent: sleep 1000
is silent and ignores signals: trap '' TERM INT HUP; sleep 1000
crashes: exit 3
is killed: kill -s KILL $$
ends successfully without an answer: exit 0
answers with text that is not JSON: echo hello
answers with bytes that are not text: printf '\377\376\n'
answers for another pair: echo '{"pair_id":"S/x/a__b"}'
answers before the picture exists: answer
* answers twice: cp "$source" "$to"; answer; answer
answers with a line that never ends: head -c 3000000 /dev/zero | tr '\0' x; echo
answers with deeply nested JSON: head -c 200000 /dev/zero | tr '\0' '['; echo
answers a long error: printf '{"pair_id":"%s","error":"' "$id"; head -c 900000 /dev/zero | tr '\0' e; echo '"}'
answers with an error that reverses the direction of text: printf '{"pair_id":"%s","error":"\\u001b[31m\\u202e=1+1"}\n' "$id"
answers with an extra that is not a number: cp "$source" "$to"; echo "{\"pair_id\":\"$id\",\"extras\":{\"a\":NaN}}"
answers with an extra that exceeds f64: cp "$source" "$to"; echo "{\"pair_id\":\"$id\",\"extras\":{\"a\":1e999}}"
gives /dev/zero as its picture: echo "{\"pair_id\":\"$id\",\"picture\":\"/dev/zero\"}"
gives a folder as its picture: echo "{\"pair_id\":\"$id\",\"picture\":\"/\"}"
returns half a picture: head -c 900 "$source" > "$to"; answer
returns a picture of another size: cp small.png "$to"; answer
returns a page of HTML: echo '<html></html>' > "$to"; answer
* floods standard error: head -c 30000000 /dev/zero | tr '\0' '\n' >&2; cp "$source" "$to"; answer
* floods standard error without line ends: head -c 30000000 /dev/zero >&2; cp "$source" "$to"; answer
* floods standard output: cp "$source" "$to"; answer; yes
* overwrites its source: cp "$source" "$to"; cp small.png "$source"; answer
* removes its source's folder: cp "$source" "$to"; answer; rm -rf "$(dirname "$source")"
* leaves a process behind: cp "$source" "$to"; sleep 1000 & answer
closes its outputs and keeps running: exec >&- 2>&-; sleep 1000"#;

const HEAD: &str = r#"
echo $$ >> pids
answer() { echo "{\"pair_id\":\"$id\"}"; }
while IFS= read -r line; do
  field() { printf '%s' "$line" | sed "s/.*\"$1\":\"\([^\"]*\)\",\"$2\".*/\1/"; }
  id=$(field pair_id source_picture); source=$(field source_picture write_to); to=$(field write_to pair)
  n=$(($(cat count 2>/dev/null || echo 0) + 1)); echo $n > count
"#;

pub(crate) fn programs(case: &mut Case) -> Result<Verdict, String> {
    let deeds: Vec<&str> = DEEDS.lines().collect();
    let (what, deed) = case.random.pick(&deeds).split_once(": ").unwrap();
    let (what, hands_back) = match what.strip_prefix("* ") {
        Some(what) => (what, true),
        None => (what, false),
    };
    // From the first pair on, or after a successful one.
    let from = 1 + case.random.below(2);
    let script = format!(
        "{HEAD}  if [ $n -lt {from} ]; then cp \"$source\" \"$to\"; answer; continue; fi\n  {deed}\ndone\n"
    );
    case.write("p.sh", script);
    case.write("small.png", "");
    image::RgbImage::new(5, 5)
        .save(case.path("small.png"))
        .unwrap();
    case.note(format!("from pair {from} on the program {what}"), "p.sh");
    case.may_name("/dev/zero");
    case.may_name("/: ");
    let mut args =
        words("run --dataset S:synthetic=size=32x24,views=4 --metrics psnr --no-cache --limit 3");
    args.extend(["--method", "command:label=mine,run='sh p.sh',timeout=1"]);
    args.extend(["--method", "copy", "--out", "r"]);
    let said = case.run(&args)?;
    let found = rows(&case.path("r/scores.csv"))?;
    let copies: Vec<_> = found.iter().filter(|row| row["method"] == "copy").collect();
    let verdict = judge_run(case, &said, "r", &|row| {
        let copy = copies
            .iter()
            .find(|copy| copy["pair_id"] == row["pair_id"])
            .unwrap();
        match (hands_back || row["method"] == "copy", copy["psnr"].parse()) {
            (_, Ok(psnr)) => Known::Number(psnr),
            _ => Known::Impossible("the copy failed"),
        }
    })?;
    let mine = || found.iter().filter(|row| row["method"] == "mine");
    if hands_back && mine().all(|row| row["status"] != "ok") {
        return Err("no pair succeeded".to_owned());
    }
    // A program that misbehaved cannot have a score, unless it returned its input.
    if !hands_back
        && mine().any(|row| row["status"] == "ok" && !same(&row["psnr"], copy_of(&found, row)))
    {
        return Err("a pair has a score although its picture was never returned".to_owned());
    }
    let log = case
        .path("r/logs/mine.log")
        .metadata()
        .map_or(0, |log| log.len());
    if log > 10 << 20 {
        return Err(format!("a log of {log} bytes"));
    }
    if std::fs::read_dir(case.path("r")).unwrap().any(|entry| {
        let name = entry.unwrap().file_name();
        name.to_string_lossy().starts_with(".scratch")
    }) {
        return Err("a scratch folder was not removed".to_owned());
    }
    // Processes started by the program end with the run.
    for pid in case.read("pids").lines() {
        let alive = || {
            let status = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            let state = status
                .rsplit(") ")
                .next()
                .and_then(|rest| rest.chars().next());
            status.contains("(sh)") && !matches!(state, Some('Z') | None)
        };
        let begin = std::time::Instant::now();
        while alive() {
            if begin.elapsed().as_secs() > 5 {
                return Err(format!("process {pid} outlived the run"));
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    }
    let failed = mine().any(|row| row["status"] != "ok");
    Ok(if failed { Verdict::Error } else { verdict })
}

fn copy_of(
    rows: &[std::collections::BTreeMap<String, String>],
    row: &std::collections::BTreeMap<String, String>,
) -> f64 {
    let copy = rows
        .iter()
        .find(|copy| copy["method"] == "copy" && copy["pair_id"] == row["pair_id"]);
    copy.and_then(|copy| copy["psnr"].parse().ok())
        .unwrap_or(f64::NAN)
}
