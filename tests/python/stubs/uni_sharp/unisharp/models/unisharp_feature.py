from dataclasses import dataclass
from typing import NamedTuple

import plane
import torch


@dataclass
class UnisharpFeatureConfig:
    unik3d_backbone: str = "vitl"
    unik3d_resolution_level: int = 0
    initializer_stride: int = 1
    initializer_scale_factor: float = 1.5
    max_distance_m: float = 100.0
    detach_init_layer0_distance: bool = True
    delta_rho_limit: float = 2.0


class Gaussians3D(NamedTuple):
    mean_vectors: torch.Tensor
    singular_values: torch.Tensor
    quaternions: torch.Tensor
    colors: torch.Tensor
    opacities: torch.Tensor


class UnisharpFeatureModel(torch.nn.Module):
    def __init__(self, config):
        super().__init__()
        self.config = config
        self.loaded = False

    def load_from_checkpoint(self, ckpt_path, strict=False):
        assert strict, "what does not fit would be left at random"
        checkpoint = torch.load(ckpt_path, map_location="cpu", weights_only=False)
        assert self.config.initializer_scale_factor == checkpoint["config"]["initializer_scale_factor"]
        assert self.config.unik3d_backbone == checkpoint["unik3d_backbone"]
        self.loaded = True
        return [], []

    def forward(
        self,
        image,
        image_u8=None,
        camera_intrinsics=None,
        camera_params=None,
        camera_model=None,
        depth_gt=None,
        distance_init_cap_m=None,
        validity_mask=None,
        return_aux=False,
    ):
        assert self.loaded and not self.training
        assert image.dtype == torch.float32 and image.ndim == 4 and image.shape[:2] == (1, 3) and image.max() <= 1
        assert image_u8.dtype == torch.uint8 and image_u8.shape == image.shape
        assert torch.equal(image, image_u8.float() / 255) and max(image.shape[2:]) <= 768
        assert camera_intrinsics.shape == (1, 3, 3) and camera_model == "pinhole" and camera_params is None
        assert depth_gt is None, "what a single photograph does not have"
        K = camera_intrinsics[0].clone()
        K[:2, 2] += 0.5  # pixel centres are whole numbers there
        made = Gaussians3D(*plane.gaussians(image[0], K))
        return {"gaussians": made} if return_aux else made
