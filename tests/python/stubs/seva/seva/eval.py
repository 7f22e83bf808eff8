import math
import os

import numpy as np
import plane
import torch
from PIL import Image


def load_img_and_K(
    image_path_or_size,
    size,
    scale=1.0,
    center=(0.5, 0.5),
    K=None,
    size_stride=1,
    center_crop=False,
    image_as_tensor=True,
    context_rgb=None,
    device="cuda",
):
    assert size is None and scale == 1.0, "the rest is not stood in for"
    picture = np.asarray(Image.open(image_path_or_size).convert("RGB"), np.float32)
    return torch.from_numpy(picture / 255 * 2 - 1).permute(2, 0, 1)[None], K.clone()


def transform_img_and_K(image, size, scale=1.0, center=(0.5, 0.5), K=None, size_stride=1, mode="crop"):
    """Resized to cover `size` (its shorter side, or width and height), then cut in the middle."""
    assert scale == 1.0 and mode == "crop" and K.ndim == 3
    h, w = image.shape[-2:]
    if not isinstance(size, tuple):
        size = (size, int(size * h / w)) if w < h else (int(size * w / h), size)
    W, H = (math.floor(length / size_stride + 0.5) * size_stride for length in size)
    factor = max(W / w, H / h)
    rh, rw = math.ceil(factor * h - 1e-9), math.ceil(factor * w - 1e-9)
    image = torch.nn.functional.interpolate(image, (rh, rw), mode="bilinear", antialias=True)
    top, left = rh // 2 - H // 2, rw // 2 - W // 2
    K = K.clone()
    assert K[:, :2, 2].max() > 1, "in pixels"
    K[:, :2] *= torch.tensor([rw / w, rh / h])[None, :, None]
    K[:, :2, 2] -= torch.tensor([left, top])
    return image[..., top : top + H, left : left + W], K


def run_one_scene(
    task,
    version_dict,
    model,
    ae,
    conditioner,
    denoiser,
    image_cond,
    camera_cond,
    save_path,
    use_traj_prior,
    traj_prior_Ks,
    traj_prior_c2ws,
    seed=23,
    gradio=False,
    abort_event=None,
    first_pass_pbar=None,
    second_pass_pbar=None,
):
    W, H, options = version_dict["W"], version_dict["H"], version_dict["options"]
    assert task == "img2img" and not use_traj_prior and traj_prior_Ks is None and traj_prior_c2ws is None
    assert (version_dict["T"], version_dict["C"], version_dict["f"]) == (21, 4, 8)
    assert W % 64 == 0 and H % 64 == 0 and min(W, H) == 576
    needed = {"guider_types", "cfg", "num_steps", "cfg_min", "camera_scale"}
    assert needed <= set(options) and options["camera_scale"] > 0
    assert image_cond["input_indices"] == [0] and camera_cond["input_indices"] == [0, 1]
    assert camera_cond["c2w"].shape == (2, 3, 4) and camera_cond["K"].shape == (2, 3, 3)
    images = []
    for i, (image, K) in enumerate(zip(image_cond["img"], camera_cond["K"])):
        assert isinstance(image, np.ndarray) and image.shape == (H, W, 3)
        image = torch.as_tensor(image).permute(2, 0, 1)[None] / 255.0 * 2.0 - 1.0
        image, K = transform_img_and_K(image, (W, H), K=K[None])
        camera_cond["K"][i] = K[0] / torch.tensor([[W], [H], [1]])
        images.append(image)
    images = torch.cat(images)
    assert images.dtype == torch.float32 and images[0].min() >= -1.1 and images[0].max() > 0 and images[1].max() == -1
    print("One pass - chunking")  # to standard output, as the true one does
    c2w = torch.eye(4).repeat(2, 1, 1)
    c2w[:, :3] = camera_cond["c2w"]
    target_from_source = c2w[1].inverse() @ c2w[0]
    # What the network would have to guess.
    scale = options["camera_scale"] * plane.baseline()
    target_from_source[:3, 3] *= scale / target_from_source[:3, 3].norm()
    K_s, K_t = (K * torch.tensor([[W], [H], [1]]) for K in camera_cond["K"])
    seen = plane.warp(images[0], K_s, K_t, target_from_source, (H, W), plane.depth())
    os.makedirs(f"{save_path}/samples-rgb")
    levels = ((seen + 1) / 2 * 255).clamp(0, 255).to(torch.uint8).permute(1, 2, 0).numpy()
    Image.fromarray(levels).save(f"{save_path}/samples-rgb/000.png")
    yield f"{save_path}/samples-rgb.mp4"
