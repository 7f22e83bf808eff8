"""VGG16's weights, which LPIPS and DISTS in ``sharp_bench`` need."""
