import pathlib

import plane
import torch


class GaussianPredictor(torch.nn.Module):
    def __init__(self, cfg):
        super().__init__()
        self.cfg = cfg
        self.loaded = False
        self._is_train = True

    def load_model(self, weights_path, optimiser=None, device="cpu", ckpt_ids=0):
        assert pathlib.Path(weights_path).exists()
        self.loaded = True

    def set_eval(self):
        self._is_train = False

    def forward(self, inputs):
        data = self.cfg.dataset
        assert self.loaded and not self._is_train, "the background is random in training"
        assert self.cfg.data_loader.batch_size == 1, "unprojection is made for that many"
        assert not data.scale_pose_by_depth or ("depth_sparse", 0) in inputs
        padded, margin = inputs["color_aug", 0, 0], data.pad_border_aug
        assert padded.shape == (1, 3, data.height + 2 * margin, data.width + 2 * margin)
        assert padded.dtype == torch.float32
        assert 0 <= padded.min() and 0.1 < padded.max() <= 1
        inside = padded[..., margin:-margin, margin:-margin]
        assert padded.count_nonzero() == inside.count_nonzero(), "the margin is black"
        height, width = inputs["color", 0, 0].shape[2:]
        assert height <= data.height
        # Two Gaussians a pixel, the first at UniDepth's depth; nothing is known in the margin.
        depth = torch.full((2, 1, *padded.shape[2:]), 1e-3)
        depth[0, ..., margin:-margin, margin:-margin] = plane.predicted_depth()
        outputs = {("depth", 0): depth}
        for frame in [0, *inputs["target_frame_ids"]]:
            target_from_source = inputs["T_c2w", frame][0].inverse() @ inputs["T_c2w", 0][0]
            K = inputs["K_tgt", frame][0].clone()
            assert K.shape == (3, 3)
            if data.name in ["kitti", "nyuv2", "waymo"]:
                K = inputs["K_tgt", 0][0]
            elif data.name in ["co3d", "re10k", "mixed"]:
                K[:2, 2] = torch.tensor([width / 2, height / 2])
            K_source = inputs["K_src", 0][0]
            seen = plane.warp(padded[0], K_source, K, target_from_source, (height, width), plane.predicted_depth())
            outputs["color_gauss", frame, 0] = seen[None]
        return outputs
