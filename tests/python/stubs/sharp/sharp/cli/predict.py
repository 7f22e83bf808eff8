import numpy as np
import plane
import torch
from sharp.models import RGBGaussianPredictor
from sharp.utils.gaussians import Gaussians3D


@torch.no_grad()
def predict_image(predictor, image, f_px, device):
    """One focal length, and the principal point in the middle."""
    assert isinstance(predictor, RGBGaussianPredictor) and predictor.ready and predictor.weights
    assert isinstance(image, np.ndarray) and image.dtype == np.uint8 and image.ndim == 3 and image.shape[2] == 3
    assert isinstance(f_px, float) and isinstance(device, torch.device)
    height, width = image.shape[:2]
    K = torch.tensor([[f_px, 0, width / 2], [0, f_px, height / 2], [0, 0, 1]])
    return Gaussians3D(*plane.gaussians(torch.from_numpy(image.copy()).permute(2, 0, 1) / 255, K))
