import plane
import torch


def render_predicted(
    pc,
    world_view_transform,
    full_proj_transform,
    camera_center,
    bg_color,
    cfg,
    scaling_modifier=1.0,
    override_color=None,
    focals_pixels=None,
):
    n = cfg.data.training_resolution
    assert pc["xyz"].shape == (n * n, 3) and pc["features_dc"].shape == (n * n, 1, 3)
    assert world_view_transform.shape == full_proj_transform.shape == (4, 4) and camera_center.shape == (3,)
    assert torch.equal(world_view_transform[:3, 3], torch.zeros(3)), "matrices are for row vectors"
    assert torch.allclose(camera_center @ world_view_transform[:3, :3], -world_view_transform[3, :3], atol=1e-5)
    assert torch.equal(bg_color, torch.ones(3))
    projection = (world_view_transform.inverse() @ full_proj_transform).T
    K = torch.eye(3)
    K[0, 0], K[1, 1] = projection[0, 0] * n / 2, projection[1, 1] * n / 2
    assert torch.allclose(K.diagonal()[:2], focals_pixels, rtol=1e-4), "splats take their shape from these"
    K[:2, 2] = (projection[:2, 2] + 1) * n / 2
    picture = (pc["features_dc"][:, 0] * 0.28209479 + 0.5).reshape(n, n, 3).permute(2, 0, 1)
    z = float(pc["xyz"][0, 2])
    half = abs(float(pc["xyz"][0, 0])) / z * n / (n - 1)
    K_s = torch.tensor([[n / 2 / half, 0, n / 2], [0, n / 2 / half, n / 2], [0, 0, 1]])
    return {"render": plane.warp(picture, K_s, K, world_view_transform.T, (n, n), z)}
