import types

import numpy as np
from PIL import Image


class Gen3cPipeline:
    def __init__(
        self,
        inference_type,
        checkpoint_dir,
        checkpoint_name,
        prompt_upsampler_dir=None,
        enable_prompt_upsampler=True,
        has_text_input=True,
        offload_network=False,
        offload_tokenizer=False,
        offload_text_encoder_model=False,
        offload_prompt_upsampler=False,
        offload_guardrail_models=False,
        disable_guardrail=False,
        disable_prompt_encoder=False,
        guidance=7.0,
        num_steps=35,
        height=704,
        width=1280,
        fps=24,
        num_video_frames=121,
        seed=0,
    ):
        assert (inference_type, checkpoint_name) == ("video2world", "Gen3C-Cosmos-7B")
        assert not enable_prompt_upsampler and disable_guardrail and offload_tokenizer
        assert (guidance, num_video_frames) == (1, 121)
        self.size = (width, height)
        self.model = types.SimpleNamespace(frame_buffer_max=2, chunk_size=9)  # 121 in truth

    def generate(self, prompt, image_path, rendered_warp_images, rendered_warp_masks, negative_prompt=None):
        print("Run generation")
        assert prompt == "" and negative_prompt and Image.open(image_path).size == self.size
        frames, (width, height) = self.model.chunk_size, self.size
        assert rendered_warp_images.shape == (1, frames, 1, 3, height, width)
        assert rendered_warp_masks.shape == (1, frames, 1, 1, height, width)
        levels = ((rendered_warp_images[0, :, 0] + 1) * 127.5).round().clamp(0, 255).permute(0, 2, 3, 1)
        return levels.numpy().astype(np.uint8), prompt
