"""SHARP as Apple released it: Gaussians of each source, rendered by the harness.

Calls     sharp.models.{PredictorParams, create_predictor}, sharp.cli.predict.predict_image and
          sharp.utils.gaussians.apply_transform of apple/ml-sharp, written against commit 1eaa046.
Input     the photograph as it is, 8 bit; predict_image makes it 1536 x 1536. One focal length in pixels, from the
          dataset (the `sharp predict` command would read EXIF or assume 30 mm). The network assumes that the
          principal point is the middle and that pixels are square.
Output    Gaussians in the source camera's space, OpenCV axes, metres; linear RGB, standard deviations, quaternions w,
          x, y, z: the harness's own conventions, so nothing is converted. Where the true principal point is not the
          middle, or f_y not f_x, Gaussians are sheared so that each lies on the ray of the pixel that it was
          predicted for.
Lost      nothing that is known. The harness renders as the release does: linear light, no low-pass, over black.
Licence   Apple's sample code licence; the weights are for research only (LICENSE_MODEL). Neither comes with this
          file.

$ python bench/recipes/sharp_release.py --checkpoint sharp_2572gikvuh.pt \
      --dataset middlebury=data/Middlebury2014 --out runs/sharp-release
"""

from __future__ import annotations

import protocol
import sharp_bench as sb
import torch
from sharp.cli.predict import predict_image
from sharp.models import PredictorParams, create_predictor
from sharp.utils.gaussians import apply_transform


def main() -> None:
    options = protocol.evaluation(__doc__).parse_args()
    device = torch.device(options.device)
    predictor = create_predictor(PredictorParams())
    predictor.load_state_dict(torch.load(options.checkpoint, weights_only=True, map_location="cpu"))
    predictor.eval()
    predictor.to(device)

    def sharp_release(source: sb.Source) -> sb.Gaussians:
        image, K = source.image(), source.camera.K
        height, width = image.shape[:2]
        focal = float(K[0, 0])
        gaussians = predict_image(predictor, image, focal, device)
        # From x = (u - width / 2) / focal * z, which the release takes for granted, to x = (u - c_x) / f_x * z.
        true_from_assumed = torch.eye(4)[:3]
        true_from_assumed[1, 1] = focal / K[1, 1]
        true_from_assumed[0, 2] = (width / 2 - K[0, 2]) / K[0, 0]
        true_from_assumed[1, 2] = (height / 2 - K[1, 2]) / K[1, 1]
        if not torch.equal(true_from_assumed, torch.eye(4)[:3]):
            gaussians = apply_transform(gaussians, true_from_assumed.to(device))
        means, scales, quaternions, colors, opacities = (part[0].float().cpu().numpy() for part in gaussians)
        return sb.Gaussians(means, quaternions, scales, opacities, colors)

    protocol.evaluate(sharp_release, "sharp-release", __file__, options)


if __name__ == "__main__":
    main()
