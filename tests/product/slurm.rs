//! Runs a plan on a Slurm cluster of three nodes, all on this machine; one of them dies.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::support::{read, sharp_bench};

/// Whether Slurm's daemons and MUNGE are installed and may be started.
pub(crate) fn is_there() -> bool {
    let user = Command::new("id").arg("-u").output();
    let is_root = user.is_ok_and(|user| user.stdout.trim_ascii() == b"0");
    let programs = ["slurmctld", "slurmd", "munged", "sbatch"];
    let has = |program: &&str| {
        let found = Command::new("sh")
            .args(["-c", &format!("command -v {program}")])
            .output();
        found.is_ok_and(|found| found.status.success())
    };
    is_root && programs.iter().all(has)
}

/// A separate cluster with its own configuration, ports and processes, all of which end when it is
/// dropped.
struct Cluster {
    root: PathBuf,
    host: String,
    /// True if MUNGE was not running before.
    started_munge: bool,
}

impl Cluster {
    fn start(root: &Path) -> Self {
        let host = read("/proc/sys/kernel/hostname");
        let cluster = Self {
            root: root.to_owned(),
            host: host.split('.').next().unwrap().trim().to_owned(),
            started_munge: !is_authentic(),
        };
        for folder in ["state", "run", "log"] {
            fs::create_dir_all(root.join(folder)).unwrap();
        }
        fs::write(root.join("slurm.conf"), cluster.configuration()).unwrap();
        if cluster.started_munge {
            let start = "mkdir -p /run/munge && chown munge:munge /run/munge && su -s /bin/sh munge -c \"$(command -v munged)\"";
            let _ = Command::new("sh")
                .args(["-c", start])
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status();
            wait("MUNGE does not answer", 20, is_authentic);
        }
        cluster.daemon("slurmctld", &["-c"]);
        for node in ["n1", "n2", "n3"] {
            cluster.daemon("slurmd", &["-N", node]);
        }
        wait("the nodes are not idle", 60, || {
            cluster
                .ask("sinfo", &["-h", "-N", "-o", "%T"])
                .matches("idle")
                .count()
                == 3
        });
        cluster
    }

    fn configuration(&self) -> String {
        let (host, root) = (&self.host, self.root.display());
        // Separate from other tests that run at the same time, and from the machine's own Slurm.
        let port = 20_000 + std::process::id() % 10_000 * 4;
        let nodes: String = (1..=3)
            .map(|i| {
                let port = port + i;
                format!("NodeName=n{i} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=2 RealMemory=8000 State=UNKNOWN\n")
            })
            .collect();
        format!(
            "ClusterName=t\nSlurmctldHost={host}(127.0.0.1)\nCommunicationParameters=NoInAddrAny,NoCtldInAddrAny\n\
             AuthType=auth/munge\nSlurmUser=root\nSlurmdUser=root\nStateSaveLocation={root}/state\n\
             SlurmdSpoolDir={root}/spool-%n\nSlurmctldPidFile={root}/run/slurmctld.pid\n\
             SlurmdPidFile={root}/run/slurmd-%n.pid\nSlurmctldLogFile={root}/log/slurmctld.log\n\
             SlurmdLogFile={root}/log/slurmd-%n.log\nSlurmctldPort={port}\nProctrackType=proctrack/linuxproc\n\
             TaskPlugin=task/none\nSwitchType=switch/none\nMpiDefault=none\nSelectType=select/cons_tres\n\
             SelectTypeParameters=CR_Core\nReturnToService=2\nSlurmdTimeout=5\nSlurmdParameters=config_overrides\n\
             SchedulerType=sched/backfill\nSchedulerParameters=sched_min_interval=0,batch_sched_delay=0\n\
             AccountingStorageType=accounting_storage/none\nJobAcctGatherType=jobacct_gather/none\n\
             JobCompType=jobcomp/filetxt\nJobCompLoc={root}/log/jobcomp.txt\nMaxArraySize=5\n{nodes}\
             PartitionName=main Nodes=n[1-3] Default=YES MaxTime=INFINITE State=UP\n"
        )
    }

    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command
            .env("SLURM_CONF", self.root.join("slurm.conf"))
            .stdin(Stdio::null());
        command
    }

    fn daemon(&self, program: &str, arguments: &[&str]) {
        let configuration = self.root.join("slurm.conf");
        let status = self
            .command(program)
            .args(arguments)
            .arg("-f")
            .arg(configuration)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        assert!(status.unwrap().success(), "{program} {arguments:?}");
    }

    fn ask(&self, program: &str, arguments: &[&str]) -> String {
        let output = self.command(program).args(arguments).output().unwrap();
        String::from_utf8_lossy(&output.stdout).into_owned()
    }

    /// Submits the remaining shards of the plan in a folder and waits until all jobs have ended.
    fn submit(&self, folder: &Path) -> String {
        let submitted = self
            .command("bash")
            .arg("jobs/submit.sh")
            .current_dir(folder)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&submitted.stdout).into_owned();
        let errors = String::from_utf8_lossy(&submitted.stderr);
        assert!(submitted.status.success(), "{said}{errors}");
        said
    }

    fn drain(&self) {
        wait("jobs do not end", 240, || {
            // A requeued job would wait for two minutes.
            for job in self
                .ask("squeue", &["-h", "-t", "PD", "-r", "-o", "%i %r"])
                .lines()
            {
                if let Some((id, "BeginTime")) = job.split_once(' ') {
                    self.ask(
                        "scontrol",
                        &["update", &format!("JobId={id}"), "StartTime=now"],
                    );
                }
            }
            self.ask("squeue", &["-h"]).trim().is_empty()
        });
    }

    /// Kills the daemon of a node and everything that it started, like a power failure.
    fn lose(&self, node: &str) {
        let jobs = self.ask("squeue", &["-h", "-w", node, "-t", "R", "-o", "%A"]);
        let mut doomed: Vec<u32> = Vec::new();
        doomed.extend(pid(&self.root.join(format!("run/slurmd-{node}.pid"))));
        let processes = processes();
        for job in jobs.split_whitespace() {
            let step = format!("[{job}.");
            doomed.extend(
                processes
                    .iter()
                    .filter(|(.., title)| title.contains(&step))
                    .map(|(id, ..)| *id),
            );
        }
        let mut at = 0;
        while at < doomed.len() {
            let parent = doomed[at];
            doomed.extend(
                processes
                    .iter()
                    .filter(|(_, of, _)| *of == parent)
                    .map(|(id, ..)| *id),
            );
            at += 1;
        }
        for process in doomed {
            kill(process, "KILL");
        }
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.ask("scancel", &["-u", "root"]);
        for entry in fs::read_dir(self.root.join("run"))
            .into_iter()
            .flatten()
            .flatten()
        {
            if let Some(daemon) = pid(&entry.path()) {
                kill(daemon, "TERM");
                let gone = || !Path::new(&format!("/proc/{daemon}")).exists();
                let patience = Instant::now() + Duration::from_secs(10);
                while !gone() && Instant::now() < patience {
                    std::thread::sleep(Duration::from_millis(50));
                }
            }
        }
        if self.started_munge {
            let _ = Command::new("su")
                .args([
                    "-s",
                    "/bin/sh",
                    "munge",
                    "-c",
                    "$(command -v munged || echo /usr/sbin/munged) --stop",
                ])
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status();
        }
    }
}

