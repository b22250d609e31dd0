"""The engine without Python: a program that uses it draws what Python draws."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from process_tools import build_folder

from lajolla import _core


def built_program() -> Path:
    """`lajolla-core`, which stands beside the extension module in the folder where both were built."""
    program = build_folder() / "core" / "engine" / "lajolla-core"
    if not program.is_file():
        pytest.skip("lajolla-core is not built")
    return program


Axis = tuple[float, float, float]


def placed(x: Axis, y: Axis, z: Axis, at: Axis) -> list[list[float]]:
    """The matrix with these axes and this origin."""
    return [*(list(row) for row in zip(x, y, z, at, strict=True)), [0, 0, 0, 1]]


def wall(x: Axis, y: Axis, z: Axis, at: Axis, material: int, emitter: int = -1) -> dict[str, Any]:
    """A rectangle from -1 to 1 along x and y, that looks along z."""
    return {"type": "rectangle", "to_world": placed(x, y, z, at), "material": material, "emitter": emitter}


def box() -> dict[str, Any]:
    """The box of core/engine/render_scene.cpp."""
    pyramid = _core.Mesh(
        np.array([[-0.7, -1, 0.1], [-0.1, -1, 0.4], [-0.5, -1, 0.8], [-0.4, 0.2, 0.4]], np.float32),
        np.array([[0, 3, 1], [1, 3, 2], [2, 3, 0]], np.uint32),
    )
    return {
        "bsdfs": [
            {"type": "diffuse", "reflectance": 0.75},
            {"type": "diffuse", "reflectance": [0.6, 0.06, 0.05]},
            {"type": "diffuse", "reflectance": [0.1, 0.45, 0.08]},
            {"type": "dielectric"},
        ],
        "materials": [{"front": index} for index in range(4)],
        "emitters": [{"type": "area", "radiance": [18, 14, 8]}],
        "shapes": [
            wall((1, 0, 0), (0, 0, -1), (0, 1, 0), (0, -1, 0), 0),
            wall((1, 0, 0), (0, 0, 1), (0, -1, 0), (0, 1, 0), 0),
            wall((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), 0),
            wall((0, 0, -1), (0, 1, 0), (1, 0, 0), (-1, 0, 0), 1),
            wall((0, 0, 1), (0, 1, 0), (-1, 0, 0), (1, 0, 0), 2),
            wall((0.3, 0, 0), (0, 0, 0.3), (0, -1, 0), (0, 0.99, 0), 0, 0),
            {"type": "sphere", "center": [0.4, -0.6, -0.2], "radius": 0.4, "material": 3},
            {"type": "mesh", "mesh": pyramid, "material": 0},
        ],
        "sensor": {
            "type": "perspective",
            "fov": 40,
            "to_world": placed((-1, 0, 0), (0, 1, 0), (0, 0, -1), (0, 0, 3.9)),
        },
        "film": {"width": 64, "height": 64},
        "integrator": {"type": "path", "max_depth": 8},
    }


def read_pfm(path: Path) -> np.ndarray:
    kind, size, scale, pixels = path.read_bytes().split(b"\n", 3)
    assert kind == b"PF" and float(scale) < 0
    width, height = map(int, size.split())
    return np.frombuffer(pixels, np.float32).reshape(height, width, 3)[::-1]


def test_a_program_draws_what_python_draws(tmp_path: Path) -> None:
    program, file = built_program(), tmp_path / "box.pfm"
    subprocess.run([program, file], check=True, timeout=60)
    render = _core.Render(_core.Scene(box()))
    assert render.advance(16)
    picture = render.image()
    assert picture[:, :8].mean(axis=(0, 1))[0] > 2 * picture[:, :8].mean(axis=(0, 1))[1]  # the red wall
    np.testing.assert_array_equal(read_pfm(file), picture)


def test_a_picture_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    result = subprocess.run(
        [built_program(), tmp_path / "no" / "box.pfm"],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert result.returncode == 1 and "cannot write" in result.stderr
