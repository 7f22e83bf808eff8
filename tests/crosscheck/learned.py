"""LPIPS with its layers and spatial maps, and DISTS, against the packages of their authors.

The networks get weights made from the seed; both sides read the same files, one of each form that users have. Pictures
are floats, exchanged as safetensors. The packages compute in f64.
"""

import json
import math
import os
import warnings
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
import OpenEXR
import torch
import torchvision

# Neither package may download weights; torchvision warns about how they call it.
warnings.filterwarnings("ignore", module="torchvision")
import DISTS_pytorch
import lpips

# LPIPS may differ by 1e-6, or by 2e-5 of the value where that is more; its maps by 2e-6; DISTS by 1e-6. The one
# published number has four digits.
LPIPS = 1e-6
LPIPS_RELATIVE = 2e-5
MAPS = 2e-6
DISTS = 1e-6
REAL = 2e-6
PUBLISHED = 5e-5

ARCHITECTURES = {"alex": "alexnet", "vgg": "vgg16", "squeeze": "squeezenet1_1"}
SIZES = [(64, 80), (67, 99), (90, 70)]

EXPECTED = {f"lpips[{net},v0.1]{part}" for net in ARCHITECTURES for part in ("", " layers", " map")}
EXPECTED |= {"lpips[vgg,v0.1,unscaled]", "dists", "dists terms", "dists[resize256]"}
EXPECTED |= {f"{name}, published weights" for name in ("alex", "vgg", "dists")}
BUNDLED = Path(__file__).parents[2] / "metrics/weights"


def empty(architecture):
    """A torchvision network without values; initialising them would take longer than everything else."""
    with torch.device("meta"):
        return getattr(torchvision.models, architecture)(weights=None).features


def seeded_weights(architecture, rng):
    """Values that keep activations at one scale through all layers."""
    weights = {}
    for name, tensor in empty(architecture).state_dict().items():
        bound = math.sqrt(6 / tensor[0].numel()) if tensor.dim() > 1 else 0.05
        values = rng.uniform(-bound, bound, tuple(tensor.shape)).astype(np.float32)
        weights[name] = torch.from_numpy(values)
    return weights


def network(architecture, weights):
    """What the packages take from torchvision: something with `features`."""
    features = empty(architecture).to_empty(device="cpu")
    features.load_state_dict(weights)
    return mock.Mock(features=features)


def lpips_of(net, weights):
    architecture = ARCHITECTURES[net]
    found = network(architecture, weights)
    with mock.patch.object(torchvision.models, architecture, return_value=found):
        return lpips.LPIPS(net=net, pnet_rand=True, verbose=False).double()


def dists_of(weights):
    with mock.patch.object(torchvision.models, "vgg16", return_value=network("vgg16", weights)):
        model = DISTS_pytorch.DISTS(load_weights=False)
    # Saved on a GPU, which the package itself would require.
    file = Path(DISTS_pytorch.__file__).with_name("weights.pt")
    stored = torch.load(file, map_location="cpu", weights_only=True)
    model.alpha.data, model.beta.data = stored["alpha"], stored["beta"]
    return model.double()


def write_safetensors(path, tensors):
    entries, values = {}, b""
    for name, tensor in tensors.items():
        data = np.ascontiguousarray(tensor, "<f4").tobytes()
        offsets = [len(values), len(values) + len(data)]
        entries[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": offsets}
        values += data
    header = json.dumps(entries).encode()
    path.write_bytes(len(header).to_bytes(8, "little") + header + values)


def read_safetensors(path):
    data = path.read_bytes()
    start = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:start])
    header.pop("__metadata__", None)
    return {name: torch.from_numpy(
        np.frombuffer(data[start + entry["data_offsets"][0] : start + entry["data_offsets"][1]], "<f4")
        .reshape(entry["shape"]).copy()) for name, entry in header.items()}


def write_weights(folder, weights):
    """One file of each form: torch's zip with a classifier, safetensors, torch's older form without prefix."""
    prefixed = {net: {f"features.{name}": t for name, t in weights[net].items()} for net in weights}
    files = {"alexnet": "alexnet.pth", "vgg16": "vgg16.safetensors", "squeezenet1_1": "squeezenet.pth"}
    files = {architecture: folder / file for architecture, file in files.items()}
    torch.save(prefixed["alex"] | {"classifier.6.bias": torch.zeros(1000)}, files["alexnet"])
    write_safetensors(files["vgg16"], prefixed["vgg"])
    torch.save(weights["squeeze"], files["squeezenet1_1"], _use_new_zipfile_serialization=False)
    return [option for name, file in files.items() for option in ("--weights", f"{name}={file}")]


