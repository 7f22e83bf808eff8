import os
import types

import plane
import torch


class ViewCrafter:
    def __init__(self, opts, gradio=False):
        self.opts = opts
        assert gradio and os.path.exists(opts.ckpt_path), "the rest is not stood in for"

    def run_dust3r(self, input_images, clean_pc=False):
        assert torch.is_grad_enabled(), "it optimises"
        assert [image["idx"] for image in input_images] == [0, 1]
        image = input_images[-1]["img"]
        H, W = (int(length) for length in input_images[-1]["true_shape"][0])
        assert image.shape == (1, 3, H, W)
        depth = torch.nn.Parameter(torch.full((H, W), plane.predicted_depth()))
        picture = (image[0].permute(1, 2, 0) / 2 + 0.5).numpy()
        self.scene = types.SimpleNamespace(imgs=[picture] * 2, get_depthmaps=lambda: [depth * 7, depth])

    def run_render(self, pcd, imgs, masks, H, W, camera_traj, num_views, nbv=False):
        """Points seen by cameras in pixels with centres at + 0.5; [views, H, W, 3] in 0..1."""
        (points,), (picture,) = pcd, imgs
        assert points.shape == picture.shape == (H, W, 3) and points.dtype == torch.float32 and masks is None
        assert camera_traj.size == (H, W) and num_views == self.opts.video_length
        # The camera whose pixels have these points.
        z = points[0, 0, 2]
        fx, fy = (W - 1) * z / (points[0, -1, 0] - points[0, 0, 0]), (H - 1) * z / (points[-1, 0, 1] - points[0, 0, 1])
        cx, cy = 0.5 - fx * points[0, 0, 0] / z, 0.5 - fy * points[0, 0, 1] / z
        K_s = torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        picture = torch.as_tensor(picture).permute(2, 0, 1)
        seen = []
        for c2w, (fx, fy), (cx, cy) in zip(camera_traj.c2ws, camera_traj.focals, camera_traj.centres):
            K = torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
            seen.append(plane.warp(picture, K_s, K, c2w.inverse(), (H, W), z))
        return torch.stack(seen).permute(0, 2, 3, 1), None

    def run_diffusion(self, renderings):
        assert renderings.shape == (self.opts.video_length, 576, 1024, 3)
        # The first frame is the photograph, which the rendering of it resembles.
        assert 0 <= renderings[0].min() and (renderings[0] - renderings[1]).abs().mean() < 0.1
        return (renderings * 2 - 1).clamp(-1, 1)
