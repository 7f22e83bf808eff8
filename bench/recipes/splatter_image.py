"""Splatter Image, the models of ShapeNet cars and chairs: its own renderings of the target cameras, as pictures.

Calls     scene.gaussian_predictor.GaussianSplatPredictor, gaussian_renderer.render_predicted and
          utils.graphics_utils.{focal2fov, getProjectionMatrix} of szymanowiczs/splatter-image, written against commit
          98b4657.
Input     128 x 128, 0..1, one object on white. The model is made for one field of view (52 degrees) around the
          optical axis: that part of the photograph is cut out, white where it leaves the photograph. Matrices are for
          row vectors (transposed), OpenCV axes; the source camera is the identity. The camera was some 1.3 units from
          the object in training; a photograph does not show how many metres a unit is, so --units-per-metre states
          it.
Output    the square in the middle of the target at 128 x 128, sRGB in 0..1, over white. Colours depend on the view
          and were trained to blend in sRGB, which a renderer in linear light changes, so their rasteriser draws
          the picture.
Lost      all but the middle square of the target (crop=center:1:1), resolution, metric scale. It was trained on
          single cut-out objects: on scenes it is a lower bound, not a comparison. CO3D models also need distances to an object's
          origin: refused.
Licence   no licence is stated, and the rasteriser is Inria's, not for commercial use. Neither comes with this file.

$ PYTHONPATH=splatter-image sharp-bench run --dataset nerfstudio=data/car --out runs/splatter --method \
      "command:label=splatter,crop=center:1:1,resize=bicubic,run='python bench/recipes/splatter_image.py --model cars'"
"""

from __future__ import annotations

import argparse
import math
import pathlib

import numpy as np
import protocol
import torch


def load(options: argparse.Namespace):
    from gaussian_renderer import render_predicted
    from omegaconf import OmegaConf
    from scene.gaussian_predictor import GaussianSplatPredictor
    from utils.graphics_utils import focal2fov, getProjectionMatrix

    folder = pathlib.Path(options.model)
    config = OmegaConf.load(folder / ".hydra/config.yaml")
    if config.data.category not in ("cars", "chairs"):
        raise SystemExit(f"a model of {config.data.category}: this recipe is for cars and chairs")
    model = GaussianSplatPredictor(config)
    state = torch.load(folder / "model_latest.pth", map_location="cpu", weights_only=False)
    model.load_state_dict(state["model_state_dict"])
    model = model.to(options.device)
    model.eval()
    side = config.data.training_resolution
    focal = side / 2 / math.tan(math.radians(config.data.fov) / 2)

    def tensor(array) -> torch.Tensor:
        return torch.tensor(np.asarray(array), dtype=torch.float32, device=options.device)

    background = tensor([1.0 if config.data.white_background else 0.0] * 3)

    @torch.no_grad()
    def predict(pair: protocol.Pair) -> np.ndarray:
        reach = pair.K_s.diagonal()[:2] / focal * side / 2
        box = (*(pair.K_s[:2, 2] - reach), *(pair.K_s[:2, 2] + reach))
        image = tensor(protocol.cut(pair.source, box, (side, side))).permute(2, 0, 1) / 255
        gaussians = model(image[None, None], tensor(np.eye(4)[None, None]), tensor([[[1, 0, 0, 0]]]))
        K_t = protocol.cut_K(pair.K_t, protocol.center_square(pair.target_size), (side, side))
        target_from_source = pair.target_from_source.copy()
        target_from_source[:3, 3] *= options.units_per_metre
        view = tensor(target_from_source.T)
        fields = [focal2fov(K_t[axis, axis], side) for axis in (0, 1)]
        projection = getProjectionMatrix(config.data.znear, config.data.zfar, *fields).to(options.device)
        # Their matrix has the principal point in the middle; ours in units of half the picture.
        projection[:2, 2] = tensor(K_t[:2, 2] * 2 / side - 1)
        rendering = render_predicted(
            {name: part[0].contiguous() for name, part in gaussians.items()},
            view,
            view @ projection.T,
            view.inverse()[3, :3],
            background,
            config,
            focals_pixels=tensor(K_t.diagonal()[:2]),
        )
        return protocol.to_levels(rendering["render"])

    return predict


if __name__ == "__main__":
    parser = protocol.arguments(__doc__)
    parser.add_argument("--model", required=True, help="the folder with model_latest.pth and .hydra/config.yaml")
    parser.add_argument("--units-per-metre", type=float, default=1.0)
    parsed = parser.parse_args()
    protocol.serve(lambda: load(parsed))
