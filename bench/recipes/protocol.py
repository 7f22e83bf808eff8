"""Shared by the recipes: the JSON lines of `--method command:…`, cropping pictures together with their intrinsics, and
running a function that predicts Gaussians.

Conventions of the harness, everywhere in these files: OpenCV axes, metres, target_from_source maps points of the
source camera to the target camera, and the centre of pixel (i, j) lies at (i + 0.5, j + 0.5). In that convention,
cropping shifts intrinsics and resizing multiplies them; nothing else changes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from PIL import Image

Box = tuple[float, float, float, float]  # left, top, right, bottom, in pixels; may lie outside the picture


@dataclass
class Pair:
    pair_id: str
    source: Image.Image
    K_s: np.ndarray
    K_t: np.ndarray
    target_from_source: np.ndarray
    target_size: tuple[int, int]  # width, height
    depth: np.ndarray | None = None  # of the source, [H, W], metres, 0 where unknown; only with depth=privileged
    # With scales=: the factor already in target_from_source. If a method normalises the distance of the cameras, its
    # recipe multiplies by this afterwards.
    scale: float = 1.0

    @property
    def source_from_target(self) -> np.ndarray:
        return np.linalg.inv(self.target_from_source)


def serve(load: Callable[[], Callable[[Pair], np.ndarray]]) -> None:
    """Answers requests until the input ends. `load` prepares the network and returns a function that predicts one pair."""
    # These projects print while they work, but standard output must contain only answers.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    predict = load()
    for line in sys.stdin:
        request = json.loads(line)
        answer = {"pair_id": request["pair_id"]}
        try:
            picture = np.asarray(predict(read(request)))
            Image.fromarray(picture).save(request["write_to"])
            answer["extras"] = {"rendered_width": picture.shape[1]}
        except Exception as error:
            traceback.print_exc()
            answer["error"] = f"{type(error).__name__}: {error}"
        print(json.dumps(answer), file=answers, flush=True)


def read(request: dict) -> Pair:
    pair = request["pair"]
    target = (pair["target"]["width"], pair["target"]["height"])
    K_s, K_t = (np.reshape(pair[name], (3, 3)) for name in ("K_s", "K_t"))
    source = Image.open(request["source_picture"]).convert("RGB")
    depth = np.load(request["source_depth"]) if "source_depth" in request else None
    scale = request.get("scale", 1.0)
    target_from_source = np.reshape(pair["target_from_source"], (4, 4)).astype(float)
    target_from_source[:3, 3] *= scale
    return Pair(request["pair_id"], source, K_s, K_t, target_from_source, target, depth, scale)


def in_units_of(depth: np.ndarray, pair: Pair, box: Box) -> np.ndarray:
    """target_from_source in the unit of a method's own depth map [H, W] of the part `box` of the source.

    With depth=privileged the unit is the median of true over predicted depth, over the pixels that have both (the
    paper's alignment: dividing the motion by it is equivalent to scaling the depth). Otherwise it is a metre.
    """
    motion = pair.target_from_source.copy()
    if pair.depth is not None:
        height, width = depth.shape
        y, x = np.nonzero(pair.depth > 0)
        # True depth may be sparse: each of its pixels is compared with the predicted one that contains its centre.
        column = np.floor((x + 0.5 - box[0]) / (box[2] - box[0]) * width).astype(int)
        row = np.floor((y + 0.5 - box[1]) / (box[3] - box[1]) * height).astype(int)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        true, predicted = pair.depth[y, x][inside], depth[row[inside], column[inside]]
        both = np.isfinite(predicted) & (predicted > 0)
        if not both.any():
            raise ValueError("no pixel has both true and predicted depth")
        motion[:3, 3] /= np.median(true[both] / predicted[both])
    return motion


def trajectory(target_from_source: np.ndarray, frames: int) -> np.ndarray:
    """Cameras from the source to the target, [frames, 4, 4], each camera-from-source: centres at equal steps on a line,
    rotations at equal steps about one axis."""
    rotation, centre = target_from_source[:3, :3], np.linalg.inv(target_from_source)[:3, 3]
    axis = np.linalg.eigh(rotation + rotation.T)[1][:, -1]
    cross = np.cross(np.eye(3), -axis)
    angle = np.arctan2(np.trace(cross.T @ rotation) / 2, (np.trace(rotation) - 1) / 2)
    path = np.tile(np.eye(4), (frames, 1, 1))
    for camera, step in zip(path, np.linspace(0, 1, frames)):
        camera[:3, :3] += np.sin(step * angle) * cross + (1 - np.cos(step * angle)) * cross @ cross
        camera[:3, 3] = -camera[:3, :3] @ (step * centre)
    return path


def cut(picture: Image.Image, box: Box, size: tuple[int, int], kernel: int = Image.Resampling.LANCZOS) -> Image.Image:
    """The part `box` of a picture at `size`, white where the box leaves the picture."""
    # Edges that are outside the picture only by rounding count as on its edge, so that no white line appears.
    left, top = (0.0 if abs(edge) < 1e-6 else float(edge) for edge in box[:2])
    right, bottom = (float(n) if abs(edge - n) < 1e-6 else float(edge) for edge, n in zip(box[2:], picture.size))
    before = [max(0, math.ceil(-edge)) for edge in (left, top)]
    after = [max(0, math.ceil(edge - n)) for edge, n in zip((right, bottom), picture.size)]
    if any(before + after):
        larger = [sum(lengths) for lengths in zip(before, picture.size, after)]
        canvas = Image.new("RGB", tuple(larger), (255, 255, 255))
        canvas.paste(picture, tuple(before))
        picture = canvas
    x, y = before
    return picture.resize(size, kernel, box=(left + x, top + y, right + x, bottom + y))


def cut_K(K: np.ndarray, box: Box, size: tuple[int, int]) -> np.ndarray:
    """The intrinsics of `cut(picture, box, size)`."""
    left, top, right, bottom = box
    scale = np.array(size) / (right - left, bottom - top)
    shifted = K - [[0, 0, left], [0, 0, top], [0, 0, 0]]
    return np.diag([*scale, 1]) @ shifted


def center_square(size: tuple[int, int]) -> Box:
    return center(size, (1, 1))


def center(size: tuple[int, int], aspect: tuple[int, int]) -> Box:
    """The largest centred part with an aspect ratio: exactly the pixels that `crop=center:W:H` scores."""
    across = min(size[0], math.floor(size[1] * aspect[0] / aspect[1] + 0.5))
    down = min(size[1], math.floor(size[0] * aspect[1] / aspect[0] + 0.5))
    x, y = (size[0] - across) // 2, (size[1] - down) // 2
    return (x, y, x + across, y + down)


def to_levels(chw) -> np.ndarray:
    """A tensor [3, H, W] of sRGB in 0..1 as [H, W, 3] of uint8, rounded."""
    return (chw.detach().float().clamp(0, 1) * 255).round().byte().permute(1, 2, 0).cpu().numpy()


def arguments(text: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=text.splitlines()[0])
    parser.add_argument("--device", default="cuda")
    return parser


def evaluation(text: str) -> argparse.ArgumentParser:
    """Arguments of a recipe that evaluates by itself, because it predicts Gaussians."""
    parser = arguments(text)
    parser.add_argument("--checkpoint", required=True)
    parser.add_argument("--dataset", required=True, action="append", help="as `sharp-bench run --dataset`; repeatable")
    parser.add_argument("--out", required=True, help="the run folder")
    parser.add_argument("--metrics", default="paper")
    parser.add_argument("--pairs", help="a list as `sharp-bench pairs` writes it")
    parser.add_argument("--pair-options", default="")
    parser.add_argument("--limit", type=int)
    return parser


def evaluate(of_source: Callable, label: str, recipe: str, options: argparse.Namespace) -> None:
    """Runs `of_source(source) -> sharp_bench.Gaussians`; predicts again if the weights or the recipe change."""
    import sharp_bench as sb

    digest = hashlib.sha256()
    for path in (options.checkpoint, recipe):
        with open(path, "rb") as file:
            for block in iter(lambda: file.read(1 << 22), b""):
                digest.update(block)
    more = {name: getattr(options, name) for name in ("metrics", "pairs", "pair_options", "limit")}
    print(sb.evaluate(of_source, options.dataset, options.out, label=label, version=digest.hexdigest()[:16], **more))