fn pid(file: &Path) -> Option<u32> {
    fs::read_to_string(file).ok()?.trim().parse().ok()
}

fn kill(process: u32, signal: &str) {
    let kill = Command::new("kill")
        .args(["-s", signal, &process.to_string()])
        .stderr(Stdio::null())
        .status();
    kill.unwrap();
}

/// Id, parent and title of each process.
fn processes() -> Vec<(u32, u32, String)> {
    let of = |entry: fs::DirEntry| {
        let id: u32 = entry.file_name().to_str()?.parse().ok()?;
        let stat = fs::read_to_string(entry.path().join("stat")).ok()?;
        let parent = stat
            .rsplit(')')
            .next()?
            .split_whitespace()
            .nth(1)?
            .parse()
            .ok()?;
        let title = fs::read(entry.path().join("cmdline")).ok()?;
        Some((id, parent, String::from_utf8_lossy(&title).into_owned()))
    };
    fs::read_dir("/proc")
        .unwrap()
        .flatten()
        .filter_map(of)
        .collect()
}

fn is_authentic() -> bool {
    let passed = Command::new("sh")
        .args(["-c", "munge -n | unmunge"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    passed.is_ok_and(|status| status.success())
}

fn wait(what: &str, secs: u64, done: impl Fn() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(secs), "{what}");
        std::thread::sleep(Duration::from_millis(200));
    }
}

pub(crate) fn survives_a_dead_node() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    let expected = super::undisturbed(folder);
    // Six shards, but array indices up to 4 only: two arrays are needed.
    let scale = [
        "scale", "slurm", "--plan", "P", "--shards", "6", "--cpus", "1", "--out", "jobs",
    ];
    sharp_bench(folder, &scale).ends_with(0);
    let cluster = Cluster::start(&folder.join("slurm"));
    let said = cluster.submit(folder);
    assert!(
        said.contains("pictures: ") && said.contains("score: ") && said.contains("merge: "),
        "{said}"
    );
    let has_units = || super::unit_files(folder).len() >= 6;
    wait("no unit is made", 90, has_units);
    cluster.lose("n2");
    cluster.drain();
    let mut tries = 0;
    while sharp_bench(folder, &["status", "P"]).code != 0 {
        tries += 1;
        assert!(tries < 4, "{}", sharp_bench(folder, &["status", "P"]).out);
        cluster.submit(folder);
        cluster.drain();
    }
    assert!(fs::read(folder.join("P/scores.csv")).unwrap() == expected);
    // For a unit lost afterwards, only its shard is submitted.
    fs::remove_file(&super::unit_files(folder)[40]).unwrap();
    let unfinished = sharp_bench(folder, &["status", "P", "--unfinished-shards", "6"]).out;
    assert_eq!(unfinished.trim().len(), 1, "{unfinished}");
    cluster.submit(folder);
    cluster.drain();
    assert_eq!(sharp_bench(folder, &["status", "P"]).code, 0);
    assert!(fs::read(folder.join("P/scores.csv")).unwrap() == expected);
}
