import csv
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import sharp_bench as sb

DATASET = "S:synthetic=size=48x36,views=4"
OPTIONS = "sets=whole,threshold=0,at-threshold=in,limit=all"


def copy(source, camera):
    return source.image()


def run(function, out, **options):
    options = {"metrics": "psnr,ssim", "pair_options": OPTIONS, **options}
    return sb.evaluate(function, DATASET, out, **options)


def test_datasets_are_scenes_and_views_as_arrays(tmp_path):
    (dataset,) = sb.datasets(DATASET)
    assert dataset.name == "S" and dataset.format == "synthetic" and len(dataset.scenes) == 1
    view = dataset.scenes[0].views[1]
    image, depth = view.image(), view.depth()
    assert image.shape == (36, 48, 3) and image.dtype == np.uint8
    assert depth.shape == (36, 48) and depth.dtype == np.float32 and (depth >= 0).all() and depth.max() > 0
    assert view.valid_pixels() is None
    camera = view.camera
    assert (camera.width, camera.height) == (48, 36) and camera.K.shape == (3, 3) and camera.K[2].tolist() == [0, 0, 1]
    pose = camera.camera_from_world
    assert pose.shape == (4, 4) and np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
    again = sb.Camera(48, 36, camera.K.tolist(), pose)
    assert np.allclose(again.camera_from_world, pose, atol=1e-14) and (again.K == camera.K).all()
    real = sb.datasets(f"middlebury={sb.bundled_data(tmp_path)}")[0].scenes[0]
    assert len(real.views) == 2 and real.views[0].image().shape[2] == 3
    with pytest.raises(TypeError, match="a dataset is needed"):
        sb.datasets()
    with pytest.raises(sb.Error, match="nowhere"):
        sb.datasets(f"middlebury={tmp_path / 'nowhere'}")


def test_cameras_are_checked():
    k = [[50, 0, 24], [0, 50, 18], [0, 0, 1]]
    for change, said in [
        ({"K": [[50, 1, 24], [0, 50, 18], [0, 0, 1]]}, "cx"),
        ({"K": [[50, 0], [0, 50]]}, "3×3"),
        ({"K": [[-50, 0, 24], [0, 50, 18], [0, 0, 1]]}, "50"),
        ({"camera_from_world": np.eye(3)}, "4×4"),
        ({"camera_from_world": np.diag([2.0, 1, 1, 1])}, "not rigid"),
        ({"camera_from_world": np.full((4, 4), np.nan)}, ""),
    ]:
        with pytest.raises(ValueError, match=said):
            sb.Camera(**{"width": 48, "height": 36, "K": k, **change})


def test_pairs_are_the_list_of_the_command_line(program, tmp_path):
    table = sb.pairs(DATASET, options=OPTIONS, out=tmp_path / "mine.csv")
    program("pairs", "--dataset", DATASET, "--pair-options", OPTIONS, "--out", tmp_path / "theirs.csv")
    assert (tmp_path / "mine.csv").read_bytes() == (tmp_path / "theirs.csv").read_bytes()
    assert len(table) == 12 and all(table["selected"]) and "<td>S/seed0/" in table._repr_html_()
    with pytest.raises(ValueError, match="threshold"):
        sb.pairs(DATASET, options="threshold=x")


def test_a_function_scores_as_the_built_in_method_does(program, tmp_path):
    mine = run(copy, tmp_path / "mine", label="copy")
    options = ["--pair-options", OPTIONS, "--metrics", "psnr,ssim", "--out", tmp_path / "theirs"]
    program("run", "--dataset", DATASET, "--method", "copy", *options)
    assert (tmp_path / "mine/scores.csv").read_bytes() == (tmp_path / "theirs/scores.csv").read_bytes()
    assert mine.counts == {"units": 12, "reused": 0, "scored": 12, "failed": 0, "left": 0}
    # Reused the second time, and predicted again under another version.
    assert run(copy, tmp_path / "mine", label="copy").counts["reused"] == 12
    assert run(copy, tmp_path / "mine", label="copy", version="2").counts["scored"] == 12
    assert "copy" in str(mine) and "<table" in mine._repr_html_()


