import plane
import torch


class Cache3D_Buffer:
    def __init__(self, frame_buffer_max=0, noise_aug_strength=0, generator=None, **kwargs):
        assert isinstance(generator, torch.Generator) and kwargs["foreground_masking"] and kwargs["filter_points_threshold"] == 0.05
        self.image, self.depth = kwargs["input_image"], kwargs["input_depth"]
        self.w2c, self.K = kwargs["input_w2c"], kwargs["input_intrinsics"]
        size = self.image.shape[2:]
        assert self.image.shape[:2] == (1, 3) and self.depth.shape == (1, 1, *size)
        assert self.w2c.shape == (1, 4, 4) and self.K.shape == (1, 3, 3)

    def render_cache(self, target_w2cs, target_intrinsics):
        """Pixel centres are whole numbers. Only the last frame is drawn here."""
        frames = target_w2cs.shape[1]
        assert target_w2cs.shape == (1, frames, 4, 4) and target_intrinsics.shape == (1, frames, 3, 3)
        first = [(target_w2cs[:, 0], self.w2c), (target_intrinsics[:, 0], self.K)]
        assert all((a - b).abs().max() < 1e-4 for a, b in first), "the first frame is the source"
        half = torch.tensor([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
        size = tuple(self.image.shape[2:])
        K_s, K_t, z = self.K[0] + half, target_intrinsics[0, -1] + half, float(self.depth.min())
        images = torch.zeros(1, frames, 1, 3, *size)
        images[0, -1, 0] = plane.warp(self.image[0], K_s, K_t, target_w2cs[0, -1] @ self.w2c[0].inverse(), size, z)
        return images, torch.ones(1, frames, 1, 1, *size)
