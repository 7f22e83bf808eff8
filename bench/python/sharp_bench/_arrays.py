"""Converts users' arrays to the contiguous arrays [H, W, C] that the core accepts."""

import sys

import numpy as np

LAYOUTS = {"hwc": -1, "chw": -3}
"""The axis of the channels, by layout."""


def array(name, value):
    """Converts a NumPy array, a tensor, or anything with DLPack or a buffer to a NumPy array, without a copy if possible."""
    if isinstance(value, np.ndarray):
        return value
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(value, torch.Tensor):
        value = value.detach()
        if value.dtype == torch.bfloat16:
            raise TypeError(f"{name}: bfloat16 has 8 bits of precision; convert it to float32 where it was computed")
        return value.cpu().numpy()
    if isinstance(value, (list, tuple, str, bytes)):
        raise TypeError(f"{name}: a {type(value).__name__}, expected an array or tensor; stack or read pictures first")
    if hasattr(value, "__dlpack__") and not hasattr(value, "__array__"):
        return np.from_dlpack(value)
    found = np.asarray(value)
    if found.dtype == object:
        raise TypeError(f"{name}: {type(value).__name__} is neither an array nor a tensor")
    return found


def pictures(name, value, layout=None):
    """A list of pictures [H, W, 3] of uint8 or float32, and whether it was a batch.

    Pictures are views of ``value`` if its memory layout allows it, else copies.
    """
    if layout not in (None, *LAYOUTS):
        raise ValueError(f"layout={layout!r}: expected one of {', '.join(LAYOUTS)}")
    found = array(name, value)
    fitting = [one for one, axis in LAYOUTS.items() if found.ndim in (3, 4) and found.shape[axis] == 3]
    layout = layout or (fitting or [None])[0]
    if layout not in fitting:
        form = {"hwc": "[H, W, 3]", "chw": "[3, H, W]"}.get(layout, "[H, W, 3] or [3, H, W]")
        hint = f"; use layout={fitting[0]!r}" if fitting else ""
        raise ValueError(f"{name}: shape {found.shape}, expected {form} or a batch of them{hint}")
    if found.dtype == np.uint8:
        dtype = np.uint8
    elif found.dtype.kind == "f":
        dtype = np.float32
    else:
        raise TypeError(f"{name}: {found.dtype}, expected uint8 or floats in 0..1")
    batch = found if found.ndim == 4 else found[None]
    batch = np.moveaxis(batch, LAYOUTS[layout], -1)
    return [np.ascontiguousarray(picture, dtype) for picture in batch], found.ndim == 4


def masks(value, count):
    """A list of ``count`` masks [H, W] of bool, from one mask for all or one for each picture."""
    found = array("mask", value)
    if found.dtype == np.uint8:
        found = found >= 128
    if found.dtype != np.bool_:
        raise TypeError(f"mask: {found.dtype}, expected bool, or uint8 (128 and more count)")
    if found.ndim == 2:
        return [np.ascontiguousarray(found)] * count
    if found.ndim == 3 and len(found) == count:
        return [np.ascontiguousarray(mask) for mask in found]
    raise ValueError(f"mask: shape {found.shape}, expected [H, W] or [{count}, H, W]")