def test_shards_give_the_bytes_of_the_whole(program, tmp_path):
    def shard(out, shard, **options):
        return run(copy, tmp_path / out, methods=["mean"], shard=shard, **options)

    whole = run(copy, tmp_path / "whole", methods=["mean"])
    expected = (tmp_path / "whole/scores.csv").read_bytes()
    # Both make the plan at the same time.
    with ThreadPoolExecutor() as pool:
        counts = [done.counts for done in pool.map(lambda which: shard("shared", which), [(1, 2), "2/2"])]
    assert [count["scored"] for count in counts] == [12, 12] and not (tmp_path / "shared/scores.csv").exists()
    merged = sb.merge(tmp_path / "shared")
    assert merged.counts == {"units": 24, "missing": 0, "failed": 0} and merged.scores.to_dict() == whole.scores.to_dict()
    assert (tmp_path / "shared/scores.csv").read_bytes() == expected
    # A folder each.
    parts = [shard(f"part{i}", (i, 3)).path for i in (1, 2, 3)]
    with pytest.warns(UserWarning, match="units are missing"):
        assert sb.merge(parts[0]).counts["missing"] > 0
    assert sb.merge(*parts, out=tmp_path / "joined").counts["missing"] == 0
    program("merge", *parts, "--out", tmp_path / "command")
    for joined in ("joined", "command"):
        assert (tmp_path / joined / "scores.csv").read_bytes() == expected
    for options, error, said in [
        ({"limit": 3}, sb.Error, "planned with other pairs"),
        ({"version": "2"}, sb.Error, "version"),
        ({"common_region": True}, sb.Error, "shards cannot"),
        ({"shard": (3, 2)}, ValueError, "numbered from 1"),
        ({"shard": "half"}, ValueError, "shard: 'half'"),
        ({"shard": 1}, TypeError, "shard=1: expected"),
    ]:
        with pytest.raises(error, match=said):
            run(copy, tmp_path / "shared", **{"methods": ["mean"], "shard": "1/2", **options})


def test_a_function_may_return_a_tensor(tmp_path):
    torch = pytest.importorskip("torch")

    def planes(source, camera):
        return torch.from_numpy(source.image()).permute(2, 0, 1).contiguous()

    arrays, tensors = (run(function, tmp_path / function.__name__, label="copy", version="1") for function in (copy, planes))
    assert arrays.scores["psnr"] == tensors.scores["psnr"]


def test_scores_are_a_table_for_everyone(tmp_path):
    scores = run(copy, tmp_path / "r", methods=["mean"]).scores
    assert len(scores) == 24 and set(scores["method"]) == {"copy", "mean"}
    assert scores["reason"] == [None] * 24 and all(isinstance(value, float) for value in scores["psnr"])
    with open(tmp_path / "r/scores.csv", newline="") as file:
        assert next(csv.reader(file)) == scores.columns
    with pytest.raises(KeyError, match="no column"):
        scores["nonsense"]
    pandas, polars = pytest.importorskip("pandas"), pytest.importorskip("polars")
    frame = scores.to_polars()
    assert frame["psnr"].to_list() == scores["psnr"] and frame.shape == (24, len(scores.columns))
    other = scores.to_pandas()
    assert isinstance(frame, polars.DataFrame) and isinstance(other, pandas.DataFrame)
    means = frame.group_by("method").agg(polars.col("psnr").mean())
    assert other.groupby("method")["psnr"].mean().to_dict() == pytest.approx(dict(means.iter_rows()))


def test_what_a_function_raises_or_returns_wrongly_fails_that_pair_alone(tmp_path):
    wrong = iter([ValueError("no idea"), "picture", np.zeros((5, 5, 3), np.uint8), np.full((36, 48, 3), 2.0), None])

    def moody(source, camera):
        answer = next(wrong, source.image())
        if isinstance(answer, Exception):
            raise answer
        return answer

    done = run(moody, tmp_path / "r", version="1")
    assert done.counts["failed"] == 5 and sum(value is not None for value in done.scores["psnr"]) == 7
    reasons = " ".join(reason for reason in done.scores["reason"] if reason)
    for said in ["ValueError: no idea", "a str", "5x5", "0..1", "NoneType"]:
        assert said in reasons, reasons
    # Failures are retried.
    assert run(moody, tmp_path / "r", version="1").counts["failed"] == 0


