"""Flash3D: its own renderings of the target cameras, as pictures.

Calls     models.model.GaussianPredictor with the configuration layered_re10k of eldar/flash3d, written against commit
          a71c9b9.
Input     the photograph squeezed to 384 x 256 (Lanczos), 0..1, with 32 black pixels around it; intrinsics in pixels
          of what the network sees, centres at + 0.5 (their loader places the principal point rightly only in the
          middle). Poses are camera-to-world, OpenCV axes; the source's is the identity.
Output    `color_gauss` of the target, sRGB in 0..1. Their Gaussians have view-dependent colours and were trained to
          blend in sRGB, which a renderer in linear light changes, so their rasteriser draws the picture. It draws the
          target's aspect at 256 rows, the density of training, and the harness enlarges it.
Lost      resolution: 256 rows. Translations are metres against UniDepth's metric depth, or with depth=privileged
          divided by the median of true over UniDepth's depth; their evaluation instead fits a scale for each picture
          to COLMAP's points. The background is their grey.
Licence   no licence is stated, and the rasteriser is Inria's, not for commercial use. Neither comes with this file.

$ PYTHONPATH=flash3d sharp-bench run --dataset middlebury=data/Middlebury2014 --out runs/flash3d --method \
      "command:label=flash3d,resize=bicubic,run='python bench/recipes/flash3d.py --checkpoint model_re10k_v2.pth'"
"""

from __future__ import annotations

import argparse
import pathlib

import numpy as np
import protocol
import torch
from PIL import Image


def load(options: argparse.Namespace):
    import models.model
    from hydra import compose, initialize_config_dir

    # An unknown name keeps the target's principal point; under "re10k" the centre would be used.
    overrides = ["+experiment=layered_re10k", "model.depth.version=v1", "data_loader.batch_size=1"]
    overrides += ["dataset.name=harness", "dataset.scale_pose_by_depth=false"]
    folder = pathlib.Path(models.model.__file__).resolve().parents[1] / "configs"
    with initialize_config_dir(str(folder), version_base=None):
        config = compose("config", overrides=overrides)
    model = models.model.GaussianPredictor(config).to(options.device)
    model.load_model(options.checkpoint)
    model.set_eval()
    width, height, margin = config.dataset.width, config.dataset.height, config.dataset.pad_border_aug

    def tensor(array) -> torch.Tensor:
        return torch.tensor(np.asarray(array)[None], dtype=torch.float32, device=options.device)

    @torch.no_grad()
    def predict(pair: protocol.Pair) -> np.ndarray:
        image = tensor(pair.source.resize((width, height), Image.Resampling.LANCZOS)).permute(0, 3, 1, 2) / 255
        K_s = protocol.cut_K(pair.K_s, (0, 0, *pair.source.size), (width, height))
        K_s[:2, 2] += margin
        target_width, target_height = pair.target_size
        rows = min(height, target_height)
        columns = round(target_width * rows / target_height)
        K_t = tensor(protocol.cut_K(pair.K_t, (0, 0, *pair.target_size), (columns, rows)))
        inputs = {
            ("color_aug", 0, 0): torch.nn.functional.pad(image, (margin,) * 4),
            ("color", 0, 0): image.new_zeros(1, 3, rows, columns),  # only its size is looked at, for renderings
            ("K_src", 0): tensor(K_s),
            ("K_tgt", 0): K_t,
            ("K_tgt", 1): K_t,
            ("T_c2w", 0): tensor(np.eye(4)),
            ("T_c2w", 1): tensor(pair.source_from_target),
            "target_frame_ids": [1],
        }
        outputs = model(inputs)
        if pair.depth is not None:
            # The first of its depths at each pixel is UniDepth's.
            depth = outputs["depth", 0][0, 0, margin:-margin, margin:-margin].cpu().numpy()
            motion = protocol.in_units_of(depth, pair, (0, 0, *pair.source.size))
            outputs = model({**inputs, ("T_c2w", 1): tensor(np.linalg.inv(motion))})
        return protocol.to_levels(outputs["color_gauss", 1, 0][0])

    return predict


if __name__ == "__main__":
    parser = protocol.arguments(__doc__)
    parser.add_argument("--checkpoint", required=True)
    parsed = parser.parse_args()
    protocol.serve(lambda: load(parsed))
