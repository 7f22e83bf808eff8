"""The package as the workspace built it, without an installation: SHARP_BENCH_MODULE is the shared library, SHARP_BENCH the program,
by default the one next to the library."""

import os
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).parents[2]
MODULE = os.environ.get("SHARP_BENCH_MODULE")
BUILT = pathlib.Path(MODULE).parent if MODULE is not None else ROOT / "target/release"
PROGRAM = str(pathlib.Path(os.environ.get("SHARP_BENCH", BUILT / "sharp-bench")).absolute())

if MODULE is not None:
    package = ROOT / "bench/python/sharp_bench"
    # Atomically, because another process may have the old one open.
    copy = package / f"_sharp_bench.{os.getpid()}.partial"
    shutil.copyfile(MODULE, copy)
    copy.replace(package / "_sharp_bench.abi3.so")
    sys.path.insert(0, str(package.parent))


@pytest.fixture(scope="session")
def program():
    def run(*arguments):
        done = subprocess.run([PROGRAM, "--quiet", *map(str, arguments)], check=True, capture_output=True, text=True)
        return done.stdout

    return run


@pytest.fixture
def pictures():
    """A target and a prediction of it, [61, 83, 3] of uint8."""
    y, x = np.mgrid[:61, :83]
    waves = [128 + 90 * np.sin((x * x + y * y) / length) for length in (900, 1200, 1500)]
    target = np.stack(waves, -1)
    noise = np.random.default_rng(7).normal(0, 9, target.shape)
    return [np.clip(array, 0, 255).astype(np.uint8) for array in (target + noise, target)]
