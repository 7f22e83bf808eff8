"""The recipes of bench/recipes, each through a whole run, against stubs with the interface of the project it calls.

The stubs know that the scene is a plane and warp the source by the cameras that reach them. A recipe that hands over
cameras by another convention, or reads the answer by one, gets a picture of the wrong place: its score has to be above
those of the pictures that likely mistakes give, down to half a pixel.
"""

import csv
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

import sharp_bench as sb

torch = pytest.importorskip("torch")

ROOT = pathlib.Path(__file__).parents[2]
STUBS = pathlib.Path(__file__).parent / "stubs"
RECIPES = ROOT / "bench/recipes"
PAIRS = "sets=whole,threshold=0,at-threshold=in,limit=all,missing-depth=accept,order=once"
SQUARE = "crop=center:1:1,resize=bicubic"
TMPI = "--checkpoint {0}/tmpi.pth --depth-checkpoint {0}/sharp.pt"
VIDEO = ["crop=center:16:9,resize=bicubic", "crop=center:20:11,resize=bicubic"]
DEPTH = 2.0  # metres from the source to the plane

# Principal points far from the middle, pixels that are not square, and sizes of another aspect.
SOURCE = {"size": (384, 288), "K": np.array([[300, 0, 201.4], [0, 306, 138.2], [0, 0, 1]])}
TARGET = {"size": (388, 296), "K": np.array([[440, 0, 187.3], [0, 433, 154.9], [0, 0, 1]])}


def turned(yaw, pitch, roll):
    a, b, c = np.radians([yaw, pitch, roll])
    y = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    x = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    z = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    return z @ x @ y


POSE = np.eye(4)
POSE[:3, :3], POSE[:3, 3] = turned(1, 2, 2), (-0.1, 0.07, -0.12)


def picture(size, K, pose=np.eye(4)):
    """The plane z = DEPTH of the source camera, seen by a camera whose space `pose` leads to: [H, W, 3] of levels."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(K).T
    inverse = np.linalg.inv(pose)
    rays = rays @ inverse[:3, :3].T
    points = inverse[:3, 3] + rays * ((DEPTH - inverse[2, 3]) / rays[..., 2:])
    waves = [np.sin(points[..., :2] @ (a, b) + a) for a, b in ((25, 6), (-8, 22), (17, -18))]
    return np.round(128 + 80 * np.stack(waves, -1)).astype(np.uint8)


def psnr(a, b):
    return 10 * np.log10(255**2 / np.mean((a.astype(float) - b) ** 2))


def shifted(K, x, y):
    return K + [[0, 0, x], [0, 0, y], [0, 0, 0]]


def best_mistake(metric):
    """The highest score among pictures that likely mistakes give. Without metric scale, a wrong scale is not a mistake."""
    flip = np.diag([1, -1, -1, 1])
    further = POSE.copy()
    further[:3, 3] *= 1.1
    size, K = TARGET["size"], TARGET["K"]
    width, height = size
    wrong = {
        "the inverse pose": picture(size, K, np.linalg.inv(POSE)),
        "OpenGL axes": picture(size, K, flip @ POSE @ flip),
        "square pixels": picture(size, K * [[1, 1, 1], [0, K[0, 0] / K[1, 1], 1], [1, 1, 1]], POSE),
        "the principal point in the middle": picture(size, shifted(K, width / 2 - K[0, 2], height / 2 - K[1, 2]), POSE),
        "half a pixel to the right": picture(size, shifted(K, 0.5, 0), POSE),
        "half a pixel down": picture(size, shifted(K, 0, 0.5), POSE),
        **({"a baseline longer by a tenth": picture(size, K, further)} if metric else {}),
    }
    truth = picture(size, K, POSE)
    scores = {mistake: psnr(seen, truth) for mistake, seen in wrong.items()}
    return max(scores.values())


@pytest.fixture(scope="module")
def datasets(tmp_path_factory):
    """The plane as a folder of nerfstudio's form, and the bundled pair."""
    folder = tmp_path_factory.mktemp("data")
    frames = []
    for name, camera, pose in (("a", SOURCE, np.eye(4)), ("b", TARGET, POSE)):
        (width, height), K = camera["size"], camera["K"]
        Image.fromarray(picture((width, height), K, pose)).save(folder / f"{name}.png")
        depth = {"depth_file_path": "depth.png"} if name == "a" else {}
        world_from_camera = np.linalg.inv(pose) @ np.diag([1, -1, -1, 1])
        frames.append(
            {"file_path": f"{name}.png", **depth, "w": width, "h": height, "transform_matrix": world_from_camera.tolist()}
            | {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
        )
    depth = np.full(SOURCE["size"][::-1], DEPTH * 1000, np.uint16)
    depth[::3] = 0  # unknown
    Image.fromarray(depth).save(folder / "depth.png")
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))
    return [f"P:nerfstudio={folder}", f"M:middlebury={sb.bundled_data(tmp_path_factory.mktemp('bundled'))}"]


