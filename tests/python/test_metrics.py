import json
from unittest import mock

import numpy as np
import pytest
from conftest import ROOT

import sharp_bench as sb
from sharp_bench import _arrays


def of_program(program, folder, prediction, target, *options):
    for name, array in (("prediction", prediction), ("target", target)):
        np.save(folder / f"{name}.npy", array)
    text = program("metrics", folder / "prediction.npy", folder / "target.npy", "--json", *options)
    return json.loads(text)["pairs"][0]["scores"]


def levels(program, folder, prediction, target, *options):
    from PIL import Image

    for name, array in (("prediction", prediction), ("target", target)):
        Image.fromarray(array).save(folder / f"{name}.png")
    text = program("metrics", folder / "prediction.png", folder / "target.png", "--json", *options)
    return json.loads(text)["pairs"][0]["scores"]


def test_numbers_are_those_of_the_command_line_to_the_last_digit(program, pictures, tmp_path):
    prediction, target = pictures
    scores = sb.metrics(prediction, target, "paper,ssim-all,lpips-vgg")
    assert scores == levels(program, tmp_path, prediction, target, "--metrics", "paper,ssim-all,lpips-vgg")
    floats = [(array / 255).astype(np.float32) for array in pictures]
    assert sb.metrics(*floats) == of_program(program, tmp_path, *floats)
    # Wider floats are rounded to float32, as in a file.
    assert sb.metrics(*(array / 255 for array in pictures)) == sb.metrics(*floats)
    # Floats are never rounded to levels.
    brighter = np.clip(floats[0] + 1e-4, 0, 1)
    assert sb.metrics(brighter, floats[1], "psnr") != sb.metrics(floats[0], floats[1], "psnr")


def test_layouts_batches_and_views_of_memory_give_the_same_numbers(pictures):
    prediction, target = pictures
    scores = sb.metrics(prediction, target)
    planes = [np.ascontiguousarray(np.moveaxis(array, -1, 0)) for array in pictures]
    assert sb.metrics(*planes) == sb.metrics(*planes, layout="chw") == sb.metrics(planes[0], target) == scores
    wide = np.zeros((61, 200, 3), np.uint8)
    wide[:, 10:93] = prediction
    assert sb.metrics(wide[:, 10:93], target) == scores
    assert sb.metrics(prediction[::-1, ::-1], target[::-1, ::-1], "psnr")["psnr"] == pytest.approx(scores["psnr"], rel=1e-12)
    batch = sb.metrics(np.stack([target, prediction]), np.stack([target, target]))
    assert np.isinf(batch["psnr"][0]) and {key: value[1] for key, value in batch.items()} == scores
    assert sb.metrics(np.stack([prediction] * 3), target, "psnr")["psnr"].tolist() == [scores["psnr"]] * 3


def test_channels_are_the_last_axis_where_two_could_be():
    narrow = np.zeros((3, 5, 3), np.uint8)
    for layout, shape in ((None, (3, 5, 3)), ("hwc", (3, 5, 3)), ("chw", (5, 3, 3))):
        (picture,), is_batch = _arrays.pictures("narrow", narrow, layout)
        assert picture.shape == shape and not is_batch
    with pytest.raises(ValueError, match=r"expected \[3, H, W\].*use layout='hwc'"):
        _arrays.pictures("wide", np.zeros((4, 5, 3), np.uint8), "chw")


def test_contiguous_pictures_are_read_in_place():
    torch = pytest.importorskip("torch")

    class Exporter:
        def __init__(self, array):
            self.__dlpack__, self.__dlpack_device__ = array.__dlpack__, array.__dlpack_device__

    for dtype in (np.uint8, np.float32):
        batch = np.zeros((2, 8, 9, 3), dtype)
        last = torch.zeros((2, 3, 8, 9), dtype=torch.from_numpy(batch).dtype).to(memory_format=torch.channels_last)
        leaf = torch.from_numpy(batch)
        for given, memory in [
            (batch, batch),
            (batch[1], batch),
            (leaf.clone().requires_grad_(dtype == np.float32), None),
            (leaf, batch),
            (last, last.numpy()),
            (memoryview(batch), batch),
            (Exporter(batch), batch),
        ]:
            memory = given.detach().numpy() if memory is None else memory
            found, _ = _arrays.pictures("given", given)
            assert all(np.shares_memory(picture, memory) for picture in found), type(given)
        for copied in (np.moveaxis(batch, -1, 1).copy(), batch[:, :, ::2], batch.astype(np.float64)):
            found, _ = _arrays.pictures("copied", copied)
            assert not any(np.shares_memory(picture, copied) for picture in found)


@pytest.mark.parametrize("net, architecture", [("alex", "alexnet"), ("vgg", "vgg16")])
def test_lpips_is_that_of_its_package(net, architecture, pictures):
    lpips, torchvision, torch = (pytest.importorskip(name) for name in ("lpips", "torchvision", "torch"))
    from safetensors.torch import load_file

    # torchvision's network with the published features, in place of its download.
    with torch.device("meta"):
        features = getattr(torchvision.models, architecture)(weights=None).features
    stored = load_file(ROOT / f"metrics/weights/{architecture}.safetensors")
    features = features.to_empty(device="cpu")
    features.load_state_dict({name.removeprefix("features."): value.float() for name, value in stored.items()})
    with mock.patch.object(torchvision.models, architecture, return_value=mock.Mock(features=features)):
        package = lpips.LPIPS(net=net, pnet_rand=True, verbose=False).double()
    tensors = [torch.from_numpy(array.transpose(2, 0, 1)[None] / 255.0) for array in pictures]
    theirs = package(*tensors, normalize=True).item()
    # The bound of the cross-check for published weights.
    assert sb.metrics(*pictures, f"lpips-{net}")[f"lpips[{net},v0.1]"] == pytest.approx(theirs, abs=2e-6)


