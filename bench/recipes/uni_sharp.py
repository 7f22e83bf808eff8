"""UniSHARP on pinhole photographs: Gaussians of each source, rendered by the harness.

Calls     unisharp.models.unisharp_feature.{UnisharpFeatureConfig, UnisharpFeatureModel} of
          Insta360-Research-Team/UniSHARP, written against commit 5263322.
Input     the photograph with its longer side reduced to 768 (bilinear), as their inference does with perspective
          pictures, both as levels and as 0..1. Intrinsics in pixels of that picture, pixel centres at whole numbers:
          0.5 less than the harness's principal point.
Output    Gaussians in the source camera's space, OpenCV axes, metres; linear RGB, standard deviations, quaternions w,
          x, y, z.
Lost      their renderings divide colour by alpha, so that thin places are not dark; the harness blends over black.
          Their validation renders with a low-pass of 0.01: `sharp-bench run --eps2d config`, which this recipe does
          not set. They hand intrinsics for whole-number pixel centres to gsplat, which puts centres at + 0.5, so
          their own renderings are half a pixel off where the harness's are not. Fisheye and panoramas have no reader
          here. A config.json next to the checkpoint, which their script also reads, is not read: the checkpoint
          has the same values.
Licence   CC BY-NC 4.0, not for commercial use; so is UniK3D, which it needs. Neither comes with this file.

$ python bench/recipes/uni_sharp.py --checkpoint unisharp.pt \
      --dataset middlebury=data/Middlebury2014 --out runs/unisharp
"""

from __future__ import annotations

import dataclasses

import numpy as np
import protocol
import sharp_bench as sb
import torch
from PIL import Image
from unisharp.models.unisharp_feature import UnisharpFeatureConfig, UnisharpFeatureModel

LONGER_SIDE = 768


def main() -> None:
    options = protocol.evaluation(__doc__).parse_args()
    device = torch.device(options.device)
    checkpoint = torch.load(options.checkpoint, map_location="cpu", weights_only=False)
    # The checkpoint states the architecture, under "config" or at the top level.
    stated = {**checkpoint.get("config", {}), **checkpoint}
    names = [field.name for field in dataclasses.fields(UnisharpFeatureConfig)]
    model = UnisharpFeatureModel(UnisharpFeatureConfig(**{name: stated[name] for name in names if name in stated}))
    model = model.to(device)
    model.load_from_checkpoint(options.checkpoint, strict=True)
    model.eval()

    @torch.no_grad()
    def unisharp(source: sb.Source) -> sb.Gaussians:
        picture = Image.fromarray(source.image())
        whole = (0, 0, *picture.size)
        scale = min(1.0, LONGER_SIDE / max(picture.size))
        size = tuple(round(length * scale) for length in picture.size)
        K = protocol.cut_K(source.camera.K, whole, size)
        K[:2, 2] -= 0.5
        levels = np.array(protocol.cut(picture, whole, size, Image.Resampling.BILINEAR))
        image_u8 = torch.from_numpy(levels).permute(2, 0, 1)[None].contiguous().to(device)
        gaussians = model(
            image=image_u8.float() / 255,
            image_u8=image_u8,
            camera_intrinsics=torch.tensor(K[None], dtype=torch.float32, device=device),
            camera_model="pinhole",
        )
        means, scales, quaternions, colors, opacities = (part[0].float().cpu().numpy() for part in gaussians)
        return sb.Gaussians(means, quaternions, scales, opacities, colors)

    protocol.evaluate(unisharp, "unisharp", __file__, options)


if __name__ == "__main__":
    main()