def scores(run, names=("P", "M")):
    with open(run / "scores.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert sorted(row["dataset"] for row in rows) == sorted(names)
    assert all(row["status"] == "ok" for row in rows), rows
    return {row["dataset"]: float(row["psnr"]) for row in rows}


@pytest.fixture
def stubs(monkeypatch):
    monkeypatch.setenv("STUB_DEPTH", str(DEPTH))
    monkeypatch.setenv("STUB_BASELINE", str(np.linalg.norm(POSE[:3, 3])))
    monkeypatch.setenv("STUB_FOCAL", str(SOURCE["K"][0, 0] / SOURCE["size"][0]))

    def use(name):
        folders = [STUBS / name, STUBS / "common", ROOT / "bench/python"]
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, folders)))

    return use


def write_weights(folder):
    """The weights file that each recipe receives."""
    torch.save({"weight": torch.ones(1)}, folder / "sharp.pt")
    unisharp = {"config": {"initializer_scale_factor": 1.25, "unheard_of": 1}, "unik3d_backbone": "vitb"}
    torch.save(unisharp, folder / "unisharp.pt")
    torch.save({"model": {}}, folder / "lvsm.pt")
    torch.save({"module.weight": torch.ones(1)}, folder / "tmpi.pth")
    (folder / "cars/.hydra").mkdir(parents=True)
    data = {"training_resolution": 128, "fov": 51.98948897809546, "znear": 0.8, "zfar": 1.8, "category": "cars"}
    (folder / "cars/.hydra/config.yaml").write_text(json.dumps({"data": {**data, "white_background": True}}))
    torch.save({"model_state_dict": {"weight": torch.ones(1)}}, folder / "cars/model_latest.pth")
    training = {"num_views": 8, "num_input_views": 2, "num_target_views": 6, "target_has_input": True}
    training |= {"lpips_loss_weight": 0.0, "perceptual_loss_weight": 0.5, "scene_scale_factor": 1.35}
    training |= {"use_amp": False, "amp_dtype": "bf16"}
    model = {"class_name": "model.LVSM_scene_decoder_only.Images2LatentScene", "image_tokenizer": {"image_size": 256}}
    config = {"model": model, "training": training, "inference": {"if_inference": False}}
    (folder / "lvsm.yaml").write_text(json.dumps(config))


