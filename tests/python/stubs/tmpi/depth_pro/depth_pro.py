import dataclasses
import os
import pathlib

import plane
import torch


@dataclasses.dataclass
class DepthProConfig:
    checkpoint_uri: str | None = None


DEFAULT_MONODEPTH_CONFIG_DICT = DepthProConfig(checkpoint_uri="./checkpoints/depth_pro.pt")


class DepthPro(torch.nn.Module):
    def infer(self, x, f_px=None, interpolation_mode="bilinear"):
        """Depth is proportional to the given focal length."""
        assert not self.training and x.shape[0] == 3 and -1 <= x.min() < 0 and x.max() <= 1
        focal = float(f_px) / x.shape[2]
        depth = torch.full(x.shape[1:], plane.predicted_depth() * focal / float(os.environ["STUB_FOCAL"]))
        depth[0, 0] /= 2
        depth[0, 1] *= 2
        return {"depth": depth, "focallength_px": f_px.squeeze()}


def create_model_and_transforms(config=DEFAULT_MONODEPTH_CONFIG_DICT, device=None, precision=torch.float32):
    assert pathlib.Path(config.checkpoint_uri).exists()
    return DepthPro(), lambda picture: torch.from_numpy(picture).permute(2, 0, 1) * 2 - 1
