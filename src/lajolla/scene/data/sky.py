"""Daylight: position and radiance of the sun, and radiance of the sky.

The sky is that of Hosek and Wilkie 2012. The sun is that of Hosek and Wilkie 2013, or of Preetham, Shirley
and Smits 1999 ("A Practical Analytic Model for Daylight", appendix A.1). Radiances are in W m^-2 sr^-1 nm^-1,
weighted by the observer, as colours: linear sRGB.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..syntax.nodes import Array
from .spectra import Y_INTEGRAL, integrate

SUN_DIAMETER = 0.5358  # degrees
EARTH_RADIUS_PER_ORBIT = 6371.01 / 149597890


@dataclass(frozen=True)
class Moment:
    """A time and a place on Earth: degrees, and the hours by which the clock is ahead of universal time."""

    year: int = 2010
    month: int = 7
    day: int = 10
    hour: float = 15.0
    minute: float = 0.0
    second: float = 0.0
    latitude: float = 35.6894
    longitude: float = 139.6917
    timezone: float = 9.0


@functools.cache
def coefficients() -> dict[str, Array]:
    """The tables of Hosek and Wilkie; see data/README.md."""
    with np.load(Path(__file__).parent / "hosek_wilkie.npz") as file:
        return {name: file[name].astype(np.float64) for name in file.files}


# Place of the sun


def sun_angles(moment: Moment) -> tuple[float, float]:
    """Zenith angle of the sun, and its azimuth counted from north to east, in radians.

    Blanco-Muriel et al. 2001, "Computing the Solar Vector".
    """
    hours = moment.hour - moment.timezone + (moment.minute + moment.second / 60) / 60
    days = _julian_day_number(moment.year, moment.month, moment.day) - 0.5 + hours / 24 - 2451545.0
    omega = 2.1429 - 0.0010394594 * days
    mean_longitude = 4.8950630 + 0.017202791698 * days
    anomaly = 6.2400600 + 0.0172019699 * days
    longitude = (
        mean_longitude
        + 0.03341607 * math.sin(anomaly)
        + 0.00034894 * math.sin(2 * anomaly)
        - 0.0001134
        - 0.0000203 * math.sin(omega)
    )
    obliquity = 0.4090928 - 6.2140e-9 * days + 0.0000396 * math.cos(omega)
    ascension = math.atan2(math.cos(obliquity) * math.sin(longitude), math.cos(longitude))
    declination = math.asin(math.sin(obliquity) * math.sin(longitude))
    sidereal = math.radians((6.6974243242 + 0.0657098283 * days + hours) * 15 + moment.longitude)
    hour_angle, latitude = sidereal - ascension, math.radians(moment.latitude)
    cosine = math.cos(latitude) * math.cos(hour_angle) * math.cos(declination)
    zenith = math.acos(max(-1.0, min(1.0, cosine + math.sin(declination) * math.sin(latitude))))
    azimuth = math.atan2(
        -math.sin(hour_angle),
        math.tan(declination) * math.cos(latitude) - math.sin(latitude) * math.cos(hour_angle),
    )
    return zenith + EARTH_RADIUS_PER_ORBIT * math.sin(zenith), azimuth


def _julian_day_number(year: int, month: int, day: int) -> int:
    """Of noon on a day of the Gregorian calendar (Fliegel and Van Flandern 1968; C's division)."""
    carry = int((month - 14) / 12)
    return (
        1461 * (year + 4800 + carry) // 4
        + 367 * (month - 2 - 12 * carry) // 12
        - 3 * ((year + 4900 + carry) // 100) // 4
        + day
        - 32075
    )


# Sky

BLOCK = 1 << 18  # pixels that are computed at a time


def sky_map(
    sun: Array, turbidity: float, albedo: Array, width: int, *, stretch: float = 1, extend: bool = False
) -> tuple[npt.NDArray[np.float32], float]:
    """The sky as an environment map whose +y is up.

    Args:
        sun: (3,) unit vector to the sun.
        turbidity: 1 ... 10.
        albedo: (3,) of the ground.
        width: pixels around the horizon.
        stretch: factor on the angle from the zenith, 1 ... 2: the sky ends at 90 degrees times this.
        extend: extend the sky below the horizon, darker towards the nadir.

    Returns:
        (map_height(width), width, 3) float32, and the angle in degrees from the zenith to its last row.
    """
    height = map_height(width)
    result = np.empty((height, width, 3), np.float32)
    end = np.pi if extend else np.pi / 2 * stretch
    rows = max(1, BLOCK // width)
    for first in range(0, height, rows):
        theta = end * np.arange(first, min(first + rows, height))[:, None] / (height - 1)
        block = _sky_rows(theta, sun, turbidity, albedo, width, stretch=stretch, extend=extend)
        result[first : first + rows] = block
    return result, math.degrees(end)


def map_height(width: int) -> int:
    return width // 4 * 2 + 1


def _sky_rows(
    theta: Array, sun: Array, turbidity: float, albedo: Array, width: int, *, stretch: float, extend: bool
) -> Array:
    """The rows of a sky map at angles (n, 1) from the zenith."""
    phi = 2 * np.pi * (np.arange(width)[None, :] + 0.5) / width
    zenith_angle = np.minimum(theta / stretch, np.pi / 2)
    sin = np.sin(zenith_angle)
    cos_gamma = np.stack([np.sin(phi) * sin, np.cos(zenith_angle) + 0 * phi, -np.cos(phi) * sin], -1) @ sun
    radiance = sky_radiance(np.cos(zenith_angle) + 0 * phi, cos_gamma, float(sun[1]), turbidity, albedo)
    if extend:
        t = np.clip(2 - 2 * theta / np.pi, 0, 1)
        radiance *= (t * t * (3 - 2 * t))[..., None]
    return radiance


def sky_radiance(
    cos_theta: Array, cos_gamma: Array, sin_elevation: float, turbidity: float, albedo: Array
) -> Array:
    """Radiance (..., 3) at angles theta from the zenith and gamma from the sun: equation 8 of the paper."""
    table = coefficients()
    elevation = math.asin(max(0.0, min(1.0, sin_elevation)))
    shape = _at_control_points(_at_turbidity(table["sky_shape"], turbidity), elevation, albedo)
    a, b, c, d, e, f, g, i, h = shape.T
    scale = _at_control_points(_at_turbidity(table["sky_radiance"], turbidity), elevation, albedo)
    cos_theta, cos_gamma = np.clip(cos_theta, 0, 1)[..., None], np.clip(cos_gamma, -1, 1)[..., None]
    gamma = np.arccos(cos_gamma)
    anisotropy = (1 + cos_gamma**2) / (1 + h**2 - 2 * h * cos_gamma) ** 1.5
    radiance = (1 + a * np.exp(b / (cos_theta + 0.01))) * (
        c + d * np.exp(e * gamma) + f * cos_gamma**2 + g * anisotropy + i * np.sqrt(cos_theta)
    )
    return np.maximum(radiance * scale, 0) / Y_INTEGRAL


def _at_turbidity(table: Array, turbidity: float) -> Array:
    low = min(int(turbidity), 9) - 1
    return table[low] + (table[low + 1] - table[low]) * (turbidity - 1 - low)


def _at_control_points(table: Array, elevation: float, albedo: Array) -> Array:
    """(albedo 2, 6, channel 3, ...) to (3, ...): linear in the albedo, a Bezier curve over the elevation."""
    x = (2 * elevation / math.pi) ** (1 / 3)
    weights = [math.comb(5, k) * x**k * (1 - x) ** (5 - k) for k in range(6)]
    dark, light = np.tensordot(weights, table, axes=(0, 1))
    share = np.reshape(albedo, (3, *(1,) * (dark.ndim - 1)))
    return dark + (light - dark) * share


# Sun


def hosek_sun(elevation: float, turbidity: float) -> Array:
    """Mean radiance (3,) of the sun's disk: piecewise cubic in the elevation."""
    table = _at_turbidity(coefficients()["sun_radiance"], turbidity)
    segments = len(table)
    segment = min(int((2 * elevation / math.pi) ** (1 / 3) * segments), segments - 1)
    x = elevation - math.pi / 2 * (segment / segments) ** 3
    return np.maximum(table[segment] @ x ** np.arange(4), 0) / Y_INTEGRAL


def preetham_sun(elevation: float, turbidity: float) -> Array:
    """Radiance (3,) of the sun through clear air, ozone, water vapour, mixed gases and dust."""
    wavelengths = np.arange(350.0, 801.0, 5.0)
    micrometers = wavelengths / 1000
    degrees = math.degrees(elevation)
    mass = 1 / (math.sin(elevation) + 0.15 * (3.885 + degrees) ** -1.253)  # relative optical mass
    dust = 0.04608365822050 * turbidity - 0.04586025928522
    ozone, gas, water = (
        np.interp(wavelengths, [at for at, _ in table], [value for _, value in table], left=0, right=0)
        for table in (OZONE, MIXED_GASES, WATER_VAPOUR)
    )
    optical_depth = (
        0.008735 * micrometers**-4.08 * mass
        + dust * micrometers**-1.3 * mass
        + 0.35 * ozone * mass
        + 1.41 * gas * mass / (1 + 118.93 * gas * mass) ** 0.45
        + 0.2385 * 2 * water * mass / (1 + 20.07 * 2 * water * mass) ** 0.45
    )
    outside = np.interp(wavelengths, np.arange(380.0, 751.0, 10.0), SOLAR_RADIANCE, left=0, right=0)
    return np.maximum(integrate(wavelengths, outside * np.exp(-optical_depth), d65=False), 0)


def _pairs(text: str) -> list[tuple[float, float]]:
    numbers = [float(word) for word in text.split()]
    return list(zip(numbers[::2], numbers[1::2], strict=True))


# Absorption coefficients over wavelengths in nm, and the radiance of the sun outside of the atmosphere in
# W m^-2 sr^-1 nm^-1 from 380 to 750 nm: Preetham et al. 1999, table 2.
OZONE = _pairs("""
    300 10 305 4.8 310 2.7 315 1.35 320 .8 325 .38 330 .16 335 .075 340 .04 345 .019 350 .007 355 0
    445 .003 450 .003 455 .004 460 .006 465 .008 470 .009 475 .012 480 .014 485 .017 490 .021 495 .025
    500 .03 505 .035 510 .04 515 .045 520 .048 525 .057 530 .063 535 .07 540 .075 545 .08 550 .085
    555 .095 560 .103 565 .11 570 .12 575 .122 580 .12 585 .118 590 .115 595 .12 600 .125 605 .13
    610 .12 620 .105 630 .09 640 .079 650 .067 660 .057 670 .048 680 .036 690 .028 700 .023 710 .018
    720 .014 730 .011 740 .01 750 .009 760 .007 770 .004 780 0 790 0
""")
MIXED_GASES = _pairs("759 0 760 3 770 .21 771 0")
WATER_VAPOUR = _pairs("""
    689 0 690 .016 700 .024 710 .0125 720 1 730 .87 740 .061 750 .001 760 1e-5 770 1e-5 780 .0006
    790 .0175 800 .036
""")
SOLAR_RADIANCE = [
    float(word)
    for word in """
    16559 16233.7 21127.5 25888.2 25829.1 24232.3 26760.5 29658.3 30545.4 30057.5 30663.7 28830.4 28712.1
    27825 27100.6 27233.6 26361.3 25503.8 25060.2 25311.6 25355.9 25134.2 24631.5 24173.2 23685.3 23212.1
    22827.7 22339.8 21970.2 21526.7 21097.9 20728.3 20240.4 19870.8 19427.2 19072.4 18628.9 18259.2
    """.split()
]
