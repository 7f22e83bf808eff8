import plane
import torch
from easydict import EasyDict


class Images2LatentScene(torch.nn.Module):
    def __init__(self, config):
        super().__init__()
        self.config = config
        self.loaded = False
        losses = config.training.lpips_loss_weight + config.training.perceptual_loss_weight
        assert losses == 0, "their networks want a process group and files"

    def train(self, mode=True):
        super().train(mode)  # which the true one does not return either

    def load_ckpt(self, load_path):
        try:
            torch.load(load_path, map_location="cpu", weights_only=True)
        except Exception:
            return None
        self.loaded = True
        return 0

    def forward(self, data_batch, has_target_image=True):
        training, side = self.config.training, self.config.model.image_tokenizer.image_size
        assert self.loaded and not self.training and not has_target_image and self.config.inference.if_inference
        assert (training.num_views, training.num_input_views, training.num_target_views) == (2, 1, 1)
        assert not training.target_has_input
        image, c2w, cameras = data_batch["image"], data_batch["c2w"], data_batch["fxfycxcy"]
        assert image.shape == (1, 1, 3, side, side) and 0 <= image.min() and image.max() <= 1
        assert c2w.shape == (1, 2, 4, 4) and cameras.shape == (1, 2, 4)
        # 1 as preprocess_poses leaves it.
        scale = c2w[0, :, :3, 3].abs().max() * training.scene_scale_factor
        target_from_source = c2w[0, 1].inverse() @ c2w[0, 0]
        # What the network would have to guess.
        target_from_source[:3, 3] *= scale * plane.baseline() / target_from_source[:3, 3].norm()
        K_s, K_t = (torch.tensor([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]) for fx, fy, cx, cy in cameras[0].tolist())
        seen = plane.warp(image[0, 0], K_s, K_t, target_from_source, (side, side), plane.depth())
        return EasyDict(render=seen[None, None], loss_metrics=None)
