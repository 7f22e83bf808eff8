"""Losses of training, the renderer's derivative and the network's operators against torch's autograd in f64.

The example crosscheck_training writes one file per case: inputs, our value, our gradients. Here each case is a
function of its inputs that gives the value anew; autograd gives its gradients. To add a quantity, write its cases
there and its function into CASES.
"""

import json
import math
from pathlib import Path

import torch
import torch.nn.functional as F
import torchvision
from safetensors.torch import load_file

from operators import MARGIN, OPERATORS, Kinks, relu

# Sums of ours are f64, their gradients rounded to f32; networks and renderer compute in f32. Gradients are compared
# relative to the largest of their kind.
VALUE = 1e-9
ROUNDED = 1e-6
F32 = 1e-4

BUNDLED = Path(__file__).parents[2] / "metrics/weights"
MEAN = torch.tensor([0.485, 0.456, 0.406], dtype=torch.float64)
DEVIATION = torch.tensor([0.229, 0.224, 0.225], dtype=torch.float64)


def forward(map):
    """∂x and ∂y to the next pixel, zero across the edge."""
    dx = F.pad(map[..., :, 1:] - map[..., :, :-1], (0, 1))
    dy = F.pad(map[..., 1:, :] - map[..., :-1, :], (0, 0, 0, 1))
    return dx, dy


def central(map):
    padded = F.pad(map[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    dx = (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]) / 2
    dy = (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]) / 2
    return dx, dy


def color(predicted, target, mask):
    return ((predicted - target).abs() * mask[..., None]).mean()


def color_other(predicted, target, mask):
    return ((predicted - target).abs() * mask[..., None]).sum() / mask.sum()


def cross_entropy(alpha, mask):
    # torch's own clamps logarithms at −100, ours the alpha.
    alpha = alpha.clamp(min=1e-6)
    return F.binary_cross_entropy(alpha, torch.ones_like(alpha), reduction="none") * mask


def alpha(alpha, mask):
    return cross_entropy(alpha, mask).mean()


def alpha_other(alpha, mask):
    return cross_entropy(alpha, mask).sum() / mask.sum()


def depth(predicted, truth, unit=1):
    difference = (unit / predicted - unit / truth).abs()
    return torch.where(truth > 0, difference, 0).mean()


def tv(depth):
    dx, dy = forward(1 / depth)
    return (dx.abs() + dy.abs()).mean()


def edges(opacity, norm):
    return (opacity * (1 - torch.exp(-F.relu(norm - 0.01) / 0.01))).mean()


def grad(opacity, inverse):
    dx, dy = forward(inverse)
    return edges(opacity, (dx.abs() + dy.abs()).detach())


def grad_other(opacity, inverse):
    dx, dy = central(inverse / 0.5)
    return edges(opacity, (dx**2 + dy**2).sqrt())


def of_squares(differences):
    return [F.avg_pool2d(difference, 2) for difference in differences]


def grad_projected(opacity, depth):
    dx, dy = of_squares(forward(0.5 / depth))
    return edges(opacity, (dx.abs() + dy.abs()).detach())


def grad_projected_other(opacity, depth):
    dx, dy = of_squares(central(1 / depth))
    return edges(opacity, (dx**2 + dy**2).sqrt())


def delta(raw):
    return F.relu(raw.abs() - 400).mean(dim=(1, 2)).sum()


def bounded(variances):
    return F.relu(variances - 100) + F.relu(0.1 - variances)


def splat(covariances):
    uu, uv, vv = covariances.unbind(-1)
    matrices = torch.stack([torch.stack([uu, uv], -1), torch.stack([uv, vv], -1)], -1)
    return bounded(torch.linalg.eigvalsh(matrices) * (1536 / 96) ** 2).sum(-1).mean()


def splat_other(covariances):
    return bounded((covariances[:, 0] + covariances[:, 2]) / 2 * (1536 / 96) ** 2).mean()


def scale(scale):
    return (scale - 1).abs().mean()


def scale_gradient(scale):
    total = 0
    for k in range(1, 7):
        dx, dy = forward(F.avg_pool2d(scale[None], 2**k)[0])
        total = total + (dx.abs() + dy.abs()).mean()
    return total


