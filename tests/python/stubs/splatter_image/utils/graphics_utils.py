import math

import torch


def focal2fov(focal, pixels):
    return 2 * math.atan(pixels / (2 * focal))


def getProjectionMatrix(znear, zfar, fovX, fovY):
    """For column vectors; the principal point in the middle."""
    depth = zfar - znear
    rows = [[1 / math.tan(fovX / 2), 0, 0, 0], [0, 1 / math.tan(fovY / 2), 0, 0]]
    return torch.tensor([*rows, [0, 0, zfar / depth, -zfar * znear / depth], [0, 0, 1, 0]])
