import torch


class TMPI(torch.nn.Module):
    def __init__(self, num_planes=4):
        super().__init__()
        self.num_planes = num_planes
        self.weight = torch.nn.Parameter(torch.zeros(1))

    def forward(self, rgb_tiles, inv_depth_tiles, rgb, inv_depth):
        assert self.weight == 1 and not self.training
        b, n, channels, h, w = rgb_tiles.shape
        assert (b, channels) == (1, 3) and inv_depth_tiles.shape == (1, n, 1, h, w)
        assert rgb.shape[2:] == inv_depth.shape[2:] and (inv_depth.min(), inv_depth.max()) == (0, 1)
        planes = torch.full((1, n, self.num_planes), 1e-7)
        planes[..., 0] = inv_depth_tiles.flatten(2).median(-1).values
        mpis = torch.zeros(1, n, self.num_planes, 4, h, w)
        mpis[:, :, 0, :3], mpis[:, :, 0, 3] = rgb_tiles, 1
        return mpis, planes
