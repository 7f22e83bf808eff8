"""GEN3C: the last frame of the video that it makes on the way from the source to the target.

Calls     cosmos_predict1.diffusion.inference: gen3c_single_image.{create_parser, _predict_moge_depth},
          cache_3d.Cache3D_Buffer and gen3c_pipeline.Gen3cPipeline of nv-tlabs/GEN3C, written against commit db2ffe1,
          and moge.model.v1.MoGeModel, in the order of gen3c_single_image.demo.
Input     the 20:11 part in the middle of the photograph at 1280 x 704 (Lanczos), levels; MoGe's depth of it. Their
          cache draws that depth from 121 cameras at equal steps, world-to-camera, OpenCV axes, the source the
          identity; intrinsics are the dataset's, not MoGe's, in pixels of that size less 0.5, since their pixel
          centres are whole numbers. Options are those of their README: --guidance 1 --foreground_masking.
Output    the 20:11 part in the middle of the target (crop=center:20:11) at 1280 x 704, sRGB levels.
Lost      the rest of both pictures, and resolution. MoGe's depth has no metric scale: its unit is taken for a metre,
          unless depth=privileged, which divides the motion by the median of true over MoGe's depth. Two targets of
          one source are sampled independently. The paper says that a view is a by-product of a video, but not along
          which path the camera moved. Samples are random: --seed.
Licence   Apache 2.0; the weights have NVIDIA's own. Neither comes with this file.

$ run="python $PWD/bench/recipes/gen3c.py --checkpoint_dir checkpoints"
$ PYTHONPATH=$PWD/GEN3C sharp-bench run --dataset middlebury=data/Middlebury2014 --out runs/gen3c --method \
      "command:label=gen3c,cwd=GEN3C,crop=center:20:11,resize=bicubic,timeout=3600,run='$run'"
"""

from __future__ import annotations

import pathlib
import tempfile

import numpy as np
import protocol
import torch


def load(device: str, arguments: list[str]):
    from cosmos_predict1.diffusion.inference import gen3c_single_image
    from cosmos_predict1.diffusion.inference.cache_3d import Cache3D_Buffer
    from cosmos_predict1.diffusion.inference.gen3c_pipeline import Gen3cPipeline
    from moge.model.v1 import MoGeModel

    theirs = gen3c_single_image.create_parser().parse_args(["--guidance", "1", "--foreground_masking", *arguments])
    same = "checkpoint_dir prompt_upsampler_dir offload_tokenizer offload_text_encoder_model offload_prompt_upsampler"
    same += " offload_guardrail_models disable_prompt_encoder guidance num_steps height width fps seed"
    pipeline = Gen3cPipeline(
        inference_type="video2world",
        checkpoint_name="Gen3C-Cosmos-7B",
        enable_prompt_upsampler=False,
        disable_guardrail=True,
        offload_network=theirs.offload_diffusion_transformer,
        num_video_frames=121,
        **{name: getattr(theirs, name) for name in same.split()},
    )
    moge = MoGeModel.from_pretrained("Ruicheng/moge-vitl").to(device)
    size, frames = (theirs.width, theirs.height), pipeline.model.chunk_size

    def tensor(array) -> torch.Tensor:
        return torch.tensor(np.asarray(array), dtype=torch.float32, device=device)

    @torch.no_grad()
    def predict(pair: protocol.Pair) -> np.ndarray:
        source, target = (protocol.center(of, (20, 11)) for of in (pair.source.size, pair.target_size))
        picture = protocol.cut(pair.source, source, size)
        image, depth, mask, w2c, _ = gen3c_single_image._predict_moge_depth(
            np.asarray(picture), theirs.height, theirs.width, torch.device(device), moge
        )
        known = torch.where(mask, depth, 0)[0, 0, 0].cpu().numpy()
        path = protocol.trajectory(protocol.in_units_of(known, pair, source), frames)
        K_s, K_t = (protocol.cut_K(K, box, size) for K, box in ((pair.K_s, source), (pair.K_t, target)))
        K = K_s + np.linspace(0, 1, frames)[:, None, None] * (K_t - K_s)
        K[:, :2, 2] -= 0.5
        cache = Cache3D_Buffer(
            frame_buffer_max=pipeline.model.frame_buffer_max,
            generator=torch.Generator(device=device).manual_seed(theirs.seed),
            noise_aug_strength=theirs.noise_aug_strength,
            input_image=image[:, 0].clone(),
            input_depth=depth[:, 0],
            input_w2c=w2c[:, 0],
            input_intrinsics=tensor(K[:1]),
            filter_points_threshold=theirs.filter_points_threshold,
            foreground_masking=theirs.foreground_masking,
            device=device,
        )
        images, masks = cache.render_cache(tensor(path)[None], tensor(K)[None])
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "source.png"
            picture.save(file)
            video, _ = pipeline.generate(
                prompt="",
                image_path=str(file),
                negative_prompt=theirs.negative_prompt,
                rendered_warp_images=images,
                rendered_warp_masks=masks,
            )
        return video[-1]

    return predict


if __name__ == "__main__":
    # Every other option is one of theirs: --checkpoint_dir, --seed, --offload_tokenizer, …
    parsed, rest = protocol.arguments(__doc__).parse_known_args()
    protocol.serve(lambda: load(parsed.device, rest))
