"""Stable Virtual Camera: a sampled target view, from one input.

Calls     seva.eval.{load_img_and_K, transform_img_and_K, run_one_scene}, seva.model.SGMWrapper,
          seva.utils.load_model, seva.modules.autoencoder.AutoEncoder, seva.modules.conditioner.CLIPConditioner and
          seva.sampling.DiscreteDenoiser of Stability-AI/stable-virtual-camera, written against commit fe19948.
Input     the photograph with its shorter side at 576 and both sides multiples of 64, by their own resize and crop in
          the middle; cameras are camera-to-world, OpenCV axes, intrinsics in pixels. The options are those of their
          demo's task img2img, the first of 21 frames is the source and the target fills the others.
Output    one sRGB picture of the same size. The camera that is asked for shows the whole target, with a margin where
          the aspects differ; the target's part of it is cut out and resized here (Lanczos), up or down.
Lost      some columns or rows at the source's border (the crop). Scale: they centre the two cameras and bring the
          source's distance from the centre to --camera-scale (2), whatever it was in metres; they sweep 0.1 to 2.0
          for one input and keep the best, as --camera-scale 1 with scales=0.1+0.2+…+2 does here. Two targets of one
          source are sampled independently, and nothing makes them agree. Samples are random: --seed.
Licence   Stability AI's non-commercial licence, code and weights. Neither comes with this file.

$ PYTHONPATH=stable-virtual-camera sharp-bench run --dataset middlebury=data/Middlebury2014 --out runs/seva --method \
      "command:label=seva,timeout=1800,run='python bench/recipes/stable_virtual_camera.py --camera-scale 2'"
"""

from __future__ import annotations

import argparse
import pathlib
import tempfile

import numpy as np
import protocol
import torch
from PIL import Image

# The values of their demo. "H" and "W" are set for each source.
VERSION = {"T": 21, "C": 4, "f": 8}
OPTIONS = {"chunk_strategy": "nearest-gt", "video_save_fps": 30.0, "beta_linear_start": 5e-6, "log_snr_shift": 2.4}
OPTIONS |= {"guider_types": 1, "cfg": 2.0, "num_steps": 50, "cfg_min": 1.2, "encoding_t": 1, "decoding_t": 1}


def load(options: argparse.Namespace):
    from seva.eval import load_img_and_K, run_one_scene, transform_img_and_K
    from seva.model import SGMWrapper
    from seva.modules.autoencoder import AutoEncoder
    from seva.modules.conditioner import CLIPConditioner
    from seva.sampling import DiscreteDenoiser
    from seva.utils import load_model

    device = options.device
    networks = {
        "model": SGMWrapper(load_model(1.1, options.weights, "model.safetensors", device="cpu").eval()).to(device),
        "ae": AutoEncoder(chunk_size=1).to(device),
        "conditioner": CLIPConditioner().to(device),
        "denoiser": DiscreteDenoiser(num_idx=1000, device=device),
    }

    def predict(pair: protocol.Pair) -> Image.Image:
        with tempfile.TemporaryDirectory() as folder:
            pair.source.save(f"{folder}/source.png")
            image, K_s = load_img_and_K(f"{folder}/source.png", None, K=torch.tensor(pair.K_s).float(), device="cpu")
            image, K_s = transform_img_and_K(image, 576, K=K_s[None], size_stride=64)
            source = ((image[0] + 1) / 2 * 255).permute(1, 2, 0).numpy()
            height, width = source.shape[:2]
            # A camera with the whole target in the middle of such a picture.
            scale = min(width / pair.target_size[0], height / pair.target_size[1])
            x, y = ((have - need * scale) / 2 for have, need in zip((width, height), pair.target_size))
            around = (-x / scale, -y / scale, (width - x) / scale, (height - y) / scale)
            K_t = torch.tensor(protocol.cut_K(pair.K_t, around, (width, height))).float()
            c2w = torch.tensor(np.stack([np.eye(4), pair.source_from_target])[:, :3]).float()
            settings = {**OPTIONS, "camera_scale": options.camera_scale * pair.scale}
            made = run_one_scene(
                "img2img",
                {**VERSION, "H": height, "W": width, "options": settings},
                **networks,
                image_cond={"img": [source, np.zeros_like(source)], "input_indices": [0], "prior_indices": None},
                camera_cond={"c2w": c2w, "K": torch.stack([K_s[0], K_t]), "input_indices": [0, 1]},
                save_path=folder,
                use_traj_prior=False,
                traj_prior_Ks=None,
                traj_prior_c2ws=None,
                seed=options.seed,
            )
            list(made)  # a generator, which computes while it is consumed
            picture = Image.open(pathlib.Path(folder) / "samples-rgb/000.png").convert("RGB")
            return protocol.cut(picture, (x, y, width - x, height - y), pair.target_size)

    return predict


if __name__ == "__main__":
    parser = protocol.arguments(__doc__)
    parser.add_argument("--weights", default="stabilityai/stable-virtual-camera", help="or a folder")
    parser.add_argument("--camera-scale", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=23)
    parsed = parser.parse_args()
    protocol.serve(lambda: load(parsed))
