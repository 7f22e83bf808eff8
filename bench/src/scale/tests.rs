use super::*;
use crate::evaluate::RunPlan;

fn plan(folder: &Path, name: &str) -> PathBuf {
    let root = folder.join(name);
    let estimate = serde_json::json!({
        "units": 100, "sources": 10, "pairs": 50, "measured_pairs": 6, "measured_failures": 0,
        "cpu_secs": 72_000.0, "wall_secs": 36_000.0, "peak_bytes": 3_u64 << 30, "disk_bytes": 1,
        "predict": {"cpu_secs": 7200.0, "wall_secs": 1.0, "peak_bytes": 9_u64 << 30, "disk_bytes": 1},
        "render": {"cpu_secs": 1.0, "wall_secs": 1.0, "peak_bytes": null, "disk_bytes": 1},
        "score": {"cpu_secs": 57_600.0, "wall_secs": 1.0, "peak_bytes": 1_u64 << 30, "disk_bytes": 1},
    });
    let plan = RunPlan {
        format: 2,
        blocks: Vec::new(),
        estimate: Some(serde_json::from_value(estimate).unwrap()),
    };
    std::fs::create_dir_all(&root).unwrap();
    std::fs::write(root.join("manifest.json"), "{}").unwrap();
    std::fs::write(root.join("plan.json"), serde_json::to_vec(&plan).unwrap()).unwrap();
    root
}

fn shards(plan: PathBuf) -> Shards {
    Shards {
        plan,
        count: 8,
        cpus: 4,
        retry_failed: false,
        allow_programs: true,
    }
}

fn request(folder: &Path, plan: PathBuf) -> Slurm {
    Slurm {
        shards: shards(plan),
        binary: "/opt/sharp-bench".into(),
        stages_apart: true,
        options: vec![
            ("pictures".to_owned(), "--gres=gpu:1".to_owned()),
            ("every".to_owned(), "--account=lab".to_owned()),
        ],
        out: folder.join("jobs"),
    }
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join("jobs").join(name)).unwrap()
}

#[test]
fn each_stage_asks_for_what_it_was_estimated_to_need() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let request = request(dir, plan(dir, "it's; rm -rf $HOME"));
    slurm(&request).unwrap();
    let (pictures, score, merge) = (
        read(dir, "pictures.sbatch"),
        read(dir, "score.sbatch"),
        read(dir, "merge.sbatch"),
    );
    // 9 GiB plus half of it; 2 h on one core, divided by 8 shards and by half of 4 cores, times three.
    assert!(pictures.contains("#SBATCH --mem=14336M\n"), "{pictures}");
    assert!(
        pictures.contains("#SBATCH --time=30\n") && score.contains("#SBATCH --time=180\n"),
        "{score}"
    );
    assert!(
        pictures.contains("#SBATCH --gres=gpu:1\n#SBATCH --account=lab\n"),
        "{pictures}"
    );
    assert!(!score.contains("gpu") && score.contains("--account") && merge.contains("--account"));
    let shard = " --shard \"$shard/8\" --threads 4 &";
    let command = format!(" --stage pictures --allow-programs{shard}");
    assert!(pictures.contains(&command), "{pictures}");
    // Scoring opens no method.
    assert!(
        score.contains(&format!("'{shard}")) && !score.contains("run --plan"),
        "{score}"
    );
    // Quoted, so that a shell reads it as one word.
    assert!(pictures.contains(r"it'\''s; rm -rf $HOME'"), "{pictures}");
    for name in [
        "pictures.sbatch",
        "score.sbatch",
        "merge.sbatch",
        "submit.sh",
    ] {
        let checked = std::process::Command::new("bash")
            .arg("-n")
            .arg(dir.join("jobs").join(name))
            .output();
        let checked = checked.unwrap();
        assert!(
            checked.status.success(),
            "{name}: {}",
            String::from_utf8_lossy(&checked.stderr)
        );
        assert!(!read(dir, name).contains("{{"), "{name}");
    }
    // Our own files are overwritten, other files are not.
    slurm(&request).unwrap();
    std::fs::write(dir.join("jobs/submit.sh"), "mine").unwrap();
    assert!(slurm(&request).is_err());
}

#[test]
fn what_would_run_as_something_else_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let planned = plan(dir, "p");
    for option in ["gpu:1", "--x\nrm -rf /", ""] {
        let mut request = request(dir, planned.clone());
        request.options = vec![("pictures".to_owned(), option.to_owned())];
        assert!(slurm(&request).is_err(), "{option}");
    }
    let mut bad_job = request(dir, planned.clone());
    bad_job.options = vec![("gpu".to_owned(), "--x".to_owned())];
    assert!(slurm(&bad_job).is_err());
    assert!(slurm(&request(dir, plan(dir, "a\nb"))).is_err());
    std::fs::write(planned.join("plan.json"), r#"{"format": 2, "blocks": []}"#).unwrap();
    let error = slurm(&request(dir, planned)).unwrap_err().to_string();
    assert!(error.contains("--plan-only"), "{error}");
}

