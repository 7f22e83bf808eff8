import torch


class Dataset(torch.utils.data.Dataset):
    def preprocess_poses(self, in_c2ws, scene_scale_factor=1.35):
        """Poses about their mean, the farthest coordinate at 1 / factor; the true one also turns them."""
        assert in_c2ws.ndim == 3 and in_c2ws.shape[1:] == (4, 4) and in_c2ws.dtype == torch.float32
        out = in_c2ws.clone()
        out[:, :3, 3] -= out[:, :3, 3].mean(0)
        out[:, :3, 3] /= out[:, :3, 3].abs().max() * scene_scale_factor
        return out
