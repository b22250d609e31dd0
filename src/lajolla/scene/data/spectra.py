"""Spectra to linear sRGB, as Mitsuba 3.9 does it in its `rgb` variants.

A reflectance is seen under illuminant D65, an emission by itself. Either way one number stays that number in
all three channels. Indices of refraction that come as a list of wavelengths are treated as reflectances
without an upper bound.
"""

from __future__ import annotations

import numpy as np

from lajolla.colour import xyz_to_rgb

from ..syntax.errors import Diagnostics, Location
from ..syntax.nodes import Array, Blackbody, Rgb, Spectrum
from .cie import ILLUMINANT_D65, OBSERVER_1931, WAVELENGTHS

Y_INTEGRAL = 106.7502593994140625  # of the observer's y over the steps below
D65_NORMALIZATION = 98.99741751876255  # makes illuminant D65 a luminance of one
STEPS = 1000  # of the sum over wavelengths; the same as Mitsuba's, because its numbers are the goal

# Planck's law: 2 h c^2 and h c / k (CODATA 2014).
FIRST_RADIATION = 2 * 6.62607004e-34 * 2.99792458e8**2
SECOND_RADIATION = 6.62607004e-34 * 2.99792458e8 / 1.38064852e-23


def integrate(wavelengths: Array, values: Array, *, d65: bool) -> Array:
    """The linear sRGB colour, perhaps out of gamut, of a spectrum: linear between samples, zero outside.

    Args:
        wavelengths: (N,) in nm, rising.
        values: (N,).
        d65: weight by illuminant D65, as for reflectances.

    Returns:
        (3,) red, green, blue.
    """
    at = np.linspace(WAVELENGTHS[0], WAVELENGTHS[-1], STEPS)
    spectrum = np.interp(at, wavelengths, values, left=0.0, right=0.0)
    if d65:
        spectrum = spectrum * np.interp(at, WAVELENGTHS, ILLUMINANT_D65) / D65_NORMALIZATION
    observer = np.stack([np.interp(at, WAVELENGTHS, column) for column in OBSERVER_1931.T])
    xyz = observer @ spectrum * (WAVELENGTHS[-1] - WAVELENGTHS[0]) / (Y_INTEGRAL * STEPS)
    return xyz_to_rgb(xyz)


def blackbody(emitted: Blackbody) -> Array:
    """The colour of a black body, in W m^-2 sr^-1 nm^-1 weighted by the observer; (3,)."""
    meters = WAVELENGTHS * 1e-9
    with np.errstate(over="ignore"):
        planck = (
            1e-9 * FIRST_RADIATION / (meters**5 * np.expm1(SECOND_RADIATION / (meters * emitted.temperature)))
        )
    return np.maximum(integrate(WAVELENGTHS, planck * emitted.scale, d65=False), 0.0)


def to_rgb(
    value: Rgb | Spectrum | Blackbody, *, emission: bool, diagnostics: Diagnostics, location: Location
) -> tuple[float, float, float]:
    """Linear sRGB of any colour; negative values become zero, with a warning."""
    rgb: tuple[float, ...]
    if isinstance(value, Rgb):
        rgb = value.values
    elif isinstance(value, Blackbody):
        rgb = tuple(blackbody(value).tolist())
    elif not value.wavelengths:
        rgb = (value.values[0],) * 3
    else:
        spectrum = integrate(np.array(value.wavelengths), np.array(value.values), d65=not emission)
        rgb = tuple(spectrum.tolist())
    if min(rgb) < 0:
        shown = ", ".join(f"{v:.4g}" for v in rgb)
        diagnostics.warn(f"the colour ({shown}) has a negative part, which becomes zero", location)
    red, green, blue = (0.0 if v <= 0 else float(v) for v in rgb)  # what is no number stays
    return (red, green, blue)
