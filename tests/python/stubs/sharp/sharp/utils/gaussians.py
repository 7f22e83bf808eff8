from typing import NamedTuple

import torch


class Gaussians3D(NamedTuple):
    mean_vectors: torch.Tensor
    singular_values: torch.Tensor
    quaternions: torch.Tensor
    colors: torch.Tensor
    opacities: torch.Tensor


def apply_transform(gaussians, transform):
    assert transform.shape == (3, 4), "an affine map, without its last row"
    linear, offset = transform[:, :3].double(), transform[:, 3].double()
    rotations = _rotations(gaussians.quaternions.double()) * gaussians.singular_values.double()[..., None, :]
    spread = linear @ rotations
    axes, deviations, _ = torch.linalg.svd(spread)
    axes[..., 2] *= torch.linalg.det(axes)[..., None].sign()
    return gaussians._replace(
        mean_vectors=(gaussians.mean_vectors.double() @ linear.T + offset).float(),
        singular_values=deviations.float(),
        quaternions=_quaternions(axes).float(),
    )


def _rotations(q):
    w, x, y, z = torch.nn.functional.normalize(q, dim=-1).unbind(-1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def _quaternions(R):
    """The eigenvector of Bar-Itzhack's matrix, w first."""
    a, b, c = (R[..., i, :] for i in range(3))
    xx, xy, xz, yx, yy, yz, zx, zy, zz = (*a.unbind(-1), *b.unbind(-1), *c.unbind(-1))
    rows = [
        [xx + yy + zz, zy - yz, xz - zx, yx - xy],
        [zy - yz, xx - yy - zz, yx + xy, zx + xz],
        [xz - zx, yx + xy, yy - xx - zz, zy + yz],
        [yx - xy, zx + xz, zy + yz, zz - xx - yy],
    ]
    K = torch.stack([torch.stack(row, -1) for row in rows], -2)
    return torch.linalg.eigh(K)[1][..., -1]
