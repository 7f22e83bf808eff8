"""TMPI, tiled multiplane images, with Depth Pro's depth: its own renderings of the target cameras, as pictures.

Calls     tmpi.TMPI, tmpi_renderer.TMPIRenderer, dataset.TMPIDataset and config of facebookresearch/TMPI, written
          against commit 2847eb4 (run.py shows their use), and depth_pro.create_model_and_transforms and
          DepthPro.infer of apple/ml-depth-pro, written against commit 9efe5c1 (src/depth_pro/depth_pro.py). Depth Pro
          replaces DPT, as in the paper, at the place named in TMPI's README: the DPTWrapper that dataset.py imports.
Input     the photograph as their loader reads it: the longer side at most 1024 (bilinear), 0..1, with inverse depth
          stretched to 0..1. Depth Pro sees that picture and the dataset's focal length.
Output    the target camera drawn by their PyTorch renderer, with the source's intrinsics less 0.5, since its pixel
          centres are whole numbers, and target_from_source as the pose, OpenCV axes; the target's part is cut out and
          resized here (Lanczos). Planes are first converted back to inverse metres. Their OpenGL renderer, the default
          of run.py, assumes the principal point in the middle and draws one row lower.
Lost      resolution: 1024. Tiles are padded (config.render_padsz) by as much as content moves, at most 512 pixels;
          pixels that no tile covers are black. With depth=privileged the motion is divided by the median of true over Depth
          Pro's depth.
Licence   CC BY-NC 4.0, not for commercial use; Depth Pro has Apple's. Neither comes with this file.

$ run='python bench/recipes/tiled_mpi.py --checkpoint TMPI/weights/mpti_04.pth --depth-checkpoint depth_pro.pt'
$ PYTHONPATH=TMPI sharp-bench run --dataset middlebury=data/Middlebury2014 --out runs/tmpi \
      --method "command:label=tmpi,run='$run'"
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import tempfile
import types

import numpy as np
import protocol
import torch
from PIL import Image


def load(options: argparse.Namespace):
    from depth_pro.depth_pro import DEFAULT_MONODEPTH_CONFIG_DICT, create_model_and_transforms

    device = torch.device(options.device)
    settings = dataclasses.replace(DEFAULT_MONODEPTH_CONFIG_DICT, checkpoint_uri=options.depth_checkpoint)
    depth_pro, transform = create_model_and_transforms(settings, device=device)
    depth_pro.eval()
    focal = depth = None  # of the source in units of its width, and [H, W] in metres

    def inverse_depth(image: np.ndarray) -> np.ndarray:
        nonlocal depth
        f_px = torch.tensor(focal * image.shape[1], dtype=torch.float32, device=device)
        depth = depth_pro.infer(transform(image), f_px=f_px)["depth"].float().cpu().numpy()
        return 1 / depth

    sys.modules["dpt_wrapper"] = types.SimpleNamespace(DPTWrapper=lambda model_path: inverse_depth)
    import config
    from dataset import TMPIDataset
    from tmpi import TMPI
    from tmpi_renderer import TMPIRenderer

    model = torch.nn.DataParallel(TMPI(num_planes=config.num_planes).to(device).eval())
    model.load_state_dict(torch.load(options.checkpoint, map_location=device))
    least_padding = config.render_padsz

    @torch.no_grad()
    def predict(pair: protocol.Pair) -> Image.Image:
        nonlocal focal
        focal = pair.K_s[0, 0] / pair.source.width
        with tempfile.TemporaryDirectory() as folder:
            pair.source.save(f"{folder}/source.png")
            sample = next(iter(torch.utils.data.DataLoader(TMPIDataset(data_root=folder))))
        tensors = ("src_rgb_tiles", "src_disp_tiles", "src_rgb", "src_disp")
        mpis, planes = model(*(sample[name].to(device) for name in tensors))
        near, far = float(depth.min()), float(depth.max())
        planes = 1 / far + planes * (1 / near - 1 / far)  # their loader's stretching undone
        height, width = depth.shape
        whole = (0, 0, *pair.source.size)
        motion = protocol.in_units_of(depth, pair, whole)
        K_s = protocol.cut_K(pair.K_s, whole, (width, height))
        corners = np.array([[0, width, 0, width], [0, 0, height, height], [1, 1, 1, 1]])
        moved = [K_s @ (motion[:3, :3] @ np.linalg.inv(K_s) @ corners * z + motion[:3, 3:]) for z in (near, far)]
        reach = max(np.abs(points[:2] / points[2] - corners[:2]).max() for points in moved)
        config.render_padsz = min(max(least_padding, math.ceil(reach) + 1), 512)
        # The target's edges in pixels of the source's intrinsics, and the margins that they need.
        edges = np.array([[0, pair.target_size[0]], [0, pair.target_size[1]], [1, 1]])
        (left, right), (top, bottom), _ = K_s @ np.linalg.inv(pair.K_t) @ edges
        x, y = (max(0, math.ceil(-edge)) for edge in (left, top))
        size = [length + max(0, math.ceil(edge - length)) for length, edge in ((height, bottom), (width, right))]
        renderer = TMPIRenderer(size[0] + y, size[1] + x, device)
        sx, sy = sample["sx"].to(device), sample["sy"].to(device)
        K = torch.tensor(K_s - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]], dtype=torch.float32, device=device)
        K = K.repeat(1, sx.shape[1], 1, 1)
        K[..., 0, 2] -= sx
        K[..., 1, 2] -= sy
        pose = torch.tensor(motion[None], dtype=torch.float32, device=device)
        seen = torch.as_tensor(renderer(mpis, planes, pose, K, sx + x, sy + y)[0]).permute(2, 0, 1)
        picture = Image.fromarray(protocol.to_levels(seen))
        return protocol.cut(picture, (left + x, top + y, right + x, bottom + y), pair.target_size)

    return predict


if __name__ == "__main__":
    parser = protocol.arguments(__doc__)
    parser.add_argument("--checkpoint", required=True, help="weights/mpti_04.pth of TMPI")
    parser.add_argument("--depth-checkpoint", required=True, help="depth_pro.pt")
    parsed = parser.parse_args()
    protocol.serve(lambda: load(parsed))
