"""Denoising with Intel Open Image Denoise, which the package `pyoidn` contains.

Its filter "RT" is a neural network for Monte Carlo noise. It is given the picture, and the albedo and the
normals that core/transport/features.h renders; docs/denoising.md says how well this works.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from lajolla.colour import FloatImage, luminance
from lajolla.limits import OptionError
from lajolla.messages import installing
from lajolla.picture_files import ImageError

FEATURE_SAMPLES = 16  # per pixel; what is left of their noise is filtered
LAYERS = {"albedo": ("albedo.R", "albedo.G", "albedo.B"), "normal": ("normal.x", "normal.y", "normal.z")}
NOISY = ("noisy.R", "noisy.G", "noisy.B")  # the picture before denoising
HELD_OUT = "holdout.C"  # 1 where the centre of a pixel shows a holdout, else 0
MARGIN = 16  # pixels; with mirrored ones around it, the network errs less at the picture's border
ALIGNMENT = 16  # the network halves the resolution four times
LARGEST = float(np.finfo(np.float32).max)
MAX_MEMORY = 3072  # MiB that Open Image Denoise may use; it denoises larger pictures in tiles


class DenoiseError(ImageError):
    """A picture that cannot be denoised; the message states the reason."""


def check_available() -> None:
    """Raises DenoiseError if Open Image Denoise cannot be used here."""
    with _device(1):
        pass


def features_output(integrator: Mapping[str, Any]) -> dict[str, Any]:
    """The output that shows the features of a picture, in the form that `_core.Scene.with_output` takes.

    Args:
        integrator: of the picture, as in a description. Raises OptionError where it shows no light.
    """
    if integrator["type"] in ("field", "features"):
        raise OptionError(
            f"the integrator {integrator['type']!r} shows no light, so there is no noise to remove"
        )
    hidden = {"hide_emitters": integrator.get("hide_emitters", False)}
    shared = {"type": "features", "media": integrator["type"] == "volpath", **hidden}
    return {
        "integrator": {**shared, "feature": "albedo"},
        "other_integrators": [{**shared, "feature": "normal"}],
        "channels": [
            {"label": label, "source": 1, "component": i} for i, label in enumerate(LAYERS["normal"])
        ],
    }


def feature_channels(features: Mapping[str, Any]) -> dict[str, Any]:
    """Features as channels; "albedo" and "normal" are arrays (height, width, 3). Raises ImageError."""
    result: dict[str, Any] = {}
    for name, values in features.items():
        if name in LAYERS:
            if np.ndim(values) != 3 or np.shape(values)[2] != 3:
                raise ImageError(f"feature {name!r} has shape {np.shape(values)}, not (height, width, 3)")
            result |= dict(zip(LAYERS[name], np.moveaxis(np.asarray(values), 2, 0), strict=True))
        elif "." in str(name) or name == "A":  # a channel of a picture
            result[name] = values
        else:
            known = [*LAYERS, *(channel for channels in LAYERS.values() for channel in channels)]
            raise ImageError(f"unknown feature {name!r}; valid: {', '.join(known)}")
    if "normal" in features and not result.keys() >= set(LAYERS["albedo"]):
        raise ImageError(f"the network needs {', '.join(LAYERS['albedo'])} beside normals")
    return result


def denoised(
    colour: FloatImage, layers: Mapping[str, FloatImage], *, threads: int | None = None
) -> FloatImage:
    """A picture (height, width, 3) without noise; values below 0, and those that are not finite, become 0.

    Args:
        colour: linear RGB.
        layers: channels by name; albedo, and normals beside it, are used if all of LAYERS are there. Where
            HELD_OUT is not 0, black pixels stay black.
        threads: how many to use, with the same result; default: all.

    Raises:
        DenoiseError: Open Image Denoise is not there, or failed.
    """
    try:
        return _denoised(colour, layers, threads)
    except DenoiseError:
        raise
    except Exception as problem:  # whatever it is: nobody should lose a picture by it
        reason = "not enough memory" if isinstance(problem, MemoryError) else str(problem)
        raise DenoiseError(f"Open Image Denoise failed: {reason or type(problem).__name__}") from problem


def _denoised(colour: FloatImage, layers: Mapping[str, FloatImage], threads: int | None) -> FloatImage:
    features = {}
    layers = {name.lower(): values for name, values in layers.items()}  # others write normal.X
    for name, channels in LAYERS.items():  # the network knows no normals without albedo
        if not all(channel.lower() in layers for channel in channels):
            break
        features[name] = np.dstack([layers[channel.lower()] for channel in channels])
    limits = {"albedo": (0.0, 1.0), "normal": (-1.0, 1.0)}
    height, width = colour.shape[:2]
    with _device(threads) as device:
        clean = {
            name: _filtered(device, {name: _prepared(values, *limits[name])})
            for name, values in features.items()
        }
        radiance = _prepared(colour, 0.0, LARGEST)
        scale = _power_of_two_near_mean(radiance)
        result = _filtered(device, {"color": radiance / scale, **clean}, hdr=True, cleanAux=bool(clean))
    with np.errstate(over="ignore"):
        result = np.minimum(result[MARGIN:, MARGIN:][:height, :width] * scale, LARGEST)
    if (held_out := layers.get(HELD_OUT.lower())) is not None:
        result[(held_out != 0) & (colour == 0).all(axis=2)] = 0
    return result


def _prepared(values: FloatImage, low: float, high: float) -> FloatImage:
    """The values that the network can take, with a margin of mirrored pixels."""
    finite = np.where(np.isfinite(values).all(axis=2, keepdims=True), values, 0)
    ends = [(MARGIN, MARGIN + -(size + 2 * MARGIN) % ALIGNMENT) for size in values.shape[:2]]
    padded = np.pad(np.clip(finite, low, high), (*ends, (0, 0)), mode="symmetric")
    return np.ascontiguousarray(padded, np.float32)


def _power_of_two_near_mean(radiance: FloatImage) -> np.float32:
    """A scale that changes no digits: Open Image Denoise takes values around 1e-8 and below for black."""
    mean = float(np.mean(luminance(radiance), dtype=np.float64))
    return np.float32(2.0 ** np.clip(np.round(np.log2(mean)), -100, 100)) if mean > 0 else np.float32(1)


def _filtered(device: Any, images: Mapping[str, FloatImage], **settings: bool) -> FloatImage:  # noqa: ANN401
    """What the network makes of images (height, width, 3) by their names."""
    import pyoidn

    result = np.empty_like(next(iter(images.values())))
    with pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT) as network:
        for name, image in (*images.items(), (pyoidn.OIDN_IMAGE_OUTPUT, result)):
            network.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        for setting, value in settings.items():
            network.set_bool(setting, value)
        network.set_int("maxMemoryMB", MAX_MEMORY)
        network.commit()
        network.execute()
        _check(device)
    return result


@contextmanager
def _device(threads: int | None) -> Iterator[Any]:
    """Open Image Denoise on the processor. Raises DenoiseError."""
    try:
        import pyoidn
    except ImportError:
        raise DenoiseError(
            f"denoising needs Open Image Denoise, which is not installed: {installing('pyoidn')}"
        ) from None
    try:
        device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
    except OSError as problem:  # its library cannot be loaded
        raise DenoiseError(f"Open Image Denoise cannot be loaded: {problem}") from None
    with device:
        device.set_int("numThreads", threads or 0)
        device.set_bool("setAffinity", False)  # threads stay where the process may run
        device.commit()
        _check(device)
        yield device


def _check(device: Any) -> None:  # noqa: ANN401
    """Raises DenoiseError if the last calls failed."""
    problem = device.get_error()
    if problem is not None:
        raise DenoiseError(f"Open Image Denoise failed: {problem}")
