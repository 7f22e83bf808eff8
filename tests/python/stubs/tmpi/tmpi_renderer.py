import config
import plane
import torch


class TMPIRenderer(torch.nn.Module):
    def __init__(self, ho, wo, device="cuda:0"):
        super().__init__()
        self.ho, self.wo = ho, wo

    def forward(self, mpis, mpi_disp, cam_ext, K, sx, sy):
        """The planes of all tiles seen through `cam_ext`, target from source; each K is in the pixels of its tile."""
        b, n, _, _, h, w = mpis.shape
        assert b == 1 and K.shape == (1, n, 3, 3) and sx.shape == sy.shape == (1, n) and cam_ext.shape[1:] == (4, 4)
        canvas = torch.zeros(3, self.ho + h, self.wo + w)
        for tile, x, y in zip(mpis[0, :, 0, :3], sx[0], sy[0]):
            canvas[:, y : y + h, x : x + w] = tile
        whole = K[0].clone()
        whole[:, 0, 2] += sx[0]
        whole[:, 1, 2] += sy[0]
        assert (whole - whole[0]).abs().max() < 1e-3, "one camera"
        K = whole[0] + torch.tensor([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])  # its pixel centres are whole numbers
        z = 1 / float(mpi_disp[0, :, 0].median())
        ends = torch.tensor([[0.0, self.wo], [0, self.ho], [1, 1]])
        moved = K @ (cam_ext[0, :3, :3] @ K.inverse() @ ends * z + cam_ext[0, :3, 3:])
        # A tile is cut off this far beyond its edges.
        assert (moved[:2] / moved[2] - ends[:2]).abs().max() <= config.render_padsz
        size = (self.ho, self.wo)
        return [plane.warp(canvas, K, K, pose, size, z).permute(1, 2, 0).cpu().numpy() for pose in cam_ext]