def scale_gradient_other(scale):
    total = 0
    for k in range(1, 7):
        # The first pixel of each complete block of 2^k × 2^k.
        rows, columns = (side // 2**k * 2**k for side in scale.shape)
        dx, dy = forward(scale[:rows : 2**k, :columns : 2**k])
        square = dx**2 + dy**2
        # torch's root has no derivative at 0.
        total = total + torch.where(square > 0, square, 1).sqrt().where(square > 0, 0).mean() / 2**k
    return total


def encoded(linear):
    above = linear > 0.0031308
    curve = 1.055 * torch.where(above, linear, 1) ** (1 / 2.4) - 0.055
    return torch.where(above, curve, 12.92 * linear)


def srgb(linear, upstream):
    return (encoded(linear) * upstream).sum()


def max_pool(x, side, padding):
    windows = F.unfold(x.detach()[0][:, None], side, padding=padding, stride=2)
    first, second = windows.topk(2, dim=1).values.unbind(1)
    if x.requires_grad and ((first > 0) & (first - second < MARGIN * first.max())).any():
        raise Kinks
    return F.max_pool2d(x, side, stride=2, padding=padding)


class Vgg16:
    """torchvision's features, up to four layers."""

    taps = (3, 8, 15, 22)

    def __init__(self):
        self.layers = torchvision.models.vgg16(weights=None).features.double().requires_grad_(False)
        stored = load_file(BUNDLED / "vgg16.safetensors")
        self.layers.load_state_dict({name.removeprefix("features."): v.double() for name, v in stored.items()})

    def __call__(self, x):
        found = []
        for index, layer in enumerate(self.layers[: self.taps[-1] + 1]):
            if isinstance(layer, torch.nn.ReLU):
                x = relu(x)
            elif isinstance(layer, torch.nn.MaxPool2d):
                x = max_pool(x, 2, 0)
            else:
                x = layer(x)
            if index in self.taps:
                found.append(x)
        return found


class Bottleneck(torch.nn.Module):
    def __init__(self, inputs, narrow, stride, dilation, shortcut):
        super().__init__()
        conv, norm = torch.nn.Conv2d, torch.nn.BatchNorm2d
        self.conv1, self.bn1 = conv(inputs, narrow, 1, bias=False), norm(narrow)
        self.conv2 = conv(narrow, narrow, 3, stride, dilation, dilation, bias=False)
        self.bn2 = norm(narrow)
        self.conv3, self.bn3 = conv(narrow, 4 * narrow, 1, bias=False), norm(4 * narrow)
        self.downsample = None
        if shortcut:
            fit = conv(inputs, 4 * narrow, 1, stride, bias=False)
            self.downsample = torch.nn.Sequential(fit, norm(4 * narrow))

    def forward(self, x):
        out = relu(self.bn1(self.conv1(x)))
        out = relu(self.bn2(self.conv2(out)))
        return relu(self.bn3(self.conv3(out)) + (self.downsample(x) if self.downsample else x))


class Resnet50Dilated(torch.nn.Module):
    """The public encoder's names and shapes, its weights from the seed."""

    # Blocks, stride of the first, dilation of the first and of the others.
    stages = ((3, 1, 1, 1), (4, 2, 1, 1), (6, 1, 1, 2), (3, 1, 2, 4))

    def __init__(self):
        super().__init__()
        channels = 3
        for index, out in ((1, 64), (2, 64), (3, 128)):
            conv = torch.nn.Conv2d(channels, out, 3, 2 if index == 1 else 1, 1, bias=False)
            self.add_module(f"conv{index}", conv)
            self.add_module(f"bn{index}", torch.nn.BatchNorm2d(out))
            channels = out
        for number, (blocks, stride, first, others) in enumerate(self.stages):
            narrow, layers = 64 * 2**number, []
            for block in range(blocks):
                start = block == 0
                layers.append(Bottleneck(channels, narrow, stride if start else 1, first if start else others, start))
                channels = 4 * narrow
            self.add_module(f"layer{number + 1}", torch.nn.Sequential(*layers))

    def forward(self, x):
        for index in (1, 2, 3):
            x = relu(getattr(self, f"bn{index}")(getattr(self, f"conv{index}")(x)))
        x, found = max_pool(x, 3, 1), []
        for number in range(1, 5):
            x = getattr(self, f"layer{number}")(x)
            found.append(x)
        return found

    def seed(self, seed):
        """Convolutions from the seed, and normalisations as if trained on one picture. Their shifts keep most units
        away from zero, those of a channel on one side in all blocks, so that rounding switches none."""
        generator = torch.Generator().manual_seed(seed)

        def uniform(tensor, low, high):
            tensor.data = torch.empty(tensor.shape).uniform_(low, high, generator=generator)

        for module in self.modules():
            if isinstance(module, torch.nn.Conv2d):
                bound = math.sqrt(3 / module.weight[0].numel())
                uniform(module.weight, -bound, bound)
            elif isinstance(module, torch.nn.BatchNorm2d):
                uniform(module.weight, 0.2, 0.35)
                uniform(module.bias, 0.9, 1.3)
                module.bias.data[::2] *= -1
                module.momentum = 1
        with torch.no_grad():
            self.train()(torch.empty(1, 3, 96, 96).uniform_(-2, 2, generator=generator))
        return self.eval()


def perceptual(network, on_features, predicted, target, mask):
    inputs = []
    for picture in (predicted, target):
        if not on_features:
            picture = picture * mask[..., None]
        inputs.append(((picture - MEAN) / DEVIATION).permute(2, 0, 1)[None])
    with torch.no_grad():
        theirs = network(inputs[1])
    total = 0
    for a, b in zip(network(inputs[0]), theirs):
        if on_features:
            weights = covered(mask, a)
            a, b = a * weights, b * weights
        a, b = a[0].flatten(1), b[0].flatten(1)
        channels, pixels = a.shape
        gram = (a @ a.T - b @ b.T) / pixels
        total = total + ((a - b) ** 2).mean() + 10 / channels**2 * (gram**2).sum()
    return total


def covered(mask, map):
    """The mean over the whole pixels that each pixel of a layer covers, without overlaps."""
    (height, width), (rows, columns) = mask.shape, map.shape[2:]

    def bounds(i, large, small):
        return slice(i * large // small, (i + 1) * large // small)

    return torch.stack([
        torch.stack([mask[bounds(y, height, rows), bounds(x, width, columns)].mean() for x in range(columns)])
        for y in range(rows)])


def rotation(quaternion):
    w, x, y, z = F.normalize(quaternion, dim=-1).unbind(-1)
    rows = ((1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)))
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def projected(means, quaternions, scales, camera_from_scene, view):
    """Centres in the camera, where they fall, and 2D covariances without the filter."""
    fx, fy, cx, cy, width, height, _ = view.unbind()
    linear = camera_from_scene[:, :3]
    p = means @ linear.T + camera_from_scene[:, 3]
    x, y, z = p.unbind(-1)

    # The Jacobian is taken at most 0.3 half fields of view beyond the picture.
    def slope(at, focal, centre, side):
        margin = 0.15 * side / focal
        return torch.clamp(at / z, -(centre / focal + margin), (side - centre) / focal + margin)

    sx, sy, zero = slope(x, fx, cx, width), slope(y, fy, cy, height), torch.zeros_like(z)
    jacobian = torch.stack([torch.stack([fx / z, zero, -fx * sx / z], -1),
                            torch.stack([zero, fy / z, -fy * sy / z], -1)], -2)
    axes = jacobian @ linear @ rotation(quaternions) * scales[:, None, :]
    return p, torch.stack([fx * x / z + cx, fy * y / z + cy], -1), axes @ axes.transpose(1, 2)


def covariances(means, quaternions, scales, camera_from_scene, view, upstream):
    _, _, shapes = projected(means, quaternions, scales, camera_from_scene, view)
    return (torch.stack([shapes[:, 0, 0], shapes[:, 0, 1], shapes[:, 1, 1]], -1) * upstream).sum()


def rendered(means, quaternions, scales, opacities, colors, camera_from_scene, view):
    """Blends every Gaussian at every pixel, front to back: colour, alpha, depth."""
    p, centres, shapes = projected(means, quaternions, scales, camera_from_scene, view)
    width, height, eps = int(view[4]), int(view[5]), view[6]
    drawn = [k for k in p[:, 2].argsort(stable=True).tolist()
             if 0.01 <= p[k, 2] <= 1e10 and opacities[k] >= 1 / 255]
    inverse = torch.linalg.inv(shapes + eps * torch.eye(2, dtype=torch.float64))
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], -1).double()
    passing = torch.ones(height, width, dtype=torch.float64)
    going = torch.ones(height, width, dtype=torch.bool)
    rgb, depth = torch.zeros(height, width, 3, dtype=torch.float64), torch.zeros(height, width, dtype=torch.float64)
    for k in drawn:
        d = centres[k] - pixels
        sigma = 0.5 * (d @ inverse[k] * d).sum(-1)
        alpha = (opacities[k] * torch.exp(-sigma)).clamp(max=0.999)
        seen = going & (alpha.detach() >= 1 / 255)
        # A Gaussian that would reduce the transmittance to 1e-4 or less finishes the pixel and is not added.
        going = going & ~(seen & (passing.detach() * (1 - alpha.detach()) <= 1e-4))
        alpha = torch.where(seen & going, alpha, 0)
        weight = alpha * passing
        rgb = rgb + weight[..., None] * colors[k]
        depth = depth + weight * p[k, 2]
        passing = passing * (1 - alpha)
    return rgb, 1 - passing, depth


