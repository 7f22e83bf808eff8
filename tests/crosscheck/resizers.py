"""Our resize kernels against the functions of torch, PIL and OpenCV that they are named after."""

import json
import subprocess

import cv2
import numpy as np
import torch
import torch.nn.functional as functional
from PIL import Image

# Bytes must be equal. Floats may differ by the rounding of f32 sums in another order; torch's own
# two implementations (small and large outputs) differ by more, so outputs here are of the large kind:
# width and height sum to more than 128.
BYTES = 0
FLOATS = 1e-6

SIZES = [
    ((131, 97), (300, 240)),
    ((131, 97), (65, 80)),
    ((160, 120), (80, 60)),
    ((160, 120), (320, 240)),
    ((240, 180), (80, 60)),
    ((741, 500), (1482, 1000)),
    ((741, 500), (352, 233)),
    ((600, 40), (401, 200)),
    ((64, 300), (128, 150)),
    ((129, 65), (130, 65)),
    ((4000, 24), (6000, 36)),
    ((6000, 36), (4013, 20)),
]


def torch_resize(picture, size, antialias):
    tensor = torch.from_numpy(picture).permute(2, 0, 1)[None].contiguous()
    resized = functional.interpolate(tensor, size=(size[1], size[0]), mode="bilinear",
                                     align_corners=False, antialias=antialias)
    return resized[0].permute(1, 2, 0).numpy()


def pil_resize(picture, size, filter):
    if picture.dtype == np.uint8:
        return np.asarray(Image.fromarray(picture).resize(size, filter))
    channels = [np.asarray(Image.fromarray(picture[..., c], mode="F").resize(size, filter))
                for c in range(3)]
    return np.clip(np.stack(channels, -1), 0, 1)


def area_resize(picture, size):
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def as_floats(picture):
    """What torchvision's to_tensor does."""
    return picture.astype(np.float32) / np.float32(255) if picture.dtype == np.uint8 else picture


KERNELS = {
    "bilinear": ("torch", lambda picture, size: torch_resize(as_floats(picture), size, False)),
    "bilinear-antialias": ("torch", lambda picture, size: torch_resize(as_floats(picture), size, True)),
    "bicubic": ("PIL", lambda picture, size: pil_resize(picture, size, Image.Resampling.BICUBIC)),
    "lanczos": ("PIL", lambda picture, size: pil_resize(picture, size, Image.Resampling.LANCZOS)),
    "area": ("OpenCV", area_resize),
}

EXPECTED = {f"{kernel} {depth}" for kernel in KERNELS for depth in ("bytes", "floats")}


def compare(comparison, program, rng, folder, picture):
    """`picture(rng, height, width)` makes RGB in 0..1."""
    folder.mkdir(parents=True, exist_ok=True)
    requests, theirs = [], []
    for number, ((width, height), to) in enumerate(SIZES):
        rgb = picture(rng, height, width)
        forms = {"bytes": np.round(rgb * 255).astype(np.uint8), "floats": rgb.astype(np.float32)}
        for depth, values in forms.items():
            source = folder / f"{number}.{'u8' if depth == 'bytes' else 'f32'}"
            source.write_bytes(values.tobytes())
            for kernel, (library, function) in KERNELS.items():
                if kernel == "area" and (to[0] > width or to[1] > height):
                    continue  # only reduces here
                reference = function(values, to)
                form = "u8" if reference.dtype == np.uint8 else "f32"
                output = folder / f"{number}_{depth}_{kernel}.{form}"
                requests.append({"input": str(source), "from": [width, height], "kernel": kernel,
                                 "to": list(to), "output": str(output)})
                theirs.append((f"{kernel} {depth}", library, output, reference))
    subprocess.run([str(program)], input=json.dumps(requests), text=True, check=True)
    for quantity, library, output, reference in theirs:
        ours = np.fromfile(output, reference.dtype).reshape(reference.shape)
        tolerance = BYTES if reference.dtype == np.uint8 else FLOATS
        comparison.add(quantity, library, ours, reference, tolerance)
