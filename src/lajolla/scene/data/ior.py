"""Indices of refraction by name, near 589 nm and room temperature (mostly from E. Hecht, Optics)."""

from __future__ import annotations

from ..syntax.errors import Location, SceneError, did_you_mean
from ..syntax.literals import Text, parse_float

INDICES = {
    "vacuum": 1.0,
    "helium": 1.000036,
    "hydrogen": 1.000132,
    "air": 1.000277,
    "carbon dioxide": 1.00045,
    "water": 1.3330,
    "acetone": 1.36,
    "ethanol": 1.361,
    "carbon tetrachloride": 1.461,
    "glycerol": 1.4729,
    "benzene": 1.501,
    "silicone oil": 1.52045,
    "bromine": 1.661,
    "water ice": 1.31,
    "fused quartz": 1.458,
    "pyrex": 1.470,
    "acrylic glass": 1.49,
    "polypropylene": 1.49,
    "bk7": 1.5046,
    "sodium chloride": 1.544,
    "amber": 1.55,
    "pet": 1.5750,
    "diamond": 2.419,
}


def index_of_refraction(name: str, location: Location) -> float:
    """The index of a named material, or of a number in text.

    Raises:
        SceneError: neither.
    """
    known = INDICES.get(name.strip().lower())
    if known is not None:
        return known
    try:
        return parse_float(Text(name, location))
    except SceneError:
        hint = did_you_mean(name, INDICES, limit=len(INDICES))
        raise SceneError(f'no index of refraction is known for "{name}"{hint}', location) from None