@pytest.mark.parametrize("recipe, weights", [("sharp_release", "sharp.pt"), ("uni_sharp", "unisharp.pt")])
def test_recipes_that_predict_gaussians(recipe, weights, datasets, stubs, tmp_path):
    write_weights(tmp_path)
    stubs({"sharp_release": "sharp"}.get(recipe, recipe))
    command = [sys.executable, RECIPES / f"{recipe}.py", "--device", "cpu", "--checkpoint", tmp_path / weights]
    command += ["--out", tmp_path / "run", "--metrics", "psnr", "--pair-options", PAIRS]
    for dataset in datasets:
        command += ["--dataset", dataset]
    done = subprocess.run(list(map(str, command)), check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert scores(tmp_path / "run")["P"] > best_mistake(metric=True)


@pytest.mark.parametrize(
    "recipe, stub, arguments, fit, metric",
    [
        ("flash3d", "flash3d", "--checkpoint {}/sharp.pt", "resize=bicubic", True),
        ("splatter_image", "splatter_image", "--model {}/cars --units-per-metre 0.5", SQUARE, True),
        ("stable_virtual_camera", "seva", "--camera-scale 1", "timeout=60", False),
        ("lvsm", "lvsm", "--config {0}/lvsm.yaml --checkpoint {0}/lvsm.pt", SQUARE, False),
        ("tiled_mpi", "tmpi", TMPI, "timeout=60", True),
        ("view_crafter", "view_crafter", "--checkpoint {}/sharp.pt", VIDEO[0], True),
        ("gen3c", "gen3c", "--checkpoint_dir {} --offload_tokenizer", VIDEO[1], True),
    ],
    ids=["flash3d", "splatter_image", "stable_virtual_camera", "lvsm", "tiled_mpi", "view_crafter", "gen3c"],
)
def test_recipes_that_make_pictures(recipe, stub, arguments, fit, metric, datasets, stubs, program, tmp_path):
    write_weights(tmp_path)
    stubs(stub)
    evaluate(program, tmp_path, "run", recipe, arguments, fit, datasets)
    assert scores(tmp_path / "run")["P"] > best_mistake(metric)


def evaluate(program, folder, name, recipe, arguments, fit, datasets, *more):
    run = f"{shlex.quote(sys.executable)} {RECIPES / recipe}.py --device cpu {arguments.format(folder)}"
    options = ["--pair-options", PAIRS, "--metrics", "psnr", "--out", folder / name, *more]
    for dataset in datasets:
        options += ["--dataset", dataset]
    program("run", "--method", f'command:label=theirs,{fit},run="{run}"', *options)


@pytest.mark.parametrize(
    "recipe, stub, arguments, fit",
    [
        ("flash3d", "flash3d", "--checkpoint {}/sharp.pt", "resize=bicubic"),
        ("tiled_mpi", "tmpi", TMPI, "timeout=60"),
        ("view_crafter", "view_crafter", "--checkpoint {}/sharp.pt", VIDEO[0]),
        ("gen3c", "gen3c", "--checkpoint_dir {} --offload_tokenizer", VIDEO[1]),
    ],
    ids=["flash3d", "tiled_mpi", "view_crafter", "gen3c"],
)
def test_the_median_scale_of_a_methods_own_depth(recipe, stub, arguments, fit, datasets, stubs, program, monkeypatch, tmp_path):
    """Depth that is too large by a constant factor costs quality unless the recipe sees the source's true depth."""
    write_weights(tmp_path)
    stubs(stub)
    monkeypatch.setenv("STUB_DEPTH_FACTOR", "1.3")
    for name, privilege in (("blind", "none"), ("told", "privileged")):
        evaluate(program, tmp_path, name, recipe, arguments, f"depth={privilege},{fit}", datasets[:1])
    blind, told = (scores(tmp_path / name, ["P"])["P"] for name in ("blind", "told"))
    assert blind < best_mistake(metric=True) < told


@pytest.mark.parametrize(
    "recipe, stub, arguments, fit",
    [
        ("stable_virtual_camera", "seva", "--camera-scale 1", "timeout=60"),
        ("lvsm", "lvsm", "--config {0}/lvsm.yaml --checkpoint {0}/lvsm.pt", SQUARE),
    ],
    ids=["stable_virtual_camera", "lvsm"],
)
def test_scales_of_a_method_that_normalises_the_cameras(recipe, stub, arguments, fit, datasets, stubs, program, tmp_path):
    write_weights(tmp_path)
    stubs(stub)
    for name, scales in (("all", "0.8+1+1.25"), ("small", "0.8")):
        evaluate(program, tmp_path, name, recipe, arguments, f"scales={scales},{fit}", datasets[:1], "--scale-sweep")
    with open(tmp_path / "all/scores.csv", newline="") as file:
        chosen = {row["dataset"]: (row["best_scale"], row["scales_tried"]) for row in csv.DictReader(file)}
    assert chosen["P"] == ("1", "3")
    small, best = (scores(tmp_path / name, ["P"])["P"] for name in ("small", "all"))
    assert small < best_mistake(metric=True) < best


def test_what_they_share(monkeypatch):
    monkeypatch.syspath_prepend(RECIPES)
    import protocol

    # Cropping shifts pictures and intrinsics equally, even beyond the picture.
    K = SOURCE["K"]
    whole = Image.fromarray(picture(SOURCE["size"], K))
    box = (30.25, 12.5, 250.75, 160)
    size = (441, 295)
    assert psnr(np.asarray(protocol.cut(whole, box, size)), picture(size, protocol.cut_K(K, box, size))) > 45
    outside = np.asarray(protocol.cut(whole, (-10, -20, 374, 268), SOURCE["size"]))
    assert (outside[:20] == 255).all() and (outside[:, :10] == 255).all()
    assert (outside[20:, 10:] == np.asarray(whole)[:268, :374]).all()
    assert (np.asarray(protocol.cut(whole, (-1e-9, 0, 384 + 1e-9, 288), SOURCE["size"])) == np.asarray(whole)).all()
    assert protocol.center_square((741, 497)) == (122, 0, 619, 497)
    assert protocol.center((741, 497), (16, 9)) == (0, 40, 741, 457)
    path = protocol.trajectory(POSE, 5)
    assert np.allclose(path[0], np.eye(4)) and np.allclose(path[-1], POSE)
    assert np.allclose(np.linalg.matrix_power(path[1, :3, :3], 4), POSE[:3, :3])
    assert np.allclose(np.linalg.inv(path)[:, :3, 3], np.linspace(0, 1, 5)[:, None] * np.linalg.inv(POSE)[:3, 3])
    pair = protocol.Pair("a", whole, K, K, POSE, whole.size)
    assert (protocol.in_units_of(np.ones((2, 3)), pair, (0, 0, 3, 2)) == POSE).all()
    pair.depth = np.array([[9, 2, 0, 6, 9]] * 2)
    # Of the part from the second to the fourth column: true over predicted depth is 2 / 4, nothing, and 6 / 4.
    seen = protocol.in_units_of(np.array([[4.0, 0, 4]]), pair, (1, 0, 4, 2))
    assert np.allclose(seen[:3, 3], POSE[:3, 3]) and np.allclose(seen[:3, :3], POSE[:3, :3])
    with pytest.raises(ValueError, match="no pixel"):
        protocol.in_units_of(np.zeros((1, 3)), pair, (1, 0, 4, 2))
    assert protocol.to_levels(torch.tensor([[[-1.0]], [[0.5]], [[2.0]]])).tolist() == [[[0, 128, 255]]]


def test_a_pair_that_cannot_be_predicted_is_answered(monkeypatch, stubs, tmp_path):
    """An exception fails only its pair, and other output does not appear between the answers."""
    picture_file = tmp_path / "source.png"
    Image.fromarray(picture(SOURCE["size"], SOURCE["K"])).save(picture_file)
    (tmp_path / "mine.py").write_text(
        f"import sys; sys.path.insert(0, {str(RECIPES)!r})\n"
        "import numpy as np, protocol\n"
        "def predict(pair):\n"
        "    print('working')\n"
        "    if pair.pair_id == 'bad':\n"
        "        raise ValueError('no such view')\n"
        "    return np.zeros((*pair.target_size[::-1], 3), np.uint8)\n"
        "protocol.serve(lambda: print('loading') or predict)\n"
    )
    pair = {"target": {"width": 8, "height": 6}, "K_s": [1] * 9, "K_t": [1] * 9, "target_from_source": [1] * 16}
    request = {"source_picture": str(picture_file), "write_to": str(tmp_path / "made.png"), "pair": pair}
    lines = "".join(json.dumps({"pair_id": name, **request}) + "\n" for name in ("bad", "good"))
    command = [sys.executable, tmp_path / "mine.py"]
    done = subprocess.run(command, input=lines, capture_output=True, text=True, check=True)
    answers = [json.loads(line) for line in done.stdout.splitlines()]
    assert answers[0] == {"pair_id": "bad", "error": "ValueError: no such view"}
    assert answers[1] == {"pair_id": "good", "extras": {"rendered_width": 8}}
    assert Image.open(tmp_path / "made.png").size == (8, 6)
    assert "loading" in done.stderr and done.stderr.count("working") == 2


def test_every_row_of_the_papers_main_tables_has_a_recipe():
    page = (ROOT / "bench/docs/reproduce-table-1.md").read_text()
    ways = dict(re.findall(r"^\| (\w+) \| `(\w+\.py)` \| `(?:depth=privileged|scales=)`", page, re.MULTILINE))
    with open(ROOT / "bench/data/paper_tables.csv", newline="") as file:
        rows = {row["row"] for row in csv.DictReader(file) if row["table"] in ("quantitative", "privileged", "timing-comparison")}
    assert rows == {"SHARP (ours)", *ways}
    assert all((RECIPES / recipe).exists() for recipe in ways.values())
    # The page of recipes names every recipe.
    listed = (ROOT / "bench/docs/recipes.md").read_text()
    assert all(f"`{recipe.name}`" in listed for recipe in RECIPES.glob("*.py"))
