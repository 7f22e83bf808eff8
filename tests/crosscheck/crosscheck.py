"""Our numbers against those of public libraries, on pictures, cameras, networks, scores and losses made from a seed.

Writes picture pairs, lets our programs and the reference libraries measure the same files, prints the
largest deviation of each quantity, and exits with 1 if one exceeds its tolerance or was not compared.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import cv2
import kornia
import numpy as np
import scipy
import skimage
import statsmodels
import torch
from kornia.color import linear_rgb_to_rgb, rgb_to_linear_rgb
from kornia.geometry.camera import project_points, unproject_points
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

import inference
import learned
import lenses
import resizers
import training

# Tolerances. Our statistics are f64, so f64 references must agree to 1e-9. kornia
# adds 1e-12 to SSIM's denominators, which counts where a picture is black and flat; OpenCV's SSIM is
# f32; our colour curves are f32.
EXACT = 1e-9
KORNIA_SSIM = 1e-5
OPENCV_SSIM = 1e-5
COLOUR = 3e-7
PIXELS = 1e-9
METRES = 1e-12

SIZES = [(48, 64), (97, 131), (120, 200), (33, 20)]


class Comparison:
    """Largest deviation per quantity and reference."""

    def __init__(self):
        self.rows = {}

    def add(self, quantity, reference, ours, theirs, tolerance):
        ours, theirs = np.asarray(ours, np.float64), np.asarray(theirs, np.float64)
        if ours.shape != theirs.shape:
            raise ValueError(f"{quantity}: shapes {ours.shape} and {theirs.shape}")
        same = (ours == theirs) | (np.isnan(ours) & np.isnan(theirs))
        with np.errstate(invalid="ignore"):
            deviation = np.where(same, 0.0, np.abs(ours - theirs))
        worst = float(np.max(np.where(np.isnan(deviation), np.inf, deviation)))
        row = self.rows.setdefault((quantity, reference), [0, 0.0, tolerance])
        row[0] += ours.size
        row[1] = max(row[1], worst)

    def report(self, expected):
        """Prints the table; true if everything expected was compared and agrees."""
        print(f"{'quantity':<42}{'reference':<28}{'values':>8}{'largest':>12}{'allowed':>10}")
        agree = True
        for (quantity, reference), (count, worst, tolerance) in self.rows.items():
            verdict = "" if worst <= tolerance else "  MISMATCH"
            agree &= worst <= tolerance
            print(f"{quantity:<42}{reference:<28}{count:>8}{worst:>12.2e}{tolerance:>10.0e}{verdict}")
        for missing in expected - {quantity for quantity, _ in self.rows}:
            agree = False
            print(f"{missing}: not compared")
        return agree


def picture(rng, height, width):
    """Smooth waves, edges and fine grain: something for every window size."""
    y, x = np.mgrid[:height, :width] / max(height, width)
    channels = []
    for _ in range(3):
        fx, fy, phase = rng.uniform(2, 25), rng.uniform(2, 25), rng.uniform(0, 6)
        channels.append(0.5 + 0.3 * np.sin(fx * x + fy * y + phase))
    rgb = np.stack(channels, -1)
    for _ in range(6):
        top, left = rng.integers(0, height), rng.integers(0, width)
        rgb[top : top + height // 4, left : left + width // 4] = rng.uniform(0, 1, 3)
    rgb += rng.normal(0, 0.03, rgb.shape)
    return np.clip(rgb, 0, 1)


def distortions(rng, rgb):
    """Names and distorted copies."""
    yield "noise", rgb + rng.normal(0, 0.1, rgb.shape)
    yield "blur", cv2.GaussianBlur(rgb, (0, 0), 2.0)
    yield "gamma", rgb**1.6
    yield "shift", np.roll(rgb, 3, axis=1)
    yield "black", np.zeros_like(rgb)
    yield "one_level", rgb + 1.0 / 255.0


def write_safetensors(path, pixels):
    """One float tensor: the header's length, the header, the values."""
    values = pixels.astype("<f4").tobytes()
    entry = {"dtype": "F32", "shape": pixels.shape, "data_offsets": [0, len(values)]}
    header = json.dumps({"rgb": entry}).encode()
    path.write_bytes(len(header).to_bytes(8, "little") + header + values)


