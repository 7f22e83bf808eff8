"""The manifests of `scale kubernetes` against the schema of Kubernetes, field by field and without unknown ones.

usage: manifests.py BINARY WORK_FOLDER
"""

import pathlib
import re
import subprocess
import sys

import kubernetes_validate
import yaml

BINARY, WORK = sys.argv[1], pathlib.Path(sys.argv[2])
# A name that breaks a template without escaping: special characters of YAML (including a line separator), the shell and Kubernetes.
PLAN = WORK / "it's: a #plan\u2028kind: Secret $(HOME) $$(HOME) `touch pwned`; \\ \"x\" \U0001f600"
DATASET = "synthetic=size=48x36,views=4"


def sharp_bench(*arguments):
    subprocess.run([BINARY, "--quiet", *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


sharp_bench("run", "--dataset", DATASET, "--method", "copy", "--metrics", "psnr", "--plan-only", "--out", PLAN)
sharp_bench(
    *["scale", "kubernetes", "--plan", PLAN, "--shards", 3, "--image", "registry/sharp-bench:1"],
    *["--claim", "data", "--mount", WORK.resolve(), "--out", WORK / "jobs"],
)
def expanded(part):
    """As Kubernetes does it: two dollars are one, and $(NAME) a variable where there is one."""
    return re.sub(r"\$\$|\$\((\w+)\)", lambda found: "$" if found[0] == "$$" else f"<value of {found[1]}>", part)


for name in ["job.yaml", "merge.yaml"]:
    manifest = yaml.safe_load((WORK / "jobs" / name).read_text())
    version = kubernetes_validate.validate(manifest, kubernetes_validate.latest_version(), strict=True)
    assert manifest["kind"] == "Job", manifest["kind"]
    command = manifest["spec"]["template"]["spec"]["containers"][0]["command"]
    command = [expanded(part) for part in command]
    if name == "job.yaml":
        # Runs here what a pod would run, for each index.
        for index in range(3):
            environment = {"JOB_COMPLETION_INDEX": str(index), "PATH": f"{pathlib.Path(BINARY).resolve().parent}:/usr/bin:/bin"}
            subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
    else:
        subprocess.run([BINARY, *command[1:]], check=True, stdout=subprocess.DEVNULL)
    print(f"{name}: valid for Kubernetes {version}, and does its work")