def test_masks_add_the_scores_inside(pictures, program, tmp_path):
    from PIL import Image

    prediction, target = pictures
    mask = np.zeros(target.shape[:2], bool)
    mask[10:50, 5:60] = True
    Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(tmp_path / "mask.png")
    scores = sb.metrics(prediction, target, "psnr,ssim", mask=mask)
    assert scores == levels(program, tmp_path, prediction, target, "--metrics", "psnr,ssim", "--mask", tmp_path / "mask.png")
    assert set(scores) == {"psnr", "psnr@mask", "ssim[gauss11,valid]", "ssim[gauss11,valid]@mask"}
    inside = ((prediction[mask] / 255.0 - target[mask] / 255.0) ** 2).mean()
    assert scores["psnr@mask"] == pytest.approx(-10 * np.log10(inside), abs=1e-9)
    assert sb.metrics(prediction, target, "psnr", mask=np.where(mask, 255, 0).astype(np.uint8))["psnr@mask"] == scores["psnr@mask"]


def test_others_agree(pictures):
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity

    prediction, target = pictures
    scores = sb.metrics(prediction, target, "psnr,ssim")
    assert scores["psnr"] == pytest.approx(peak_signal_noise_ratio(target, prediction), abs=1e-12)
    options = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False, "data_range": 255, "channel_axis": -1}
    assert scores["ssim[gauss11,valid]"] == pytest.approx(structural_similarity(target, prediction, **options), abs=1e-12)


def test_tensors(pictures):
    torch = pytest.importorskip("torch")
    prediction, target = (torch.from_numpy(array) for array in pictures)
    scores = sb.metrics(*pictures)
    assert sb.metrics(prediction, target) == scores
    for batch in (lambda tensor: tensor[None], lambda tensor: tensor.permute(2, 0, 1)[None].contiguous()):
        assert {key: value[0] for key, value in sb.metrics(batch(prediction), batch(target)).items()} == scores
    floats = [(tensor / 255).requires_grad_() for tensor in (prediction, target)]
    assert sb.metrics(*floats, "psnr")["psnr"] == pytest.approx(scores["psnr"], abs=1e-6)
    with pytest.raises(TypeError, match="bfloat16"):
        sb.metrics((prediction / 255).bfloat16(), target)


@pytest.mark.parametrize(
    ("change", "error", "said"),
    [
        (lambda a: a[..., 0], ValueError, r"shape \(61, 83\), expected \[H, W, 3\]"),
        (lambda a: a[..., :2], ValueError, r"expected \[H, W, 3\] or \[3, H, W\] or a batch"),
        (lambda a: a.astype(np.int32), TypeError, "int32, expected uint8 or floats"),
        (lambda a: a.astype(np.float32), ValueError, r"prediction.*must lie in 0\.\.1"),
        (lambda a: a / 255 * np.nan, ValueError, "finite"),
        (lambda a: a[:50], ValueError, "83x50"),
        (lambda a: a[:0], ValueError, "no pixel"),
        (lambda a: a[None][:0], ValueError, "the batch has no pictures"),
        (lambda a: a.tolist(), TypeError, "a list"),
        (lambda a: "prediction.png", TypeError, "a str"),
        (lambda a: object(), TypeError, "neither an array nor a tensor"),
    ],
)
def test_what_cannot_be_scored_is_refused_with_what_was_expected(pictures, change, error, said):
    prediction, target = pictures
    with pytest.raises(error, match=said):
        sb.metrics(change(prediction), target)


def test_metrics_that_cannot_be_computed(pictures, tmp_path):
    prediction, target = pictures
    with pytest.raises(ValueError, match="unknown metric 'sim'"):
        sb.metrics(prediction, target, "sim")
    small = prediction[:8, :8], target[:8, :8]
    with pytest.raises(sb.Error, match="ssim.*at least"):
        sb.metrics(*small, "ssim")
    with pytest.warns(UserWarning, match="ssim.* is left out"):
        assert "psnr" in sb.metrics(*small, "all")
    with pytest.raises(sb.Error, match="nowhere.pth"):
        sb.metrics(prediction, target, "lpips", weights={"alexnet": tmp_path / "nowhere.pth"})


def test_conventions_are_those_of_the_command_line(program):
    explained = json.loads(program("metrics", "--explain", "--json", "--metrics", "all"))
    assert sb.conventions() == explained


def test_the_lock_is_released():
    import threading

    noise = np.random.default_rng(1).random((400, 600, 3)).astype(np.float32)
    counted = [0]
    done = threading.Event()

    def count():
        while not done.wait(0.002):
            counted[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    sb.metrics(noise, noise[::-1].copy(), "dists")
    done.set()
    thread.join()
    assert counted[0] > 5
