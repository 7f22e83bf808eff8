//! `tests/example_repository`: an example of a model author's repository, run as its workflow runs
//! it.

use std::path::Path;
use std::process::Command;

use crate::support::read;

/// Runs `ci/evaluate.sh OUT` in a copy of the repository.
fn evaluate(repository: &Path, out: &str) -> (i32, String) {
    let program = Path::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .parent()
        .unwrap();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::iter::once(program.to_owned()).chain(std::env::split_paths(&path));
    let said = Command::new(repository.join("ci/evaluate.sh"))
        .arg(out)
        .current_dir(repository)
        .env("PATH", std::env::join_paths(folders).unwrap())
        .env("XDG_CACHE_HOME", repository.join(".cache"))
        .env("SHARP_BENCH_WEIGHTS", repository.join(".cache/weights"))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&said.stdout) + String::from_utf8_lossy(&said.stderr);
    (said.status.code().unwrap_or(-1), text.into_owned())
}

#[test]
#[ignore = "needs bash and python3"]
fn the_python_repository_passes_and_its_broken_model_fails() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/example_repository");
    let copied = Command::new("cp")
        .arg("-r")
        .arg(example.join("."))
        .arg(dir)
        .status();
    assert!(copied.unwrap().success());

    let (code, said) = evaluate(dir, "good");
    assert_eq!(code, 0, "{said}");
    let comment = read(dir.join("good/comment.md"));
    assert!(
        comment.starts_with("### Quality gate passed: none of 5 checks fired\n"),
        "{comment}"
    );

    // A shift by half a pixel, which is not visible in the pictures.
    let script = read(dir.join("predict.py"));
    let broken = script.replace("x - 0.5,", "x,").replace("y - 0.5,", "y,");
    assert_ne!(broken, script);
    std::fs::write(dir.join("predict.py"), broken).unwrap();
    let (code, said) = evaluate(dir, "broken");
    assert_eq!(code, 3, "{said}");
    let comment = read(dir.join("broken/comment.md"));
    assert!(
        comment.contains("| fired | psnr &lt; -0.1 | psnr | smoke, model |"),
        "{comment}"
    );
    assert!(read(dir.join("broken/gate.xml")).contains("<failure message="));

    // A pair without a prediction by the model.
    let lost = script.replace(
        "    for path in sorted(pairs.rglob(\"pair.json\")):",
        "    for path in sorted(pairs.rglob(\"pair.json\"))[1:]:",
    );
    assert_ne!(lost, script);
    std::fs::write(dir.join("predict.py"), lost).unwrap();
    let (code, said) = evaluate(dir, "lost");
    assert_eq!(code, 3, "{said}");
    let comment = read(dir.join("lost/comment.md"));
    assert!(
        comment.contains("1 pair with a score in A but not in B"),
        "{comment}"
    );
}
