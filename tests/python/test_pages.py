"""Runs the command blocks of the pages, unchanged, in a folder with the files that the pages mention."""

import collections
import fcntl
import os
import pathlib
import re
import shutil
import subprocess
import textwrap

import numpy as np
import pytest
from conftest import PROGRAM, ROOT
from layouts import write_all
from PIL import Image

import sharp_bench as sb

PAGES = ["README.md", "bench/python/README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "bench/docs").rglob("*.md"))]
TEXTS = [*PAGES, "ARCHITECTURE.md", "TESTING.md"]
# Blocks that need more than this repository, with the reason that the page states above them, and their number.
NOT_RUN = {
    ("bench/docs/network.md", "needs the official checkpoint"): 1,
    ("bench/docs/network.md", "a changed model of yours"): 1,
    ("bench/docs/network.md", "needs Depth Pro's checkpoint"): 1,
    ("bench/docs/your-method.md", "needs a scene that was trained"): 1,
    ("bench/docs/train.md", "takes hours"): 1,
    ("bench/docs/recipes.md", "needs the project itself"): 2,
    ("bench/docs/reproduce-table-1.md", "needs the six datasets and the checkpoint"): 1,
    ("bench/docs/scale.md", "needs a cluster"): 2,
    ("bench/docs/security.md", "needs cargo-deny 0.20 and the network"): 1,
}
# Commands that other stages of CI run.
ELSEWHERE = ("cargo run --release -p sharp-bench -- demo", "cargo test ", "cargo doc ", "pip install .", ".ci/", "git clone ")
BUILT = "cargo run --release -p sharp-bench -- "
LANGUAGES = {"console", "python", "rust", "text", "toml"}
BLOCK = re.compile(r"(?:^ *<!-- not run: ([^\n]*?) -->\n)?^( *```console\n.*?)^ *```$", re.DOTALL | re.MULTILINE)


def blocks(page):
    """For each block, the reason why it is not run (or nothing) and its lines; blocks within lists are indented."""
    text = (ROOT / page).read_text()
    found = [(reason, textwrap.dedent(block).partition("\n")[2]) for reason, block in BLOCK.findall(text)]
    assert len(found) == text.count("```console"), f"{page}: a block that does not end"
    return found


def commands(block):
    """Lines after `$ `, with continuation lines joined; all other lines are output."""
    found = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append(line[2:])
        elif found and found[-1].endswith("\\"):
            found[-1] = found[-1][:-1] + line.strip()
    return found


def run_here(block):
    """The commands of a block without those of other stages, using the program that is already built."""
    return [re.sub(f"^{BUILT}", "sharp-bench ", command) for command in commands(block) if not command.startswith(ELSEWHERE)]


def run(command, folder):
    stated = re.search(r"# exits (\d+)", command)
    environment = dict(os.environ, PATH=f"{pathlib.Path(PROGRAM).parent}:{os.environ['PATH']}", HOME=str(folder), NO_COLOR="1")
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    expected = int(stated[1]) if stated else 0
    assert done.returncode == expected, f"{command}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="session")
def world(tmp_path_factory):
    """The folder that `build_world` fills, only once if several processes share the tests."""
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    folder, complete = base / "world", base / "world-is-complete"
    with (base / "world.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not complete.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            build_world(folder)
            complete.touch()
    return folder


def build_world(folder):
    """Datasets, runs, pictures and Gaussians under the names that the pages use."""
    (folder / "data").mkdir()
    pathlib.Path(sb.bundled_data(folder / "unpacked")).rename(folder / "data/Middlebury2014")
    scenes = "run --dataset synthetic=size=48x36,views=6,scenes=6 --limit 12 --method copy --keep float --quiet"
    for name, methods in {
        "all": "--method depth-splat --method depth-splat:label=sharp,resolution=48",
        "v1": "--method depth-splat:label=sharp", "v2": "--method depth-splat:label=sharp,resolution=48 --method depth-splat:label=sharp-new",
        "sharp": "--method depth-splat:label=sharp", "nightly": "", "now": "",
    }.items():
        metrics = "paper" if name == "all" else "psnr,lpips"
        run(f"sharp-bench {scenes} {methods} --metrics {metrics} --out runs/{name}", folder)
    run("sharp-bench run --dataset synthetic=size=48x36,views=6,scenes=6 --metrics psnr,lpips --limit 12 --method mean --keep float --quiet --out runs/others", folder)
    run("sharp-bench run --dataset middlebury=data/Middlebury2014 --method copy --method depth-splat:label=sharp --quiet --out runs/first", folder)
    run("sharp-bench bundle runs/nightly --out baseline.zip", folder)
    (folder / "gate.toml").write_text('fail_if = ["psnr < -0.1", "lpips > +0.005"]\n')
    source = next((folder / "data/Middlebury2014").rglob("im0.png"))
    target = source.with_name("im1.png")
    # Small, because the time of most commands grows with the number of pixels.
    left, right = (Image.open(picture).resize((240, 168)) for picture in (source, target))
    for name in ("prediction.png", "a.png", "photo.png", "photo.jpg"):
        left.save(folder / name, quality=95)
    for name in ("target.png", "b.png"):
        right.save(folder / name)
    small = left.resize((96, 64))
    for name in ("predicted", "targets", "masks"):
        (folder / name).mkdir()
        picture = Image.fromarray(np.full((64, 96), 255, np.uint8)) if name == "masks" else small.rotate(name == "targets")
        picture.save(folder / name / "1.png")
    # The output of "your method".
    made = folder / "predictions/middlebury/Motorcycle-quarter/im0__im1.png"
    made.parent.mkdir(parents=True)
    shutil.copy(source, made)
    gaussians = folder / "gaussians/middlebury/Motorcycle-quarter/im0.ply"
    gaussians.parent.mkdir(parents=True)
    shutil.copy(ROOT / "tests/golden/model/tiny_golden.ply", gaussians)
    run("sharp-bench predict photo.png --checkpoint mini --focal-px 240 --out photo.ply", folder)
    (folder / "cam.json").write_text(
        '{"width": 96, "height": 72, "K": [80,0,48, 0,80,36, 0,0,1], "camera_from_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}'
    )
    write_all(folder / "data")
    # A published list for the second of these.
    (folder / "theirs.json").write_text('{"room": {"context": [0, 3], "target": [1, 2]}}')
    run("git init -q . && git -c user.name=a -c user.email=a@b commit -q --allow-empty -m one", folder)


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(page, world, tmp_path):
    found = blocks(page)
    if not any(run_here(block) for reason, block in found if not reason):
        pytest.skip("no commands, or none that run here")
    folder = tmp_path / "w"
    shutil.copytree(world, folder, symlinks=True)
    for reason, block in found:
        for command in [] if reason else run_here(block):
            run(command, folder)


def test_what_is_not_run_is_known():
    assert collections.Counter((page, reason) for page in PAGES for reason, _ in blocks(page) if reason) == NOT_RUN


@pytest.mark.parametrize("page", TEXTS)
def test_every_command_of_a_page_is_found(page):
    text = (ROOT / page).read_text()
    assert set(re.findall(r"^ *```(\S.*)$", text, re.MULTILINE)) <= LANGUAGES
    listed = [command for _, block in blocks(page) for command in commands(block)]
    assert len(listed) == len(re.findall(r"^ *\$ ", text, re.MULTILINE)), "a command outside of a block of commands"
    assert all(commands(block) for _, block in blocks(page)), "a block without a command"


def test_commands_are_those_behind_a_dollar():
    text = "$ a  # exits 4\noutput\n$ b \\\n      c \\\n      d\n$ cargo test x\n$ cargo run --release -p sharp-bench -- e f\n"
    assert commands(text)[:2] == ["a  # exits 4", "b c d"]
    assert run_here(text) == ["a  # exits 4", "b c d", "sharp-bench e f"]


def anchors(text):
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", re.sub(r"`|\[([^\]]*)\]\([^)]*\)", r"\1", head)).strip().lower().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", TEXTS)
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```", "", (ROOT / page).read_text(), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if "://" in target:
            continue
        path, _, anchor = target.partition("#")
        file = (ROOT / page).parent / path if path else ROOT / page
        assert file.exists(), f"{page}: {target}"
        if anchor and file.suffix == ".md":
            assert anchor in anchors(file.read_text()), f"{page}: {target}"


def test_the_book_lists_every_page_once():
    docs = ROOT / "bench/docs"
    listed = re.findall(r"\]\(([^)]+)\)", (docs / "SUMMARY.md").read_text())
    pages = sorted(str(page.relative_to(docs)) for page in docs.rglob("*.md") if page.name != "SUMMARY.md")
    assert sorted(listed) == pages
