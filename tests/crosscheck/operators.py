"""The network's operators and what is made of them in torch, for the cases of the example crosscheck_training's module
operators. Maps are [row][column][channel] there.
"""

import torch
import torch.nn.functional as F


class Kinks(Exception):
    """A unit is so close to switching that f32 may decide differently from f64."""


# Of the largest value of a layer: Winograd's rounding, relative L2, is 6e-7. Only what is differentiated counts.
MARGIN = 5e-7


def relu(x):
    if x.requires_grad and (x.abs() < MARGIN * x.abs().max()).any():
        raise Kinks
    return F.relu(x)


def planes(map):
    return map.permute(2, 0, 1)[None]


def convolution(stride, padding):
    def function(x, weight, bias, residual, upstream):
        y = F.conv2d(relu(planes(x)), weight, bias, stride, padding) + planes(residual)
        return (relu(y) * planes(upstream)).sum()
    return function


def group_norm(x, gamma, beta, upstream):
    return (F.group_norm(x.T[None], 8, gamma, beta, 1e-5)[0].T * upstream).sum()


def gelu(x, upstream):
    return (F.gelu(x) * upstream).sum()


def inverse_softplus(t):
    return t + torch.log(-torch.expm1(-t))


def gaussians(image, depth, deltas, **of):
    """Two layers of depth to base Gaussians, to the decoder's input, and with deltas to Gaussians."""
    layers, height, width = depth.shape
    rows, columns = height // 2, width // 2
    factor = 1 / (depth.min() + 1e-6)
    inverse = 1 / (depth * factor).clamp(max=100)
    features = 2 * torch.cat([image, inverse]) - 1
    nearest = F.max_pool2d(inverse[None], 2)[0]
    sizes = 2 * 2 / width / nearest
    x = (2 * torch.arange(columns) + 1) * 2 / width - 1
    y = (2 * torch.arange(rows) + 1) * 2 / height - 1

    refined = F.softplus(inverse_softplus(nearest) + 1e-3 * deltas[2])
    z = 1 / (refined + 1e-3)
    means = torch.stack([z * (x + 1e-3 * deltas[0]), z * (y[:, None] + 1e-3 * deltas[1]), z]) / factor
    growth = 10 * torch.sigmoid(10 / 9 * deltas[3:6] + torch.logit(torch.tensor(0.1, dtype=torch.float64)))
    scales = sizes * nearest * z * growth / factor
    quaternions = deltas[6:10] + torch.tensor([1, 0, 0, 0])[:, None, None, None]
    base = F.avg_pool2d(image[None], 2)[0].clamp(0.01, 0.99)[:, None]
    encoded = torch.sigmoid(torch.logit(base) + 0.1 * deltas[10:13])
    colors = torch.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    opacities = torch.sigmoid(deltas[13:])
    every = torch.cat([means, scales, quaternions, colors, opacities]).flatten(1).T
    return (every * of["of gaussians"]).sum() + (features * of["of features"]).sum()


def alignment(known, predicted, upstream, **weights):
    """The U-Net over both inverse depths; the exponential of what it gives is the map of factors."""

    def conv(x, name):
        weight = weights[f"{name}.weight"]
        return F.conv2d(x, weight, weights[f"{name}.bias"], padding=weight.shape[-1] // 2)

    def norm(x, name):
        return F.group_norm(x, 4, weights[f"{name}.weight"], weights[f"{name}.bias"])

    def block(x, name):
        y = conv(relu(norm(x, f"{name}.residual.0")), f"{name}.residual.2")
        y = conv(relu(norm(y, f"{name}.residual.3")), f"{name}.residual.5")
        return y + (conv(x, f"{name}.shortcut") if f"{name}.shortcut.weight" in weights else x)

    def pair(x, name):
        return block(block(x, f"{name}.1"), f"{name}.2")

    steps = 2
    x = 1 / torch.stack([predicted.expand_as(known), known])[None]
    maps = [relu(norm(conv(x, "encoder.conv_in.0"), "encoder.conv_in.1"))]
    for k in range(steps):
        maps.append(pair(F.avg_pool2d(maps[-1], 2), f"encoder.convs_down.{k}"))
    x = maps.pop()
    for k in range(steps):
        x = pair(F.interpolate(x, scale_factor=2), f"decoder.convs_up.{k}")
        x = torch.cat([x, maps.pop()], 1)
    x = conv(relu(norm(x, "decoder.conv_out.0")), "decoder.conv_out.2")
    x = conv(relu(norm(x, "decoder.conv_out.3")), "conv_out")
    return (torch.exp(x[0, 0]) * upstream).sum()


OPERATORS = {
    "convolution 3x3": convolution(1, 1), "convolution 1x1": convolution(1, 0),
    "group norm": group_norm, "gelu": gelu, "gaussians": gaussians, "alignment": alignment,
}