def renderer(**case):
    upstream = [case.pop(f"of {part}") for part in ("rgb", "alpha", "depth")]
    return sum((picture * weights).sum() for picture, weights in zip(rendered(**case), upstream))


# By name of a case, without its number: its function, and the tolerances of values and gradients.
LOSSES = {
    "color": color, "color other": color_other, "alpha": alpha, "alpha other": alpha_other, "depth": depth,
    "depth other": lambda predicted, truth: depth(predicted, truth, 0.5), "tv": tv, "grad": grad,
    "grad other": grad_other, "grad projected": grad_projected, "grad projected other": grad_projected_other,
    "delta": delta, "splat": splat, "splat other": splat_other, "scale": scale,
    "scale gradient": scale_gradient, "scale gradient other": scale_gradient_other,
}
CASES = {name: (function, VALUE, ROUNDED) for name, function in LOSSES.items()}
# Encoded in f32.
CASES["srgb"] = (srgb, F32, ROUNDED)
CASES["renderer"] = (renderer, F32, F32)
CASES["covariances"] = (covariances, VALUE, ROUNDED)
CASES |= {name: (function, F32, F32) for name, function in OPERATORS.items()}
NETWORKS = ("vgg16", "vgg16 features", "resnet50dilated")

EXPECTED = {f"training: {name}{part}" for name in [*CASES, "surgery", *(f"perceptual {n}" for n in NETWORKS)]
            for part in ("", " ∇")}


