"""The scene that all stubs know: a plane at z = STUB_DEPTH in the source camera's space."""

import os

import torch


def depth() -> float:
    return float(os.environ["STUB_DEPTH"])


def predicted_depth() -> float:
    """Depth of the plane as a network predicts it, in a unit of its own."""
    return depth() * float(os.environ.get("STUB_DEPTH_FACTOR", "1"))


def baseline() -> float:
    """What methods without a scale of their own have to guess."""
    return float(os.environ["STUB_BASELINE"])


def warp(picture, K_s, K_t, target_from_source, size, z):
    """The target's view [3, *size] of a plane at z that looks like `picture` [3, H, W]; pixel centres at + 0.5."""
    height, width = size
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    rays = torch.stack([x, y, torch.ones_like(x)], -1).double() @ K_t.double().inverse().T
    source_from_target = target_from_source.double().inverse()
    directions = rays @ source_from_target[:3, :3].T
    origin = source_from_target[:3, 3]
    points = origin + directions * ((z - origin[2]) / directions[..., 2:])
    seen = points @ K_s.double().T
    grid = seen[..., :2] / seen[..., 2:] / torch.tensor([picture.shape[2], picture.shape[1]]) * 2 - 1
    options = {"mode": "bicubic", "padding_mode": "border", "align_corners": False}
    return torch.nn.functional.grid_sample(picture[None].double(), grid[None], **options)[0].float()


def gaussians(picture, K):
    """Means, deviations, quaternions, colours, opacities; two Gaussians a pixel of `picture` [3, H, W], sRGB in 0..1.

    The nearer ones are narrow: wide ones hide each other, and which lies before which would move the picture. Wider
    ones behind them, in the opposite order, close the gaps. They are flat along the optical axis only by their
    rotation: who mixes up the order of a quaternion sees them from the edge.
    """
    _, height, width = picture.shape
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    rays = torch.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], torch.ones_like(x)], -1)
    rays = rays.reshape(-1, 3)
    means = torch.cat([rays * depth(), rays.flip(0) * depth() * 1.003])
    count = len(means)
    pixel = depth() / float(K[0, 0])
    widths = torch.tensor([0.4, 0.7]).repeat_interleave(count // 2)
    deviations = widths[:, None] * pixel * torch.tensor([1, 0.01, 1])
    quaternions = torch.tensor([0.5**0.5, 0.5**0.5, 0, 0]).repeat(count, 1)
    linear = torch.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
    colors = linear.permute(1, 2, 0).reshape(-1, 3)
    colors = torch.cat([colors, colors.flip(0)])
    return tuple(part[None].float() for part in (means, deviations, quaternions, colors, torch.full((count,), 0.99)))
