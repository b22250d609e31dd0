"""Every simple shape with every parameter, placed in all ways, against Mitsuba."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_tools import read
from statistics_tools import generator

from lajolla import _core, _core_testing

TURN = '<rotate x="1" angle="40"/><rotate y="1" angle="30"/>'
PLACES = {
    "none": "",
    "even": f'{TURN}<scale value="1.7"/><translate x="1" y="2"/>',
    "mirrored": f'<scale x="-1"/>{TURN}<translate x="1"/>',
    "uneven": f'<scale x="2" y="0.5" z="1.3"/>{TURN}',
    "long": f'<scale x="0.5" y="0.5" z="-2"/>{TURN}<translate y="1"/>',
}
ENDS = """<point name="p0" x="0.3" y="-0.2" z="0.1"/><point name="p1" x="-0.5" y="0.4" z="1.1"/>
<float name="radius" value="0.6"/>"""
CENTER = '<point name="center" x="0.3" y="-0.2" z="0.1"/><float name="radius" value="0.6"/>'
SHAPES = {
    "cube": ("cube", ""),
    "rectangle": ("rectangle", ""),
    "disk": ("disk", ""),
    "sphere": ("sphere", ""),
    "placed sphere": ("sphere", CENTER),
    "cylinder": ("cylinder", ""),
    "placed cylinder": ("cylinder", ENDS),
}
# Mitsuba has no ellipsoids of its own: it takes the scale along x for all of them.
CASES = [(s, p) for s in SHAPES for p in PLACES if not (SHAPES[s][0] == "sphere" and p in ("uneven", "long"))]


@pytest.mark.parametrize("flip", ["false", "true"])
@pytest.mark.parametrize(("name", "place"), CASES)
def test_hits_agree_with_mitsuba(name: str, place: str, flip: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    plugin, parameters = SHAPES[name]
    body = f"""<shape type="{plugin}">{parameters}<boolean name="flip_normals" value="{flip}"/>
      <transform name="to_world">{PLACES[place]}</transform></shape>"""
    scene = mi.load_string(f'<scene version="3.0.0"><integrator type="path"/>{body}</scene>')
    rng = generator("placements", name, place)
    box, around = scene.bbox(), rng.normal(size=(200, 3))
    targets = np.array(box.center()) + rng.uniform(-0.4, 0.4, (200, 3)) * np.array(box.extents())
    origins = (targets + 8 * around / np.linalg.norm(around, axis=1, keepdims=True)).astype(np.float32)
    directions = targets - origins
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    hits = _core_testing.hit_many(_core.Scene(read(tmp_path, body).core), origins, directions)
    theirs = [
        scene.ray_intersect(mi.Ray3f(mi.Point3f(*map(float, o)), mi.Vector3f(*map(float, d))))
        for o, d in zip(origins, directions, strict=True)
    ]
    valid = np.array([si.is_valid() for si in theirs])
    assert (valid == hits["valid"]).mean() > 0.985
    both = valid & hits["valid"]
    assert both.sum() > 20
    tessellated = plugin == "cylinder" and (place, name) in (("uneven", name), ("long", "placed cylinder"))
    for key, values in (
        ("position", [si.p for si in theirs]),
        ("shading_normal", [si.sh_frame.n for si in theirs]),
        ("uv", [si.uv for si in theirs]),
        ("dp_du", [si.dp_du for si in theirs]),
        ("dp_dv", [si.dp_dv for si in theirs]),
    ):
        error = np.abs(np.array([np.array(v) for v in values]) - hits[key])[both]
        error = np.minimum(error, np.abs(1 - error)) if key == "uv" else error
        scale = max(np.abs(hits[key][both]).max(), 1)
        assert np.quantile(error, 0.95) < (0.02 if tessellated else 2e-4) * scale, key