def compare_case(comparison, name, case, stored):
    function, of_value, of_gradient = case
    inputs = {key: tensor.double() for key, tensor in stored.items() if key != "value" and not key.startswith("d ")}
    leaves = {key: inputs[key].requires_grad_() for key in inputs if f"d {key}" in stored}
    value = function(**inputs)
    gradients = torch.autograd.grad(value, list(leaves.values()))
    scale = abs(value.item())
    # A bias before a normalisation has hardly any gradient, so all gradients of a network's weights share one scale.
    least = 1e-3 * max(theirs.abs().max().item() for theirs in gradients) if name == "alignment" else 0
    comparison.add(f"training: {name}", "torch", stored["value"].item() / scale, value.item() / scale, of_value)
    for key, theirs in zip(leaves, gradients):
        largest = max(theirs.abs().max().item(), least)
        comparison.add(f"training: {name} ∇", "torch's autograd", stored[f"d {key}"].double().numpy() / largest,
                       theirs.numpy() / largest, of_gradient)


def compare(comparison, run, program, rng, folder):
    folder.mkdir(parents=True)
    seed = int(rng.integers(2**31))
    resnet = Resnet50Dilated().seed(seed)
    weights = folder / "encoder_epoch_20.pth"
    torch.save(resnet.state_dict(), weights)
    run([program], json.dumps({"seed": seed, "folder": str(folder), "resnet50dilated": str(weights)}))
    resnet = resnet.double().requires_grad_(False)
    vgg = Vgg16()
    cases = dict(CASES)
    for name, network in zip(NETWORKS, (vgg, vgg, resnet)):
        def function(predicted, target, mask, network=network, on_features=name.endswith("features")):
            return perceptual(network, on_features, predicted, target, mask)
        cases[f"perceptual {name}"] = (function, F32, F32)

    def surgery(target, **scene):
        picture, _, _ = rendered(**scene)
        return perceptual(vgg, False, encoded(picture), target, torch.ones(target.shape[:2]))

    cases["surgery"] = (surgery, F32, F32)
    left_out = 0
    for file in sorted(folder.glob("*.safetensors")):
        name = file.name.split(".")[0]
        try:
            compare_case(comparison, name, cases[name], load_file(file))
        except Kinks:
            left_out += 1
    print(f"training: {left_out} cases with a unit at its kink are not compared")
