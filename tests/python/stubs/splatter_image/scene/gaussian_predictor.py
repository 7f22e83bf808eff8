import math

import plane
import torch


class GaussianSplatPredictor(torch.nn.Module):
    def __init__(self, cfg):
        super().__init__()
        self.cfg = cfg
        self.weight = torch.nn.Parameter(torch.zeros(1))

    def forward(self, x, source_cameras_view_to_world, source_cv2wT_quat=None, focals_pixels=None):
        n = self.cfg.data.training_resolution
        assert not self.training and self.weight == 1
        assert x.shape == (1, 1, 3, n, n) and 0 <= x.min() and x.max() <= 1
        assert source_cameras_view_to_world.shape == (1, 1, 4, 4) and source_cv2wT_quat.shape == (1, 1, 4)
        assert torch.equal(source_cameras_view_to_world[0, 0], torch.eye(4)) and source_cv2wT_quat[0, 0, 0] == 1
        assert focals_pixels is None, "not for cars and chairs"
        # One Gaussian a pixel, at the plane's depth in their units, along rays of the one field of view.
        z = plane.depth() * 0.5
        assert self.cfg.data.znear <= z <= self.cfg.data.zfar
        focal = n / 2 / math.tan(math.radians(self.cfg.data.fov / 2))
        offsets = (torch.arange(n) + 0.5 - n / 2) / focal * z
        y, x_ = torch.meshgrid(offsets, offsets, indexing="ij")
        xyz = torch.stack([x_, y, torch.full_like(y, z)], -1).reshape(1, -1, 3)
        features = (x[0, 0].permute(1, 2, 0).reshape(1, -1, 1, 3) - 0.5) / 0.28209479
        return {"xyz": xyz, "features_dc": features, "opacity": torch.ones(1, n * n, 1)}