#[test]
fn an_indexed_job_is_one_pod_a_shard() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let mut request = Kubernetes {
        shards: shards(plan(dir, "Größe \"1\"")),
        parallel: 20,
        image: "registry/x:1\nkind: Secret".to_owned(),
        claim: "data".to_owned(),
        mount: dir.to_owned(),
        out: dir.join("jobs"),
    };
    kubernetes(&request).unwrap();
    let job = read(dir, "job.yaml");
    assert!(
        job.contains("completions: 8\n") && job.contains("parallelism: 8\n"),
        "{job}"
    );
    assert!(
        job.contains("--shard auto/8 --threads 4 --allow-programs & run=$$!"),
        "{job}"
    );
    assert!(
        job.contains(r#"image: "registry/x:1\U0000000akind: Secret""#),
        "{job}"
    );
    let name = job.lines().find_map(|line| line.strip_prefix("  name: "));
    let name = name.unwrap();
    assert!(name.starts_with("sharp-gr--e--1--"), "{name}");
    // A plan in another folder gets another Job name, even if the folder has the same name.
    let mut second = request.clone();
    second.shards = shards(plan(&dir.join("second"), "Größe \"1\""));
    kubernetes(&second).unwrap();
    assert!(!read(dir, "job.yaml").contains(name));
    let mut too_many = request.clone();
    too_many.shards.count = 100_001;
    assert!(kubernetes(&too_many).is_err());
    assert!(!read(dir, "merge.yaml").contains("{{"));
    request.mount = dir.join("elsewhere");
    assert!(kubernetes(&request).is_err());
}

/// A script that records its arguments, one per line, in a file next to it.
const RECORDER: &str = "#!/bin/bash\nprintf '%s\\n' \"${0##*/}\" \"$@\" >> \"${0%/*}/called\"\n[ \"${2-}\" != status ] && [ \"$1\" != status ] || echo '0 1-2'\n";

#[cfg(unix)]
#[test]
fn no_name_changes_what_runs() {
    use std::os::unix::fs::PermissionsExt as _;
    for name in [
        "it's \"x\"",
        "$(touch pwned)",
        "`touch pwned`",
        "x; touch pwned #",
        "x && touch pwned",
        "-rf",
        "%j %%",
        "*?[a]{1,2}",
        "a\\'b\\",
        " ~ ",
        "!! $HOME ${HOME}",
        "{{shards}}",
        "A=b",
        "größe \u{2028}touch pwned",
    ] {
        let dir = tempfile::tempdir().unwrap();
        let dir = dir.path();
        let planned = plan(dir, name);
        let programs = dir.join("bin");
        std::fs::create_dir(&programs).unwrap();
        let own = format!("own {name}");
        for program in ["sbatch", "scontrol", &own] {
            let path = programs.join(program);
            std::fs::write(&path, RECORDER).unwrap();
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        }
        let mut request = request(dir, planned.clone());
        request.binary = programs.join(&own);
        slurm(&request).unwrap();
        let plan = planned.to_str().unwrap();
        let called = |script: &str| {
            let path = std::env::join_paths([
                programs.as_path(),
                Path::new("/usr/bin"),
                Path::new("/bin"),
            ]);
            let status = std::process::Command::new("bash")
                .arg(dir.join("jobs").join(script))
                .current_dir(dir)
                .env("PATH", path.unwrap())
                .envs([("SHARD_OFFSET", "2"), ("SLURM_ARRAY_TASK_ID", "1")])
                .status();
            assert!(status.unwrap().success(), "{script} of {name}");
            let text = std::fs::read_to_string(programs.join("called")).unwrap();
            std::fs::remove_file(programs.join("called")).unwrap();
            text
        };
        let shard = "--shard\n3/8\n--threads\n4\n";
        assert_eq!(
            called("pictures.sbatch"),
            format!(
                "{own}\n--quiet\nrun\n--plan\n{plan}\n--stage\npictures\n--allow-programs\n{shard}"
            )
        );
        assert_eq!(
            called("score.sbatch"),
            format!("{own}\n--quiet\nscore\n{plan}\n{shard}")
        );
        assert_eq!(called("merge.sbatch"), format!("{own}\nmerge\n{plan}\n"));
        let submitted = called("submit.sh");
        // sbatch expands `%` in file names.
        let logs = format!("--output={plan}/logs/slurm/").replace('%', "%%");
        assert_eq!(submitted.matches(&logs).count(), 3, "{submitted}");
        assert!(submitted.contains(&format!("{own}\nstatus\n{plan}\n--unfinished-shards\n8\n")));
        assert!(!dir.join("pwned").exists(), "{name}");
    }
}
