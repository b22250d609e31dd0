"""Measured materials from the files of the RGL (Dupuy and Jakob 2018)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from lajolla import _core

from ...data.cie import WAVELENGTHS
from ...data.spectra import integrate
from ...formats.tensors import TensorError, read_tensors
from ...schema import Field
from ...syntax.errors import SceneError
from ...syntax.files import identity
from ...syntax.nodes import Node
from ..plugin import Context, Entry, Plugin, Values

# What each tensor has one size for.
SHAPES = {
    "phi_i": "phi",
    "theta_i": "theta",
    "ndf": "y x",
    "sigma": "y x",
    "vndf": "phi theta y x",
    "luminance": "phi theta y x",
}
RGB = {"rgb": "phi theta channel y x"}
SPECTRAL = {"spectra": "phi theta channel y x", "wavelengths": "channel"}
MOST_WAVELENGTHS = 1024  # the RGL measures 195


def _measured(context: Context, node: Node, values: Values) -> Entry:
    values.pop("filename", None)
    path, location = context.find(node)
    key = ("measured", identity(path))

    def read() -> _core.Measurement:
        try:
            return _core.Measurement(**measurement(read_tensors(path)))
        except (TensorError, ValueError, MemoryError) as problem:
            reason = str(problem) or "it does not fit into memory"
            raise SceneError(f'"{path}" cannot be used as a measured material: {reason}', location) from None

    return {"type": "measured", "measurement": context.read(key, read), **values}


def measurement(tensors: dict[str, npt.NDArray[np.generic]]) -> Entry:
    """What the core's Measurement takes, from the tensors of a file; spectra become linear sRGB.

    Raises:
        TensorError: one is missing, or of an unexpected type or shape.
    """
    colours = SPECTRAL if "wavelengths" in tensors else RGB
    named = {name: _floats(tensors, name, axes) for name, axes in (SHAPES | colours).items()}
    directions = {"phi_i": len(named["phi_i"]), "theta_i": len(named["theta_i"])}
    for name in ("vndf", "luminance", next(iter(colours))):
        if named[name].shape[:2] != tuple(directions.values()):
            raise TensorError(f'"{name}" is not of as many directions as "phi_i" and "theta_i"')
    jacobian = tensors.get("jacobian")
    if jacobian is None or jacobian.dtype != np.uint8 or jacobian.shape != (1,):
        raise TensorError('"jacobian" is missing or is not one byte')
    if colours is RGB and named["rgb"].shape[2] != 3:
        raise TensorError('"rgb" does not have three channels')
    return {
        "phi": named["phi_i"],
        "theta": named["theta_i"],
        **{name: named[name] for name in ("ndf", "sigma", "vndf", "luminance")},
        "colour": _colour(named),
        "jacobian": bool(jacobian[0]),
    }


def _floats(tensors: dict[str, npt.NDArray[np.generic]], name: str, axes: str) -> npt.NDArray[np.float32]:
    if name not in tensors:
        raise TensorError(f'it has no "{name}"')
    tensor = tensors[name]
    if tensor.dtype != np.float32 or tensor.ndim != len(axes.split()):
        raise TensorError(f'"{name}" must be 32-bit numbers over {axes}')
    if not np.all(np.isfinite(tensor)):
        raise TensorError(f'"{name}" has values that are not finite')
    return np.ascontiguousarray(tensor, np.float32)


def _colour(named: dict[str, npt.NDArray[np.float32]]) -> npt.NDArray[np.float32]:
    """Linear sRGB (phi, theta, y, x, 3); what is out of gamut becomes zero in the core."""
    if "rgb" in named:
        return np.ascontiguousarray(np.moveaxis(named["rgb"], 2, -1))
    spectra, wavelengths = named["spectra"], named["wavelengths"].astype(float)
    if spectra.shape[2] != len(wavelengths):
        raise TensorError('"spectra" and "wavelengths" differ in length')
    if np.any(np.diff(wavelengths) <= 0):
        raise TensorError('"wavelengths" do not rise')
    if len(wavelengths) > MOST_WAVELENGTHS:
        raise TensorError(f"it has {len(wavelengths)} wavelengths; {MOST_WAVELENGTHS} are the most")
    # The colour is linear in the spectrum, which is constant beyond its ends.
    ends = [min(WAVELENGTHS[0], wavelengths[0]) - 1, max(WAVELENGTHS[-1], wavelengths[-1]) + 1]
    at = np.array([ends[0], *wavelengths, ends[1]])
    units = np.eye(len(wavelengths))
    weights = [integrate(at, np.pad(unit, 1, mode="edge"), d65=True) for unit in units]
    return np.tensordot(spectra, np.array(weights, np.float32), axes=(2, 0))


FILE = (Field("filename", "string", "a .bsdf file, of RGB or spectral data, as on rgl.epfl.ch/materials"),)

PLUGINS = (Plugin("bsdf", "measured", "", FILE, _measured, model="measured", hidden=("measurement",)),)