def test_gaussians_by_pair_or_by_source(tmp_path):
    # A grey wall of Gaussians, 2 m before the source.
    y, x = np.mgrid[-2:2:40j, -2:2:40j]
    means = np.stack([x, y, np.full_like(x, 2)], -1).reshape(-1, 3)
    count = len(means)
    wall = sb.Gaussians(means, np.tile([1, 0, 0, 0], (count, 1)), np.full((count, 3), 0.08), np.full(count, 0.9), np.full((count, 3), 0.2))
    by_pair = run(lambda source, camera: wall, tmp_path / "pair", label="wall", version="1")
    by_source = run(lambda source: wall, tmp_path / "source", label="wall", version="1")
    assert by_pair.counts["failed"] == by_source.counts["failed"] == 0
    assert by_pair.scores["psnr"] == by_source.scores["psnr"]
    with pytest.raises(TypeError, match="3 arguments"):
        run(lambda a, b, c: wall, tmp_path / "three", version="1")
    with pytest.raises(ValueError, match="version"):
        run(eval("lambda source: 1"), tmp_path / "none")


def test_rendering_is_the_command_lines(program, tmp_path):
    from PIL import Image

    rng = np.random.default_rng(3)
    means = rng.normal([0, 0, 3], [0.5, 0.5, 0.2], (200, 3))
    gaussians = sb.Gaussians(means, rng.normal(size=(200, 4)), rng.uniform(0.02, 0.1, (200, 3)), rng.uniform(0.2, 1, 200), rng.random((200, 3)))
    camera = sb.Camera(64, 48, [[60, 0, 32], [0, 60, 24], [0, 0, 1]])
    gaussians.save(tmp_path / "g.ply", camera)
    read = sb.Gaussians.load(tmp_path / "g.ply")
    assert len(read) == 200 and np.allclose(read.means, gaussians.means) and np.allclose(read.colors, gaussians.colors, atol=1e-5)
    rendering = sb.render(read, camera)
    assert rendering.picture.shape == rendering.linear.shape == (48, 64, 3) and rendering.alpha.shape == rendering.depth.shape == (48, 64)
    assert 0.5 < rendering.alpha.max() < 1 and 2 < rendering.depth[rendering.alpha > 0.5].mean() < 4
    program("render", tmp_path / "g.ply", "--out", tmp_path / "g.png")
    assert (np.asarray(Image.open(tmp_path / "g.png")) == rendering.picture).all()
    with pytest.raises(ValueError, match="black or white"):
        sb.render(read, camera, background="grey")
    with pytest.raises(ValueError, match="columns|expected"):
        sb.Gaussians(means[:, :2], np.zeros((200, 4)), means, np.zeros(200), means)
    with pytest.raises(ValueError, match="differ in length"):
        sb.Gaussians(means[:9], np.zeros((200, 4)), means, np.zeros(200), means)


def test_runs_are_compared_and_swept_as_by_the_command_line(program, tmp_path):
    for name, methods in (("a", "copy"), ("b", "mean")):
        run(copy if name == "a" else lambda source, camera: source.image()[::-1], tmp_path / name, label="mine", version=methods)
    compared = sb.compare(tmp_path / "a", tmp_path / "b")
    assert compared == json.loads(program("compare", tmp_path / "a", tmp_path / "b", "--json"))
    assert compared["rows"][0]["difference"] < 0 and compared["rows"][0]["n_pairs"] == 12
    swept = sb.sweep(tmp_path / "a", x="rotation_deg", bins="quantile:2", metrics=["psnr"])
    program("sweep", tmp_path / "a", "--x", "rotation_deg", "--bins", "quantile:2", "--metrics", "psnr", "--out", tmp_path / "s")
    assert swept.csv == (tmp_path / "s/sweep.csv").read_text() and "<svg" in swept._repr_html_() and list(swept.figures) == ["psnr"]
    with pytest.raises(ValueError, match='x="speed": expected one of baseline_m'):
        sb.sweep(tmp_path / "a", x="speed")


def test_progress_and_warnings(tmp_path):
    seen = []
    run(copy, tmp_path / "r", progress=lambda *told: seen.append(told))
    assert seen and all(len(told) == 3 for told in seen)


def test_contradictions_of_a_dataset_are_warnings(tmp_path):
    swapped = Path(__file__).parent.parent / "cases/X63-stereo-swapped/st"
    with pytest.warns(UserWarning, match="left and right are swapped"):
        sb.pairs(f"stereo={swapped}")
    with pytest.warns(UserWarning, match="left and right are swapped"):
        sb.evaluate(copy, f"stereo={swapped}", tmp_path / "r", metrics="psnr")