def write_pairs(rng, folder):
    """8-bit PNG and float pairs; returns the pictures by name, RGB in 0..1."""
    pairs = {}
    for side in ("prediction", "target"):
        (folder / side).mkdir(parents=True, exist_ok=True)
    for number, (height, width) in enumerate(SIZES):
        target = picture(rng, height, width)
        for kind, distorted in distortions(rng, target):
            prediction = np.clip(distorted, 0, 1)
            for depth in ("u8", "f32"):
                name = f"{number}_{kind}_{depth}"
                both = (prediction, target)
                if depth == "u8":
                    both = [np.round(p * 255).astype(np.uint8) for p in both]
                else:
                    both = [p.astype(np.float32) for p in both]
                for side, pixels in zip(("prediction", "target"), both):
                    path = folder / side / name
                    if depth == "u8":
                        cv2.imwrite(str(path.with_suffix(".png")), pixels[..., ::-1])
                    else:
                        write_safetensors(path.with_suffix(".safetensors"), pixels)
                pairs[name] = both
    return pairs


def as_f64(pixels):
    return pixels / 255.0 if pixels.dtype == np.uint8 else pixels.astype(np.float64)


def tensor(pixels):
    return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1)))[None]


def gray(pixels):
    return pixels @ np.array([0.299, 0.587, 0.114])


def skimage_ssim(a, b, **options):
    return structural_similarity(a, b, data_range=1.0, **options)


def gauss(a, b, **options):
    return skimage_ssim(a, b, gaussian_weights=True, sigma=1.5, **options)


def kornia_ssim(a, b, padding):
    return kornia.metrics.ssim(tensor(a), tensor(b), 11, padding=padding).mean().item()


def opencv_ssim(a, b):
    per_channel, _ = cv2.quality.QualitySSIM_compute(a, b)
    return np.mean(per_channel[:3])


# Metric key -> reference, tolerance, function of two f64 pictures.
PICTURE_METRICS = [
    ("psnr", "scikit-image", EXACT, lambda a, b: peak_signal_noise_ratio(b, a, data_range=1.0)),
    ("psnr", "kornia", EXACT, lambda a, b: kornia.metrics.psnr(tensor(a), tensor(b), 1.0).item()),
    ("ssim[gauss11,valid]", "scikit-image", EXACT,
     lambda a, b: gauss(a, b, use_sample_covariance=False, channel_axis=2)),
    ("ssim[gauss11,valid]", "kornia", KORNIA_SSIM, lambda a, b: kornia_ssim(a, b, "valid")),
    ("ssim[gauss11,reflect]", "kornia", KORNIA_SSIM, lambda a, b: kornia_ssim(a, b, "same")),
    ("ssim[uniform7,sample]", "scikit-image", EXACT,
     lambda a, b: skimage_ssim(a, b, channel_axis=2)),
    ("ssim[uniform7,population]", "scikit-image", EXACT,
     lambda a, b: skimage_ssim(a, b, use_sample_covariance=False, channel_axis=2)),
    ("ssim[gauss11,valid,sample]", "scikit-image", EXACT,
     lambda a, b: gauss(a, b, use_sample_covariance=True, channel_axis=2)),
    ("ssim[gauss11,valid,gray]", "scikit-image", EXACT,
     lambda a, b: gauss(gray(a), gray(b), use_sample_covariance=False)),
]

# The same for 8-bit pictures as they are.
BYTE_METRICS = [
    ("psnr", "OpenCV", EXACT, lambda a, b: cv2.PSNR(a, b)),
    ("ssim[gauss11,reflect]", "OpenCV", OPENCV_SSIM, opencv_ssim),
]


def run(command, request=None):
    done = subprocess.run(command, input=request, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}\nexit code {done.returncode}\n{done.stderr}")
    return done.stdout


def run_json(command, request=None):
    return json.loads(run(command, request))


def compare_pictures(comparison, binary, rng, folder):
    pairs = write_pairs(rng, folder)
    keys = sorted({key for key, *_ in PICTURE_METRICS + BYTE_METRICS})
    aliases = [key.replace("[", "-").replace(",", "-").replace("]", "") for key in keys]
    command = [binary, "metrics", folder / "prediction", folder / "target"]
    answer = run_json([*command, "--metrics", ",".join(aliases), "--json"])
    found = {Path(pair["prediction"]).stem: pair["scores"] for pair in answer["pairs"]}
    if found.keys() != pairs.keys():
        sys.exit(f"pairs that were not scored: {sorted(pairs.keys() ^ found.keys())}")
    for name, (prediction, target) in pairs.items():
        measures = [(m, as_f64(prediction), as_f64(target)) for m in PICTURE_METRICS]
        if prediction.dtype == np.uint8:
            measures += [(m, prediction, target) for m in BYTE_METRICS]
        for (key, reference, tolerance, measure), a, b in measures:
            comparison.add(key, reference, float(found[name][key]), measure(a, b), tolerance)


