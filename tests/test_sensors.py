"""Cameras other than the perspective one: which way their rays go, told by the depth of a box's walls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from reader_tools import error
from scene_tools import PINHOLE, Settings, area, box_mesh, make_scene, picture, rotation, scaling, translation

from lajolla import _core
from lajolla.scene import load_description

# A box around the origin whose six walls are at different distances.
LOW, HIGH = np.array([-1, -2, -3.0]), np.array([4, 5, 6.0])
BOX = {
    "type": "mesh",
    "mesh": box_mesh(),
    "to_world": translation(*(LOW + HIGH) / 2) @ scaling(*(HIGH - LOW) / 2),
}
SIZE = (16, 8)


def depth(sensor: Settings, size: tuple[int, int] = SIZE) -> np.ndarray:
    scene = make_scene(shapes=[BOX], sensor=sensor, size=size, rfilter=PINHOLE, type="field", field="depth")
    return picture(scene, 1)[..., 0]


def wall(origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The distance to the box's walls from within."""
    direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    with np.errstate(divide="ignore"):
        return np.max([(LOW - origin) / direction, (HIGH - origin) / direction], axis=0).min(axis=-1)


def test_spherical() -> None:
    place = translation(0.5, 1, -0.7) @ rotation((1, 2, 3), 40) @ scaling(2)
    y, x = np.meshgrid((np.arange(8) + 0.5) / 8, (np.arange(16) + 0.5) / 16, indexing="ij")
    phi, theta = 2 * np.pi * x, np.pi * y
    local = np.stack([np.sin(phi) * np.sin(theta), np.cos(theta), -np.cos(phi) * np.sin(theta)], axis=-1)
    found = depth({"type": "spherical", "to_world": place})
    np.testing.assert_allclose(found, wall(place[:3, 3], local @ place[:3, :3].T), rtol=1e-2)


def test_radiancemeter() -> None:
    place = translation(0.5, 1, -0.7) @ rotation((1, 2, 3), 40)
    found = depth({"type": "radiancemeter", "to_world": place})
    np.testing.assert_allclose(found, wall(place[:3, 3], place[:3, 2]), rtol=1e-5)


def test_distant_with_a_target() -> None:
    """From outside, onto the wall at x = -1."""
    turn = rotation((0, 1, 0), 90) @ rotation((0, 0, 1), 30)
    radius = np.linalg.norm(HIGH - LOW) / 2
    target = np.array([-1, 0.5, 0.2])
    centre = (LOW + HIGH) / 2
    expected = 2 * radius + np.linalg.norm(target - centre)
    sensor = {"type": "distant", "to_world": turn, "target": list(target), "has_target": True}
    np.testing.assert_allclose(depth(sensor), expected, rtol=1e-5)


def test_distant_sees_the_whole_scene() -> None:
    """A lit disk fills its share of the bounding sphere's cross-section."""
    for degrees in (0, 60):
        scene = make_scene(
            shapes=[{"type": "disk", "emitter": 0}, {"type": "sphere", "radius": 1e-3, "center": [0, 0, 1]}],
            emitters=[area(2)],
            sensor={"type": "distant", "to_world": rotation((0, 1, 0), 180 + degrees)},
            size=(64, 64),
            sampler="sobol",
            max_depth=1,
        )
        box = np.array([1, 1, (1.001) / 2])
        expected = 2 * np.cos(np.radians(degrees)) / (box @ box)
        assert abs(picture(scene, 256).mean() / expected - 1) < 1e-2


def test_telecentric_is_sharp_at_its_focus_only() -> None:
    """What is at the focus distance looks as without a lens; elsewhere it is blurred by the lens's disk."""
    board = {"type": "checkerboard", "color0": 1, "color1": 0, "to_uv": scaling(2)}

    def view(kind: str, z: float, **lens: float) -> np.ndarray:
        scene = make_scene(
            shapes=[
                {
                    "type": "rectangle",
                    "to_world": translation(0, 0, z) @ rotation((1, 0, 0), 180),
                    "emitter": 0,
                }
            ],
            emitters=[area({"texture": 0})],
            textures=[board],
            sensor={"type": kind, "to_world": scaling(0.9, 0.9, 3), **lens},
            size=(20, 20),
            rfilter=PINHOLE,
            max_depth=1,
        )
        return picture(scene, 256)

    lens = {"aperture_radius": 0.2, "focus_distance": 2}
    np.testing.assert_allclose(view("telecentric", 2, **lens), view("orthographic", 2), atol=2e-2)
    blurred = view("telecentric", 3, **lens)  # by a disk of radius 0.1
    assert 0.2 < ((blurred > 0.1) & (blurred < 0.9)).mean() < 0.9
    assert abs(blurred[8:12, 8:12].mean() - view("orthographic", 3)[8:12, 8:12].mean()) < 0.05


def test_rays_by_origin_and_direction(tmp_path: Path) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        """<scene version="3.0.0"><integrator type="path"/><sensor type="radiancemeter">
        <point name="origin" x="1" y="2" z="3"/><vector name="direction" x="0" y="-2" z="0"/></sensor>
        </scene>"""
    )
    place = np.array(load_description(path).core["sensor"]["to_world"])
    np.testing.assert_allclose(place[:3, 2], [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(place[:3, 3], [1, 2, 3])
    assert np.linalg.det(place[:3, :3]) > 0.99
    path.write_text(path.read_text().replace('y="-2"', 'y="0"'))
    assert "has no direction" in error(path)


def test_every_camera_is_tested() -> None:
    elsewhere = {"perspective", "thinlens", "orthographic"}
    assert set(_core.schema()["sensor"]) == elsewhere | {
        "telecentric",
        "spherical",
        "radiancemeter",
        "distant",
    }
