import types

import numpy as np
import torch


def get_input_dict(img_tensor, idx, dtype=torch.float32):
    assert img_tensor.shape == (1, 3, 576, 1024) and -1 <= img_tensor.min() < 0
    small = torch.nn.functional.interpolate(img_tensor.to(dtype), (288, 512), mode="bilinear", align_corners=False)
    return {"img": small, "true_shape": np.array([[288, 512]], np.int32), "idx": idx, "instance": str(idx), "img_ori": img_tensor}


def generate_traj(c2ws, H, W, fs, c, device):
    assert c2ws.shape[1:] == (4, 4) and fs.shape == c.shape == (len(c2ws), 2)
    return types.SimpleNamespace(c2ws=c2ws, focals=fs, centres=c, size=(H, W)), len(c2ws)
