"""CPU seconds of this crate's metrics beside those of the public code, on one machine.

    python -m venv .venv && .venv/bin/pip install -r benches/requirements.txt
    cargo build --release -p sharp-metrics --example measure
    .venv/bin/python benches/compare.py TARGET_DIR/release/examples/measure [WIDTHxHEIGHT]

Two threads on both sides, random weights (time does not depend on them), each row the median of
three runs, the two sides taking turns so that a busy machine slows both. CPU time, user and
system, of the call alone: models, pictures and decoding are not counted.
"""

import json
import os
import statistics
import subprocess
import sys

import numpy as np
import torch

torch.set_num_threads(2)
RUNS = 3


def cpu_seconds() -> float:
    times = os.times()
    return times.user + times.system


def timed(call) -> float:
    before = cpu_seconds()
    with torch.no_grad():
        call()
    return cpu_seconds() - before


def pair(width: int, height: int):
    generator = np.random.default_rng(0)
    base = generator.integers(0, 256, (height, width, 3), dtype=np.uint8)
    return base, np.roll(base, 3, axis=1)


def tensors(pictures, signed: bool):
    planes = [torch.from_numpy(p).permute(2, 0, 1)[None].float() / 255 for p in pictures]
    return [2 * p - 1 if signed else p for p in planes]


def lpips_call(net: str, channels_last: bool):
    import lpips

    model = lpips.LPIPS(net=net, pnet_rand=True, verbose=False).eval()

    def prepare(pictures):
        a, b = tensors(pictures, signed=True)
        if channels_last:
            model.to(memory_format=torch.channels_last)
            a, b = (t.contiguous(memory_format=torch.channels_last) for t in (a, b))
        return lambda: model(a, b)

    return prepare


def dists_call(pictures):
    import torchvision

    # The package asks for pretrained weights; a network of the same shape is enough for time.
    original = torchvision.models.vgg16
    torchvision.models.vgg16 = lambda *_, **__: original(weights=None)
    import DISTS_pytorch

    model = DISTS_pytorch.DISTS().eval()
    torchvision.models.vgg16 = original
    a, b = tensors(pictures, signed=False)
    return lambda: model(a, b)


def ssim_call(gaussian: bool):
    from skimage.metrics import structural_similarity

    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}

    def prepare(pictures):
        a, b = pictures
        more = options if gaussian else {}
        return lambda: structural_similarity(a, b, channel_axis=2, data_range=255, **more)

    return prepare


def psnr_call(pictures):
    from skimage.metrics import peak_signal_noise_ratio

    a, b = pictures
    return lambda: peak_signal_noise_ratio(a, b, data_range=255)


ROWS = [
    ("psnr", "scikit-image", psnr_call),
    ("ssim-uniform7-sample", "scikit-image", ssim_call(False)),
    ("ssim-gauss11-valid", "scikit-image", ssim_call(True)),
    ("lpips-alex", "lpips", lpips_call("alex", False)),
    ("lpips-squeeze", "lpips", lpips_call("squeeze", False)),
    ("lpips-vgg", "lpips", lpips_call("vgg", False)),
    ("lpips-vgg", "lpips, channels last", lpips_call("vgg", True)),
    ("dists", "DISTS-pytorch", dists_call),
]


def main() -> None:
    measure = sys.argv[1]
    size = sys.argv[2] if len(sys.argv) > 2 else "1024x768"
    width, height = map(int, size.split("x"))
    pictures = pair(width, height)
    print(f"| key, {size} | public code | its CPU s | ours, CPU s | ratio | our peak MiB |")
    print("|---|---|---|---|---|---|")
    for key, name, prepare in ROWS:
        call = prepare(pictures)
        theirs, ours, peak = [], [], 0.0
        repeat = 20 if key == "psnr" else 1
        for _ in range(RUNS):
            theirs.append(timed(lambda: [call() for _ in range(repeat)]) / repeat)
            command = [measure, key, str(width), str(height), "threads=2", f"repeat={repeat}"]
            result = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
            ours.append(result["cpu_s"])
            peak = max(peak, result["peak_mib"])
        a, b = statistics.median(theirs), statistics.median(ours)
        ratio = a / b if b else float("inf")
        print(f"| `{key}` | {name} | {a:.3f} | {b:.3f} | {ratio:.2f} | {peak:.0f} |", flush=True)


if __name__ == "__main__":
    main()
