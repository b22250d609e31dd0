"""Layers in Blender: its compositor shows them by type, and extracts mattes by the names of objects.

The expected matte of an object is a picture in which this object alone shines, with radiance 1 and the same
samples. Blender's module has its own demands on Python and NumPy; docs/testing.md says how to install it.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tools import area, look_at, rotation, scaling, translation

import lajolla
from lajolla.aovs import AOVS

SIZE = (48, 32)
BALL, CARD, MOON = "ball", 'Wänd "ñ" (links)', "月.001"
SHELLAC = "Schellack: rot.002"
LACQUERED = {"type": "ref", "id": SHELLAC}
INSTANCE = {"near twin.001": (-0.4, 0.9, -0.4), "far twin": (1.2, 0.5, 0.6)}
SHAPES: dict[str, dict[str, Any]] = {
    "floor": {"type": "rectangle", "to_world": rotation((1, 0, 0), -90) @ scaling(3, 3, 1)},
    BALL: {"type": "sphere", "center": [-1, 0.6, 0], "radius": 0.6, "bsdf": LACQUERED},
    MOON: {"type": "sphere", "center": [0.4, 0.4, -1.5], "radius": 0.4, "bsdf": LACQUERED},
    CARD: {"type": "rectangle", "to_world": translation(0.3, 0.7, 1) @ scaling(0.9, 0.7, -1)},
}
TWIN = {"type": "sphere", "radius": 0.3}
CRYPTOMATTES = ["crypto_instance", "crypto_material", "crypto_shape"]
SOCKETS = {
    "RGBA": ["Combined", "albedo", "variance", "lightgroup_sky", "lightgroup_rest"]
    + [f"{name}0{rank}" for name in CRYPTOMATTES for rank in range(3)],
    "VECTOR": "normal geo_normal position rel_position uv dp_du dp_dv duv_dx duv_dy".split(),
    "VALUE": "Alpha depth mean_curvature samples shape material instance primitive".split(),
}


@dataclass(frozen=True)
class Blender:
    """What Blender's compositor reads from one picture; see blender_mattes.py."""

    layers: dict[str, str]
    cryptomattes: list[str]
    picked: list[str]
    mattes: list[np.ndarray]


@pytest.fixture(scope="module")
def blender_python() -> str:
    """A Python with Blender's module."""
    program = os.environ.get("BLENDER_PYTHON", sys.executable)
    code = "import bpy, sys; sys.exit(bpy.app.version < (5, 0, 0))"
    if subprocess.run([program, "-c", code], capture_output=True, check=False).returncode != 0:
        pytest.skip("Blender's module bpy, version 5 or newer, is not installed; see docs/testing.md")
    return program


def scene_of(shining: Collection[str] = (), *, aovs: Collection[str] = ()) -> lajolla.Scene:
    """The shapes and instances under a grey sky, or, if some are `shining`, in the light of these."""
    shapes = {
        name: {**shape, "emitter": area()} if name in shining else shape for name, shape in SHAPES.items()
    }
    for name, position in INSTANCE.items():
        if name in shining:
            shapes[name] = {**TWIN, "center": position, "emitter": area()}
        else:
            to_world, of = translation(*position), {"type": "ref", "id": "twin"}
            shapes[name] = {"type": "instance", "to_world": to_world, "of": of}
    return lajolla.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 1 if shining else 2},
            "sensor": {
                "type": "thinlens",
                "to_world": look_at((0, 1.5, -5), (0, 0.5, 0)),
                "fov": 40,
                "aperture_radius": 0.15,
                "focus_distance": 5,
                "film": {"type": "hdrfilm", "rfilter": {"type": "gaussian"}},
            },
            **({} if shining else {"sky": {"type": "constant", "lightgroup": "sky"}}),
            SHELLAC: {"type": "diffuse", "reflectance": [0.7, 0.1, 0.05]},
            "twin": {"type": "shapegroup", "sphere": TWIN},
            **shapes,
        },
        size=SIZE,
        aovs=list(aovs),
    )


def by_blender(python: str, picture: Path, mattes: list[tuple[str, str]]) -> Blender:
    folder = picture.parent
    job = folder / "job.json"
    fields = {"picture": str(picture), "size": SIZE, "mattes": mattes, "folder": str(folder)}
    job.write_text(json.dumps(fields))
    command = [python, str(Path(__file__).with_name("blender_mattes.py")), str(job)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    pictures = [lajolla.Image.open(folder / f"{i}.exr").array[..., 0] for i in range(len(mattes))]
    return Blender(**json.loads((folder / "found.json").read_text()), mattes=pictures)


@pytest.mark.parametrize("options", [{}, {"half": True, "compression": "dwaa"}], ids=["exact", "dwaa"])
def test_layers_and_mattes(blender_python: str, options: dict[str, Any], tmp_path: Path) -> None:
    scene_of(aovs=list(AOVS)).render(spp=32, seed=5).save(tmp_path / "layers.exr", **options)
    shining = {
        **{("crypto_shape", name): [name] for name in SHAPES},
        **{("crypto_instance", name): [name] for name in INSTANCE},
        ("crypto_material", SHELLAC): [BALL, MOON],
    }
    found = by_blender(blender_python, tmp_path / "layers.exr", list(shining))
    assert found.layers == {name: kind for kind, names in SOCKETS.items() for name in names}
    assert sorted(found.cryptomattes) == CRYPTOMATTES
    assert found.picked == [name for _, name in shining]
    for names, matte in zip(shining.values(), found.mattes, strict=True):
        expected = scene_of(names).render(spp=32, seed=5).array[..., 0]
        assert ((expected > 0.1) & (expected < 0.9)).sum() > 10, names
        np.testing.assert_allclose(matte, expected, atol=1e-5, err_msg=str(names))


def test_the_exported_scene_of_the_book(blender_python: str, repository: Path, tmp_path: Path) -> None:
    folder = repository / "scenes" / "book" / "blender"
    command = [blender_python, str(folder / "make_scene.py"), str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    assert (tmp_path / "scene.xml").read_text() == (folder / "scene.xml").read_text()
    assert lajolla.load(tmp_path / "scene.xml", size=(6, 4)).warnings == []
