"""CPU seconds and peak memory of this crate's metrics and of the public code.

    python3 -m venv .venv && .venv/bin/pip install -r benches/requirements.txt
    cargo build --release -p sharp-metrics --example measure
    .venv/bin/python benches/compare.py TARGET_DIR/release/examples/measure 1752x1168 [ROW…]

Two threads on both sides and random weights, on whose values time does not depend. The two sides
take turns, so that a busy machine slows both, and each number is the median of several turns. What
is counted is user and system time of the call alone: models, pictures and decoding are ready
before, and every side has made one call that does not count. Each row of the table is a process of
its own on either side, so that its peak of memory (picture and weights included) is its own.

Exits with 1 if a ratio lies below its bar.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
import warnings
from typing import Callable, NamedTuple

THREADS = 2
# Before numpy and torch are imported, which read them once.
for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[variable] = str(THREADS)


def pair(width: int, height: int):
    """Two 8-bit pictures that differ everywhere."""
    import numpy as np

    first = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return first, np.roll(first, 3, axis=1)


def tensors(pictures, signed: bool):
    import torch

    planes = [torch.from_numpy(p).permute(2, 0, 1)[None].float() / 255 for p in pictures]
    return [(2 * p - 1 if signed else p).contiguous() for p in planes]


def lpips_call(net: str, channels_last: bool = False, features_only: bool = False):
    def prepare(pictures):
        import lpips
        import torch

        torch.set_num_threads(THREADS)
        model = lpips.LPIPS(net=net, pnet_rand=True, verbose=False).eval()
        a, b = tensors(pictures, signed=True)
        if channels_last:
            model.to(memory_format=torch.channels_last)
            a, b = (t.contiguous(memory_format=torch.channels_last) for t in (a, b))

        def call():
            with torch.no_grad():
                if features_only:
                    for picture in (a, b):
                        model.net(model.scaling_layer(picture))
                else:
                    model(a, b)

        return call

    return prepare


def dists_call(pictures):
    import torch
    import torchvision

    torch.set_num_threads(THREADS)
    # The package asks for pretrained weights; a network of the same shape is enough for time.
    original = torchvision.models.vgg16
    torchvision.models.vgg16 = lambda *_, **__: original(weights=None)
    import DISTS_pytorch

    model = DISTS_pytorch.DISTS().eval()
    torchvision.models.vgg16 = original
    a, b = tensors(pictures, signed=False)

    def call():
        with torch.no_grad():
            model(a, b)

    return call


def ssim_call(**options):
    def prepare(pictures):
        from skimage.metrics import structural_similarity

        a, b = pictures
        return lambda: structural_similarity(a, b, channel_axis=2, data_range=255, **options)

    return prepare


def psnr_skimage(pictures):
    from skimage.metrics import peak_signal_noise_ratio

    a, b = pictures
    return lambda: peak_signal_noise_ratio(a, b, data_range=255)


def psnr_numpy(pictures):
    import numpy as np

    a, b = pictures

    def call():
        difference = a.astype(np.float32) - b.astype(np.float32)
        return 10 * np.log10(255**2 / np.mean(difference * difference))

    return call


GAUSSIAN = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}


class Row(NamedTuple):
    """A metric, the corresponding public code, and the minimum ratio of its time to ours."""

    key: str
    peer: str
    prepare: Callable
    bar: float | None = None


ROWS = {
    "psnr": Row("psnr", "scikit-image", psnr_skimage, 1),
    "psnr-numpy": Row("psnr", "numpy, f32", psnr_numpy, 1),
    "ssim-gauss": Row("ssim-gauss11-valid", "scikit-image, same window", ssim_call(**GAUSSIAN), 5),
    "ssim-box": Row("ssim-uniform7-sample", "scikit-image, default", ssim_call(), 5),
    "alex": Row("lpips-alex", "lpips", lpips_call("alex"), 1.5),
    "squeeze": Row("lpips-squeeze", "lpips", lpips_call("squeeze")),
    "features": Row(
        "lpips-vgg", "lpips, its VGG16 features alone", lpips_call("vgg", features_only=True), 3
    ),
    "features-last": Row(
        "lpips-vgg",
        "the same, channels last",
        lpips_call("vgg", channels_last=True, features_only=True),
        2.5,
    ),
    "vgg": Row("lpips-vgg", "lpips", lpips_call("vgg"), 3),
    "vgg-last": Row("lpips-vgg", "lpips, channels last", lpips_call("vgg", channels_last=True), 2.5),
    "dists": Row("dists", "DISTS-pytorch", dists_call, 3),
}


def repeats(row: Row) -> int:
    """Calls a turn: a short call is repeated, so that the clock's steps do not matter."""
    return {"psnr": 50}.get(row.key, 5 if row.key.startswith("ssim") else 1)


def serve_peer(name: str, width: int, height: int) -> None:
    """The public code's side: one turn for every line of standard input."""
    warnings.filterwarnings("ignore")
    call = ROWS[name].prepare(pair(width, height))
    call()
    count = repeats(ROWS[name])
    for _ in sys.stdin:
        before = time.process_time()
        for _ in range(count):
            call()
        used = (time.process_time() - before) / count
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(json.dumps({"cpu_s": used, "peak_mib": peak}), flush=True)


class Turns:
    """A process that takes a turn when asked and answers with a line of JSON."""

    def __init__(self, command: list[str]):
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        self.cpu, self.peak = [], 0.0

    def take(self) -> None:
        print(file=self.process.stdin, flush=True)
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"failed: {' '.join(self.process.args)}")
        answer = json.loads(line)
        self.cpu.append(answer["cpu_s"])
        self.peak = max(self.peak, answer["peak_mib"])

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait()


def compare(name: str, measure: str, width: int, height: int, turns: int) -> bool:
    row = ROWS[name]
    size = [str(width), str(height)]
    peer = Turns([sys.executable, __file__, measure, "x".join(size), "--peer", name])
    options = [f"threads={THREADS}", f"repeat={repeats(row)}", "turns"]
    ours = Turns([measure, row.key, *size, *options])
    for _ in range(turns):
        peer.take()
        ours.take()
    for side in (peer, ours):
        side.close()
    theirs, own = statistics.median(peer.cpu), statistics.median(ours.cpu)
    ratio = theirs / own
    bar = "" if row.bar is None else f"{row.bar:g}"
    print(
        f"| `{row.key}` | {row.peer} | {theirs:.4g} | {own:.4g} | {ratio:.2f} | {bar} "
        f"| {peer.peak:.0f} | {ours.peak:.0f} |",
        flush=True,
    )
    return row.bar is None or ratio >= row.bar


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("measure", help="the example of that name, built")
    parser.add_argument("size", help="WIDTHxHEIGHT, pixels")
    parser.add_argument("rows", nargs="*", help=f"of {' '.join(ROWS)}; all of them by default")
    parser.add_argument("--turns", type=int, default=5, help="turns of each side (default 5)")
    parser.add_argument("--peer", choices=ROWS, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))
    if arguments.peer:
        serve_peer(arguments.peer, width, height)
        return 0
    names = arguments.rows or list(ROWS)
    if unknown := set(names) - set(ROWS):
        parser.error(f"no such row: {' '.join(sorted(unknown))}")
    print(f"| key, {arguments.size} | beside | its CPU s | ours | ratio | bar | its MiB | ours |")
    print("|---|---|---|---|---|---|---|---|")
    results = [compare(name, arguments.measure, width, height, arguments.turns) for name in names]
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
