"""The blocks of commands in the documents, run as they stand, in a folder that holds what their text speaks of."""

import os
import pathlib
import re
import shutil
import subprocess

import numpy as np
import pytest
from conftest import PROGRAM, ROOT
from layouts import write_all
from PIL import Image

import sharp_bench as sb

PAGES = ["README.md", "bench/python/README.md", *sorted(str(page.relative_to(ROOT)) for page in (ROOT / "bench/docs").rglob("*.md"))]
TEXTS = [*PAGES, "ARCHITECTURE.md", "TESTING.md"]
# What other stages of CI run, and what needs more than this repository. A page says so above the block.
NOT_RUN = {
    ("bench/docs/network.md", "needs the official checkpoint"),
    ("bench/docs/network.md", "a changed model of yours"),
    ("bench/docs/recipes.md", "needs the project itself"),
    ("bench/docs/scale.md", "needs a cluster"),
    ("bench/docs/slurm.md", "needs a cluster"),
    ("bench/docs/security.md", "needs cargo-deny and the network"),
}
ELSEWHERE = ("cargo run --release -p sharp-bench -- demo", "cargo test ", "cargo doc ", "pip install ./bench/python", ".ci/", "git clone ")
BLOCK = re.compile(r"(?:<!-- not run: (.*?) -->\n)?```console\n(.*?)```", re.DOTALL)


def blocks(page):
    return BLOCK.findall((ROOT / page).read_text())


def commands(block):
    """Lines behind `$ `, joined where they go on; other lines are what comes out."""
    found = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append(line[2:])
        elif found and found[-1].endswith("\\"):
            found[-1] = found[-1][:-1] + line.strip()
    return found


def run(command, folder):
    stated = re.search(r"# exits (\d+)", command)
    environment = dict(os.environ, PATH=f"{pathlib.Path(PROGRAM).parent}:{os.environ['PATH']}", HOME=str(folder), NO_COLOR="1")
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=environment, capture_output=True, text=True)
    expected = int(stated[1]) if stated else 0
    assert done.returncode == expected, f"{command}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="session")
def world(tmp_path_factory):
    """Datasets, runs, pictures and Gaussians under the names that the pages use."""
    folder = tmp_path_factory.mktemp("world")
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
    for name in ("prediction.png", "a.png", "photo.png"):
        shutil.copy(source, folder / name)
    for name in ("target.png", "b.png"):
        shutil.copy(target, folder / name)
    Image.open(source).save(folder / "photo.jpg", quality=95)
    small = Image.open(source).resize((96, 64))
    for name in ("predicted", "targets", "masks"):
        (folder / name).mkdir()
        picture = Image.fromarray(np.full((64, 96), 255, np.uint8)) if name == "masks" else small.rotate(name == "targets")
        picture.save(folder / name / "1.png")
    # What "your method" has made by its loop.
    made = folder / "predictions/middlebury/Motorcycle-quarter/im0__im1.png"
    made.parent.mkdir(parents=True)
    shutil.copy(source, made)
    shutil.copy(ROOT / "tests/golden/model/tiny_golden.ply", folder / "photo.ply")
    (folder / "cam.json").write_text(
        '{"width": 96, "height": 72, "K": [80,0,48, 0,80,36, 0,0,1], "camera_from_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}'
    )
    write_all(folder / "data")
    # Other people's list of the second of these.
    (folder / "theirs.json").write_text('{"room": {"context": [0, 3], "target": [1, 2]}}')
    run("git init -q . && git -c user.name=a -c user.email=a@b commit -q --allow-empty -m one", folder)
    return folder


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_run(page, world, tmp_path):
    found = blocks(page)
    if not any(not reason for reason, _ in found):
        pytest.skip("no commands, or none that run here")
    folder = tmp_path / "w"
    shutil.copytree(world, folder, symlinks=True)
    for reason, block in found:
        if reason:
            continue
        for command in commands(block):
            if not command.startswith(ELSEWHERE):
                run(command, folder)


def test_what_is_not_run_is_known():
    named = {(page, reason) for page in PAGES for reason, _ in blocks(page) if reason}
    assert named <= NOT_RUN


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