def test_a_file_and_keywords_say_the_same(tmp_path):
    run(None, tmp_path / "a", methods=["copy"], limit=2)
    again = sb.evaluate(None, config=tmp_path / "a" / "run.toml", out=tmp_path / "b")
    assert again.counts["scored"] == 2 and (tmp_path / "b" / "run.toml").read_bytes() == (tmp_path / "a" / "run.toml").read_bytes()
    fewer = sb.evaluate(copy, config=tmp_path / "a" / "run.toml", out=tmp_path / "c", limit=1, label="mine")
    assert fewer.counts["scored"] == 2
    for options, said in [({"limits": 3}, "limits"), ({"backend": "abacus"}, "abacus"), ({"limit": -1}, "-1")]:
        with pytest.raises(ValueError, match=said):
            run(copy, tmp_path / "w", **options)
    with pytest.raises(TypeError, match="out="):
        sb.evaluate(copy, DATASET)


def test_the_program_within_the_package():
    import subprocess
    import sys
    import os

    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    told = subprocess.run([sys.executable, "-m", "sharp_bench", "--version"], capture_output=True, text=True, env=environment)
    assert told.returncode == 0 and told.stdout.startswith("sharp-bench ")
    told = subprocess.run([sys.executable, "-m", "sharp_bench", "run"], capture_output=True, text=True, env=environment)
    assert told.returncode == 2 and "--dataset" in told.stderr


def test_progress_is_a_bar_of_tqdm_or_a_line(tmp_path, capsys):
    pytest.importorskip("tqdm")
    done = run(copy, tmp_path / "r", progress=True)
    assert done.counts["scored"] == 12 and "12/12" in capsys.readouterr().err


def test_commands_are_functions(tmp_path):
    scenes = f"{DATASET},scenes=2"
    old, new = (sb.evaluate(copy, scenes, tmp_path / name, methods=["mean"], metrics="psnr", limit=8) for name in ("old", "new"))
    report = sb.report(old.path, out=tmp_path / "page", methods=["mean", "copy"], rename={"copy": "Ours"}, uncertainty="se")
    assert Path(report["out"], "index.html").is_file()
    table = (tmp_path / "page/tables/scores.csv").read_text().splitlines()
    assert table[0].endswith(",scenes,se") and [line.split(",")[0] for line in table[1:3]] == ["mean", "Ours"]
    assert sb.gate(old.path, new.path)["gate"]["state"] == "passed"
    other = sb.gate(old.path, new.path, ["psnr < -0.1"], methods=[("copy", "mean")])["gate"]
    assert {check["method_b"] for check in other["checks"]} == {"mean"}
    assert sb.gate(old, new, ["psnr < -0.1"], methods=["mean"])["gate"]["state"] == "passed"
    assert {row["method_a"] for row in sb.compare(old, new, ["mean"])["rows"]} == {"mean"}
    renamed = sb.compare(old, new, metrics=["psnr"], rename={"copy": "Ours"}, breakdown=True)
    assert {row["method_a"] for row in renamed["rows"]} == {"mean", "Ours"}
    # A method can be named by its old and by its new name.
    for name in ["copy", "Ours"]:
        assert {row["method_a"] for row in sb.compare(old, new, [name], rename={"copy": "Ours"})["rows"]} == {"Ours"}
    swept = sb.sweep(old, methods=["Ours"], datasets=["s"], rename={"copy": "Ours"}, metrics="psnr").csv.splitlines()
    assert {line.split(",")[1] for line in swept[1:]} == {"Ours"}
    with pytest.raises(ValueError, match="--method"):
        sb.compare(old)
    with pytest.raises(ValueError, match="no method 'absent'"):
        sb.sweep(old, methods=["absent"])
    crossed = sb.compare(old.path, new.path, [("copy", "mean"), ("mean", "copy")], flips=True)["flips"]
    assert [flips["n_pairs"] for flips in crossed] == [8] and len(crossed[0]["pairs"]) == 8
    added = sb.history("add", tmp_path / "history", old.path, label="first")
    assert added["is_new"] and sb.history("show", tmp_path / "history")["entries"][0]["label"] == "first"
    with pytest.warns(UserWarning, match="none of your rows has a number"):
        assert sb.table("quantitative", {"mine": f"{old.path}:copy"})["table"] == "quantitative"
    made = sb.figure("baselines", old.path, out=tmp_path / "figures")
    assert len(made["files"]) == 3
    with pytest.raises(ValueError, match="--methods"):
        sb.report(old.path, methods=["absent"], out=tmp_path / "other")
