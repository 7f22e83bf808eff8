"""LVSM, the models of scenes: the target view as the transformer predicts it, from one input.

Calls     the class that the configuration names (model.LVSM_scene_decoder_only.Images2LatentScene or its
          encoder-decoder twin) and data.dataset_scene.Dataset.preprocess_poses of Haian-Jin/LVSM, written against
          commit 2fea924.
Input     the square in the middle of the photograph at 256 x 256 (Lanczos; 512 if the configuration says so), 0..1;
          intrinsics f_x, f_y, c_x, c_y in pixels of it, centres at + 0.5; poses camera-to-world, OpenCV axes, moved
          and scaled by their own preprocess_poses.
Output    the square in the middle of the target (crop=center:1:1), sRGB in 0..1.
Lost      the rest of both pictures, and resolution. The models were trained with two inputs or more; here there is
          one. Scale: preprocess_poses normalises the distance of any two cameras, so the network does not know how far
          the target is from the source, and a single photograph does not show it. With scales= that distance is
          multiplied by each scale. Two cameras in one place are refused.
Licence   CC BY-NC-SA 4.0, not for commercial use. Nothing of it comes with this file.

$ run="python bench/recipes/lvsm.py --config LVSM/configs/LVSM_scene_decoder_only.yaml --checkpoint lvsm.pt"
$ PYTHONPATH=LVSM sharp-bench run --dataset middlebury=data/Middlebury2014 --out runs/lvsm \
      --method "command:label=lvsm,crop=center:1:1,resize=bicubic,run='$run'"
"""

from __future__ import annotations

import argparse
import importlib

import numpy as np
import protocol
import torch


def load(options: argparse.Namespace):
    from data.dataset_scene import Dataset
    from easydict import EasyDict
    from omegaconf import OmegaConf

    config = EasyDict(OmegaConf.to_container(OmegaConf.load(options.config), resolve=True))
    config.training.update(num_views=2, num_input_views=1, num_target_views=1, target_has_input=False)
    # Losses are not computed, but the model would load their networks.
    config.training.update(lpips_loss_weight=0.0, perceptual_loss_weight=0.0)
    config.inference.update(if_inference=True)
    module, name = config.model.class_name.rsplit(".", 1)
    model = getattr(importlib.import_module(module), name)(config).to(options.device)
    if model.load_ckpt(options.checkpoint) is None:
        raise SystemExit(f"{options.checkpoint} was not loaded")
    model.eval()
    side = config.model.image_tokenizer.image_size
    kind = {"fp16": torch.float16, "bf16": torch.bfloat16}.get(config.training.amp_dtype, torch.float32)

    def tensor(array) -> torch.Tensor:
        return torch.tensor(np.asarray(array), dtype=torch.float32)

    @torch.no_grad()
    def predict(pair: protocol.Pair) -> np.ndarray:
        if not pair.target_from_source[:3, 3].any():
            raise ValueError("both cameras are at the same position, but LVSM scales by their distance")
        size, square = (side, side), protocol.center_square
        image = tensor(protocol.cut(pair.source, square(pair.source.size), size)).permute(2, 0, 1) / 255
        views = [(pair.K_s, pair.source.size), (pair.K_t, pair.target_size)]
        cameras = [protocol.cut_K(K, square(of), size) for K, of in views]
        poses = tensor(np.stack([np.eye(4), pair.source_from_target]))
        # The method does not use its object, whose construction needs a data set on disk.
        normalised = Dataset.preprocess_poses(None, poses, config.training.get("scene_scale_factor", 1.35))
        normalised[:, :3, 3] *= pair.scale
        batch = {
            "image": image[None, None],
            "c2w": normalised[None],
            "fxfycxcy": tensor([[K[0, 0], K[1, 1], K[0, 2], K[1, 2]] for K in cameras])[None],
        }
        batch = {name: part.to(options.device) for name, part in batch.items()}
        with torch.autocast(torch.device(options.device).type, kind, enabled=config.training.use_amp):
            return protocol.to_levels(model(batch, has_target_image=False).render[0, 0])

    return predict


if __name__ == "__main__":
    parser = protocol.arguments(__doc__)
    parser.add_argument("--config", required=True)
    parser.add_argument("--checkpoint", required=True)
    parsed = parser.parse_args()
    protocol.serve(lambda: load(parsed))