def compare_colour_and_cameras(comparison, program, rng):
    values = np.concatenate([np.arange(256) / 255.0, rng.uniform(0, 1, 4096)]).astype(np.float32)
    width, height = 640, 480
    k = np.array([[523.7, 0, 317.3], [0, 519.2, 244.9], [0, 0, 1]])
    rotation, _ = cv2.Rodrigues(rng.normal(0, 0.6, 3))
    translation = rng.normal(0, 2, 3)
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3], camera_from_world[:3, 3] = rotation, translation
    in_camera = rng.uniform([-3, -3, 0.2], [3, 3, 30], (2000, 3))
    points = (in_camera - translation) @ rotation
    pixels = rng.uniform(0, [width, height], (2000, 2))
    depths = rng.uniform(0.2, 30, 2000)
    request = {
        "srgb": values.tolist(),
        "linear": values.tolist(),
        "width": width,
        "height": height,
        "K": k.ravel().tolist(),
        "camera_from_world": camera_from_world.ravel().tolist(),
        "points_world": points.tolist(),
        "pixels": pixels.tolist(),
        "depths_m": depths.tolist(),
    }
    ours = run_json([program], json.dumps(request))

    image = torch.from_numpy(values.astype(np.float64)).expand(1, 3, 1, -1)
    for quantity, convert in (
        ("linear_from_srgb", rgb_to_linear_rgb),
        ("srgb_from_linear", linear_rgb_to_rgb),
    ):
        theirs = convert(image)[0, 0, 0].numpy()
        comparison.add(quantity, "kornia", ours[quantity], theirs, COLOUR)

    moved = torch.from_numpy(points @ rotation.T + translation)
    matrix = torch.from_numpy(k)
    comparison.add("projected, px", "kornia", ours["projected"],
                   project_points(moved, matrix.expand(len(points), 3, 3)).numpy(), PIXELS)
    vector, _ = cv2.Rodrigues(rotation)
    theirs, _ = cv2.projectPoints(points, vector, translation, k, None)
    comparison.add("projected, px", "OpenCV", ours["projected"], theirs[:, 0], PIXELS)

    def to_world(in_camera):
        return (in_camera - translation) @ rotation

    theirs = unproject_points(torch.from_numpy(pixels), torch.from_numpy(depths)[:, None],
                              matrix.expand(len(pixels), 3, 3)).numpy()
    comparison.add("unprojected, m", "kornia", ours["unprojected"], to_world(theirs), METRES)
    rays = cv2.undistortPoints(pixels[:, None], k, None)[:, 0]
    theirs = np.column_stack([rays, np.ones(len(rays))]) * depths[:, None]
    comparison.add("unprojected, m", "OpenCV", ours["unprojected"], to_world(theirs), METRES)


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--binary", required=True, type=Path, help="sharp-bench")
    arguments.add_argument("--quantities", required=True, type=Path,
                           help="the example crosscheck_quantities of the package sharp-tests")
    arguments.add_argument("--resize", required=True, type=Path, help="its example crosscheck_resize")
    arguments.add_argument("--lenses", required=True, type=Path, help="its example crosscheck_lenses")
    arguments.add_argument("--training", required=True, type=Path, help="its example crosscheck_training")
    arguments.add_argument("--statistics", required=True, type=Path,
                           help="the example crosscheck_statistics of the package sharp-statistics")
    arguments.add_argument("--work", required=True, type=Path, help="folder for the pictures")
    arguments.add_argument("--seed", type=int, default=0)
    given = arguments.parse_args()

    print(f"numpy {np.__version__}, scikit-image {skimage.__version__}, OpenCV {cv2.__version__}, "
          f"kornia {kornia.__version__}, torch {torch.__version__}, scipy {scipy.__version__}, "
          f"statsmodels {statsmodels.__version__}; seed {given.seed}")
    rng = np.random.default_rng(given.seed)
    comparison = Comparison()
    compare_pictures(comparison, given.binary, rng, given.work)
    compare_colour_and_cameras(comparison, given.quantities, rng)
    resizers.compare(comparison, given.resize, rng, given.work / "resize", picture)
    lenses.compare(comparison, given.lenses, rng, given.work / "lenses")
    learned.compare(comparison, run_json, given.binary, rng, given.work / "learned", picture)
    inference.compare(comparison, run_json, given.statistics, rng)
    training.compare(comparison, run, given.training, rng, given.work / "training")
    expected = {key for key, *_ in PICTURE_METRICS + BYTE_METRICS} | {
        "linear_from_srgb", "srgb_from_linear", "projected, px", "unprojected, m"}
    expected |= resizers.EXPECTED | lenses.EXPECTED | learned.EXPECTED | inference.EXPECTED | training.EXPECTED
    if not comparison.report(expected):
        sys.exit(1)


if __name__ == "__main__":
    main()
