import argparse

import numpy as np
import plane
import torch


def create_parser():
    parser = argparse.ArgumentParser()
    for name, default in {
        "checkpoint_dir": "checkpoints",
        "prompt_upsampler_dir": "Pixtral-12B",
        "negative_prompt": "ugly",
        "num_steps": 35,
        "guidance": 1.0,
        "height": 704,
        "width": 1280,
        "fps": 24,
        "seed": 1,
        "noise_aug_strength": 0.0,
        "filter_points_threshold": 0.05,
    }.items():
        parser.add_argument(f"--{name}", type=type(default), default=default)
    parts = ("diffusion_transformer", "tokenizer", "text_encoder_model", "prompt_upsampler", "guardrail_models")
    for name in ["foreground_masking", "disable_prompt_encoder", *(f"offload_{part}" for part in parts)]:
        parser.add_argument(f"--{name}", action="store_true")
    return parser


def _predict_moge_depth(current_image_path, target_h, target_w, device, moge_model):
    """Picture in -1..1 [1, 1, 3, H, W], depth and mask [1, 1, 1, H, W], the identity, and MoGe's own intrinsics."""
    assert isinstance(current_image_path, np.ndarray) and current_image_path.dtype == np.uint8 and moge_model.is_loaded
    image = torch.from_numpy(current_image_path.copy()).float().permute(2, 0, 1)[None, None] / 127.5 - 1
    assert image.shape == (1, 1, 3, target_h, target_w)
    depth = torch.full((1, 1, 1, target_h, target_w), plane.predicted_depth())
    # Most of the picture could be sky.
    mask = torch.ones_like(depth, dtype=torch.bool)
    mask[..., target_h // 3 :, :] = False
    estimated = torch.eye(3)[None, None] * 100
    return image, torch.where(mask, depth, 1000), mask, torch.eye(4)[None, None], estimated