def write_pairs(rng, folder, picture):
    pairs = {}
    for height, width in SIZES:
        target = picture(rng, height, width)
        noisy = np.clip(target + rng.normal(0, 0.1, target.shape), 0, 1)
        for kind, prediction in (("noise", noisy), ("blur", cv2.GaussianBlur(target, (0, 0), 2.0)),
                                 ("shift", np.roll(target, 3, axis=1))):
            both = [p.astype(np.float32) for p in (prediction, target)]
            pairs[f"{height}x{width}_{kind}"] = both
            for side, pixels in zip(("prediction", "target"), both):
                (folder / side).mkdir(parents=True, exist_ok=True)
                file = folder / side / f"{height}x{width}_{kind}.safetensors"
                write_safetensors(file, {"rgb": pixels})
    return pairs


def tensors(both):
    return [torch.from_numpy(p.astype(np.float64)).permute(2, 0, 1)[None] for p in both]


def add_lpips(comparison, quantity, ours, theirs):
    """Deviations are scaled so that one bound covers both the absolute and the relative one."""
    theirs = np.asarray(theirs)
    scale = np.maximum(1, LPIPS_RELATIVE / LPIPS * np.abs(theirs))
    comparison.add(quantity, "lpips", np.asarray(ours) / scale, theirs / scale, LPIPS)


def dists_terms(model, x, y):
    """What the package sums up, split by tap: our terms are its summands."""
    structure, texture = [], []
    total = model.alpha.sum() + model.beta.sum()
    alphas = torch.split(model.alpha / total, model.chns, dim=1)
    betas = torch.split(model.beta / total, model.chns, dim=1)
    features = zip(model.forward_once(x), model.forward_once(y), alphas, betas)
    for a, b, alpha, beta in features:
        mean_a, mean_b = a.mean([2, 3], keepdim=True), b.mean([2, 3], keepdim=True)
        variances = a.var([2, 3], correction=0, keepdim=True) + b.var([2, 3], correction=0, keepdim=True)
        covariance = ((a - mean_a) * (b - mean_b)).mean([2, 3], keepdim=True)
        s = (2 * mean_a * mean_b + 1e-6) / (mean_a**2 + mean_b**2 + 1e-6)
        structure.append((alpha * s).sum().item())
        texture.append((beta * (2 * covariance + 1e-6) / (variances + 1e-6)).sum().item())
    return structure + texture


def compare_pairs(comparison, run_json, binary, weights, options, rng, folder, picture):
    pairs = write_pairs(rng, folder, picture)
    keys = [f"lpips-{net}" for net in ARCHITECTURES] + ["lpips-vgg-unscaled", "dists"]
    answer = run_json([binary, "metrics", folder / "prediction", folder / "target", *options, "--metrics",
                       ",".join(keys), "--terms", "--maps", folder / "maps", "--json"])
    models = {net: lpips_of(net, weights[net]) for net in ARCHITECTURES}
    dists = dists_of(weights["vgg"])
    for pair in answer["pairs"]:
        name = Path(pair["prediction"]).stem
        kind = name.split("_")[1]
        x, y = tensors(pairs[name])
        for net in ARCHITECTURES:
            key = f"lpips[{net},v0.1]"
            value, layers = models[net](2 * x - 1, 2 * y - 1, retPerLayer=True)
            add_lpips(comparison, key, pair["scores"][key], value.item())
            add_lpips(comparison, f"{key} layers", pair["terms"][key]["layers"],
                      [layer.item() for layer in layers])
            if kind == "shift":
                ours = OpenEXR.File(pair["maps"][key]["exr"]).channels()["Y"].pixels
                models[net].spatial = True
                theirs = models[net](2 * x - 1, 2 * y - 1)[0, 0].numpy()
                models[net].spatial = False
                comparison.add(f"{key} map", "lpips", ours, theirs, MAPS)
        if kind == "blur":
            key = "lpips[vgg,v0.1,unscaled]"
            add_lpips(comparison, key, pair["scores"][key], models["vgg"](x, y).item())
        comparison.add("dists", "DISTS-pytorch", pair["scores"]["dists"], dists(x, y).item(), DISTS)
        if kind == "noise":
            terms = pair["terms"]["dists"]
            comparison.add("dists terms", "its definition, in torch", terms["structure"] + terms["texture"],
                           dists_terms(dists, x, y), DISTS)
    return dists


