"""Records Depth Pro's official network, narrowed, with deterministic weights. None of its code is here.

usage: PYTHONPATH=ml-depth-pro/src python record.py FOLDER
"""

import csv
import functools
import json
import sys
from pathlib import Path

import numpy as np
import timm
import torch
from depth_pro.depth_pro import DEFAULT_MONODEPTH_CONFIG_DICT, DepthPro, create_model_and_transforms
from depth_pro.network.decoder import MultiresConvDecoder
from depth_pro.network.encoder import DepthProEncoder
from PIL import Image
from safetensors.numpy import save_file

MODEL = Path(__file__).parents[1] / "model"
sys.path.insert(0, str(MODEL))
import det_weights  # noqa: E402

SHARPS = "monodepth_model.monodepth_predictor."
# As the official code turns timm's 14-pixel patches into those of 16.
ENCODER = "vit_large_patch14_dinov2"


def encoder(sizes):
    model = timm.create_model(ENCODER, pretrained=False, dynamic_img_size=True, img_size=sizes["img_size"],
                              patch_size=sizes["patch_size"], embed_dim=sizes["embed_dim"], depth=sizes["depth"],
                              num_heads=sizes["num_heads"])
    model.forward = model.forward_features
    return model


def narrow():
    sizes = json.loads((MODEL / "tiny_config.json").read_text())["narrow"]
    features = sizes["monodepth_dims_decoder"][0]
    dims = sizes["encoder_dims"]
    make = functools.partial(encoder, sizes["vit"])
    pyramid = DepthProEncoder(dims, make(), make(), sizes["hook_ids"], features)
    decoder = MultiresConvDecoder([features, *dims], features)
    return DepthPro(pyramid, decoder, last_dims=(32, 1), fov_encoder=make()).eval()


def value(name, shape):
    """The depth network's parameters are those of SHARP's recordings, of its first layer."""
    if name == "fov.head.4.bias":
        return np.full(shape, 48, np.float32)
    return det_weights.tensor(name if name.startswith("fov.") else SHARPS + name, shape)


def main(folder):
    with torch.device("meta"):
        full, _ = create_model_and_transforms(
            DEFAULT_MONODEPTH_CONFIG_DICT.__class__(**{**vars(DEFAULT_MONODEPTH_CONFIG_DICT), "checkpoint_uri": None}),
            device=torch.device("meta"))
    with (folder / "state_dict.csv").open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["name", "shape"])
        for name, tensor in full.state_dict().items():
            table.writerow([name, "x".join(map(str, tensor.shape))])

    model = narrow()
    # The release's file has half precision.
    state = {name: torch.from_numpy(value(name, tensor.shape)).half() for name, tensor in model.state_dict().items()}
    torch.save(state, folder / "narrow_model.pt")
    model.load_state_dict({name: tensor.float() for name, tensor in state.items()}, strict=True)

    picture = np.asarray(Image.open(MODEL / "inputs/main_640x480.png").convert("RGB"))
    x = torch.from_numpy(picture.copy()).permute(2, 0, 1)[None].float() / 255 * 2 - 1
    with torch.no_grad():
        side = model.img_size
        resized = torch.nn.functional.interpolate(x, size=(side, side), mode="bilinear", align_corners=False)
        inverse, degrees = model(resized)
        found = {"inverse_depth": inverse, "fov_deg": degrees.reshape(1),
                 "depth_500px": model.infer(x, f_px=torch.tensor(500.0))["depth"]}
        estimated = model.infer(x)
        found |= {"depth_estimated": estimated["depth"], "focal_px": estimated["focallength_px"].reshape(1)}
    out = {}
    for stage, tensor in found.items():
        values = tensor.numpy().ravel()
        print(stage, tuple(tensor.shape), values.min(), values.mean(), values.max())
        if values.size > 512:
            values = values[det_weights.sample_indices(stage, values.size)]
        out[stage] = np.ascontiguousarray(values)
    save_file(out, folder / "golden_narrow.safetensors",
              {"torch": torch.__version__, "timm": timm.__version__, "image": "main_640x480.png"})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
