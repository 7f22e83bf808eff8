"""ViewCrafter: the last frame of the video that it makes on the way from the source to the target.

Calls     viewcrafter.ViewCrafter (run_dust3r, run_render, run_diffusion), configs.infer_config.get_parser and
          utils.pvd_utils.{get_input_dict, generate_traj} of Drexubery/ViewCrafter, written against commit 8408cd5, in
          the order of nvs_single_view_eval (viewcrafter.py).
Input     the 16:9 part in the middle of the photograph at 1024 x 576 (Lanczos), -1..1; DUSt3R sees it twice, at
          512 x 288. Their point renderer draws its depth along the dataset's own rays from 25 cameras at equal steps,
          camera-to-world, OpenCV axes, intrinsics in pixels of 512 x 288, centres at + 0.5; the first is the source,
          whose frame is the photograph.
Output    the 16:9 part in the middle of the target (crop=center:16:9) at 1024 x 576, sRGB in 0..1.
Lost      the rest of both pictures, and resolution. DUSt3R's depth has no metric scale: its unit is taken for a metre,
          unless depth=privileged, which divides the motion by the median of true over DUSt3R's depth. Two targets of
          one source are sampled independently. The paper does not say along which path the camera moved. Samples are
          random: --seed.
Licence   Apache 2.0; DUSt3R, which it contains, is CC BY-NC-SA 4.0, not for commercial use. Neither comes with this
          file.

$ run="python $PWD/bench/recipes/view_crafter.py --checkpoint checkpoints/model.ckpt"
$ PYTHONPATH=$PWD/ViewCrafter sharp-bench run --dataset middlebury=data/Middlebury2014 --out runs/viewcrafter --method \
      "command:label=viewcrafter,cwd=ViewCrafter,crop=center:16:9,resize=bicubic,timeout=1800,run='$run'"
"""

from __future__ import annotations

import argparse

import numpy as np
import protocol
import torch


def load(options: argparse.Namespace):
    from configs.infer_config import get_parser
    from utils.pvd_utils import generate_traj, get_input_dict
    from viewcrafter import ViewCrafter

    paths = ["--ckpt_path", options.checkpoint, "--config", options.config, "--model_path", options.dust3r]
    theirs = get_parser().parse_args([*paths, "--device", options.device, "--seed", str(options.seed)])
    crafter = ViewCrafter(theirs, gradio=True)  # without a picture from a file
    size, frames = (theirs.width, theirs.height), theirs.video_length

    def tensor(array) -> torch.Tensor:
        return torch.tensor(np.asarray(array), dtype=torch.float32, device=options.device)

    def predict(pair: protocol.Pair) -> np.ndarray:
        torch.manual_seed(options.seed)
        source, target = (protocol.center(of, (16, 9)) for of in (pair.source.size, pair.target_size))
        image = tensor(protocol.cut(pair.source, source, size)) / 255
        crafter.images = [get_input_dict(image.permute(2, 0, 1)[None] * 2 - 1, index) for index in (0, 1)]
        crafter.run_dust3r(input_images=crafter.images)
        depth = crafter.scene.get_depthmaps()[-1].detach().cpu().numpy()
        height, width = depth.shape
        K_s, K_t = (
            protocol.cut_K(K, box, (width, height)) for K, box in ((pair.K_s, source), (pair.K_t, target))
        )
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        points = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(K_s).T * depth[..., None]
        path = np.linalg.inv(protocol.trajectory(protocol.in_units_of(depth, pair, source), frames))
        K = K_s + np.linspace(0, 1, frames)[:, None, None] * (K_t - K_s)
        focals, centres = tensor(K[:, [0, 1], [0, 1]]), tensor(K[:, :2, 2])
        cameras, count = generate_traj(tensor(path), height, width, focals, centres, options.device)
        colors = np.asarray(crafter.scene.imgs[-1], np.float32)
        with torch.no_grad():
            seen, _ = crafter.run_render([tensor(points)], [colors], None, height, width, cameras, count)
            seen = seen.permute(0, 3, 1, 2)
            seen = torch.nn.functional.interpolate(seen, size[::-1], mode="bilinear", align_corners=False)
            seen = seen.permute(0, 2, 3, 1)
            seen[0] = image
            video = crafter.run_diffusion(seen)
        return protocol.to_levels((video[-1].permute(2, 0, 1) + 1) / 2)

    return predict


if __name__ == "__main__":
    parser = protocol.arguments(__doc__)
    parser.add_argument("--checkpoint", required=True, help="of the model of 25 frames at 576 x 1024")
    parser.add_argument("--config", default="configs/inference_pvd_1024.yaml")
    parser.add_argument("--dust3r", default="checkpoints/DUSt3R_ViTLarge_BaseDecoder_512_dpt.pth")
    parser.add_argument("--seed", type=int, default=123)
    parsed = parser.parse_args()
    protocol.serve(lambda: load(parsed))
