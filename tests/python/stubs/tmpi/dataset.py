import glob

import config
import numpy as np
import torch
from dpt_wrapper import DPTWrapper
from PIL import Image

functional = torch.nn.functional


class TMPIDataset(torch.utils.data.Dataset):
    def __init__(self, data_root, image_ext=("png", "jpeg", "jpg")):
        super().__init__()
        self.image_path_list = sorted(path for ext in image_ext for path in glob.glob(f"{data_root}/**/*.{ext}", recursive=True))
        self.monocular_depth = DPTWrapper(model_path="./DPT/weights/dpt_hybrid-midas-501f0c75.pt")

    def __len__(self):
        return len(self.image_path_list)

    def __getitem__(self, idx):
        picture = torch.from_numpy(np.asarray(Image.open(self.image_path_list[idx]), np.float32) / 255)
        longer = max(picture.shape[:2])
        h, w = (int(min(1, config.imgsz_max / longer) * length) for length in picture.shape[:2])
        rgb = functional.interpolate(picture.permute(2, 0, 1)[None], (h, w), mode="bilinear")
        disparity = torch.from_numpy(self.monocular_depth(rgb[0].permute(1, 2, 0).numpy()))[None, None]
        assert disparity.shape == (1, 1, h, w)
        disparity = (disparity - disparity.min()) / (disparity.max() - disparity.min())
        tile = config.tilesz_min
        step = tile - int(tile * config.padsz2tile_ratio)
        places = [(x, y) for y in range(0, h, step) for x in range(0, w, step)]

        def tiles(whole):
            padded = functional.pad(whole, (0, tile, 0, tile), "replicate")
            return torch.stack([padded[0, :, y : y + tile, x : x + tile] for x, y in places])

        return {
            "src_rgb_tiles": tiles(rgb),
            "src_disp_tiles": tiles(disparity),
            "src_rgb": rgb[0],
            "src_disp": disparity[0],
            "sx": torch.tensor([x for x, _ in places]),
            "sy": torch.tensor([y for _, y in places]),
            "K": torch.full((len(places), 3, 3), float("nan")),  # of an assumed camera, not to be used
        }