def compare_resized(comparison, run_json, binary, dists, options, rng, folder, picture):
    """The reduction to 256 that the reference script of DISTS offers, on 8 bits."""
    files = []
    for name, sigma in (("prediction", 1.5), ("target", 0)):
        pixels = picture(np.random.default_rng(rng.integers(2**32)), 262, 301)
        pixels = cv2.GaussianBlur(pixels, (0, 0), sigma) if sigma else pixels
        files.append(folder / f"large_{name}.png")
        cv2.imwrite(str(files[-1]), np.round(np.clip(pixels, 0, 1) * 255).astype(np.uint8))
    answer = run_json([binary, "metrics", *files, *options, "--metrics", "dists-resize256", "--json"])
    from PIL import Image
    from DISTS_pytorch.DISTS_pt import prepare_image
    x, y = [prepare_image(Image.open(f).convert("RGB"), resize=True).double() for f in files]
    ours = answer["pairs"][0]["scores"]["dists[resize256]"]
    # torchvision passes the pictures as f32, v / 255 rounded.
    comparison.add("dists[resize256]", "DISTS-pytorch", ours, dists(x, y).item(), DISTS)


def published_weights():
    """The published weights by network: two are bundled with the metrics, SqueezeNet 1.1's may be available."""
    shared = Path(os.environ.get("SHARP_BENCH_SHARED", Path(__file__).parents[2] / "../shared"))
    cache = os.environ.get("SHARP_BENCH_WEIGHTS") or Path.home() / ".cache/sharp-bench/weights"
    files = {"alex": BUNDLED / "alexnet.safetensors", "vgg": BUNDLED / "vgg16.safetensors"}
    for file in (shared / "golden/metrics/weights/squeezenet1_1_features_real.safetensors",
                 Path(cache) / "squeezenet1_1-b8a52dc0.features.safetensors"):
        if file.is_file():
            files["squeeze"] = file
    return files


def compare_published(comparison, run_json, binary, folder):
    """torchmetrics' documented example, ten pairs of noise from torch's seed 42: 0.1005 for SqueezeNet."""
    files = published_weights()
    if "squeeze" not in files:
        print("LPIPS-squeeze: the published weights are not at hand, not compared")
    torch.manual_seed(42)
    x, y = torch.rand(10, 3, 100, 100), torch.rand(10, 3, 100, 100)
    for side, batch in (("prediction", x), ("target", y)):
        (folder / side).mkdir(parents=True)
        for i, pixels in enumerate(batch):
            write_safetensors(folder / side / f"{i}.safetensors", {"rgb": pixels.permute(1, 2, 0).numpy()})
    keys = ["dists"] + [f"lpips-{net}" for net in files]
    # AlexNet's and VGG16's are what the program finds by itself.
    given = [f"--weights=squeezenet1_1={file}" for net, file in files.items() if net == "squeeze"]
    answer = run_json([binary, "metrics", folder / "prediction", folder / "target", "--metrics", ",".join(keys),
                       *given, "--json"])
    for net, file in files.items():
        stored = {name.removeprefix("features."): tensor for name, tensor in read_safetensors(file).items()}
        theirs = lpips_of(net, stored)(2 * x.double() - 1, 2 * y.double() - 1).mean().item()
        ours = answer["mean"][f"lpips[{net},v0.1]"]
        comparison.add(f"{net}, published weights", "lpips", ours, theirs, REAL)
        if net == "squeeze":
            comparison.add("squeeze, published weights", "torchmetrics' 0.1005", ours, 0.1005, PUBLISHED)
        if net == "vgg":
            theirs = dists_of(stored)(x.double(), y.double()).mean().item()
            comparison.add("dists, published weights", "DISTS-pytorch", answer["mean"]["dists"], theirs, DISTS)


def compare(comparison, run_json, binary, rng, folder, picture):
    folder.mkdir(parents=True)
    weights = {net: seeded_weights(name, rng) for net, name in ARCHITECTURES.items()}
    options = write_weights(folder, weights)
    with torch.no_grad():
        dists = compare_pairs(comparison, run_json, binary, weights, options, rng, folder, picture)
        compare_resized(comparison, run_json, binary, dists, options, rng, folder, picture)
        compare_published(comparison, run_json, binary, folder / "published")
