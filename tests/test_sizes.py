"""Shapes of any size, and scenes in any place, look alike: pictures do not depend on the unit of length."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from reader_tools import messages, read
from scene_tools import (
    Settings,
    area,
    box_mesh,
    look_at,
    make_scene,
    picture,
    rotation,
    scaling,
    translation,
    uv_sphere,
)

from lajolla import _core, _core_testing

TURNED = rotation((1, 2, 0), 30)
BRIGHT: Settings = {"type": "constant", "radiance": 0.3}
GREY: Settings = {"type": "diffuse", "reflectance": 0.5}


def curves(points: list[list[float]], size: float, basis: str) -> Settings:
    scaled = np.array(points, np.float32) * np.float32(size)
    return {"type": "curves", "curves": _core.Curves(scaled, np.array([0], np.uint32)), "basis": basis}


def ball_grid() -> _core.Grid:
    axis = np.linspace(-1, 1, 17)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    return _core.Grid((np.sqrt(x * x + y * y + z * z) - 0.8)[..., None].astype(np.float32))


SHAPES: dict[str, Callable[[float], Settings]] = {
    "sphere": lambda s: {"type": "sphere", "radius": s},
    "cube": lambda s: {"type": "mesh", "mesh": box_mesh(), "to_world": scaling(s)},
    "smooth mesh": lambda s: {"type": "mesh", "mesh": uv_sphere(24, 12, smooth=True), "to_world": scaling(s)},
    "rectangle": lambda s: {"type": "rectangle", "to_world": scaling(s) @ TURNED},
    "disk": lambda s: {"type": "disk", "to_world": scaling(s) @ TURNED},
    "cylinder": lambda s: {
        "type": "cylinder",
        "p0": [0, -0.8 * s, 0],
        "p1": [0, 0.8 * s, 0.1 * s],
        "radius": 0.5 * s,
    },
    "sdfgrid": lambda s: {
        "type": "sdfgrid",
        "grid": ball_grid(),
        "to_world": scaling(s) @ translation(-1, -1, -1) @ scaling(2),
    },
}
LINEAR: list[list[float]] = [[-1, 0, 0, 0.3], [1, 0.2, 0, 0.3]]
BSPLINE: list[list[float]] = [[-2, 0, 0, 0.3], [-1, 0.3, 0, 0.3], [1, 0.2, 0, 0.3], [2, 0.5, 0, 0.3]]
LIGHTS = ("sphere", "cube", "smooth mesh", "rectangle", "disk", "cylinder")


def beside_a_floor(shape: Settings, size: float, *, shines: bool) -> np.ndarray:
    floor = scaling(size) @ translation(0, -1.5, 0) @ rotation((1, 0, 0), -90) @ scaling(4)
    lamp = [area(3)] if shines else []
    scene = make_scene(
        shapes=[
            {**shape, "material": 0, **({"emitter": 1} if shines else {})},
            {"type": "rectangle", "to_world": floor, "material": 0},
        ],
        emitters=[BRIGHT, *lamp],
        bsdfs=[GREY],
        sensor={
            "type": "perspective",
            "to_world": look_at((2 * size, 1.5 * size, 3 * size), (0, 0, 0)),
            "near_clip": 1e-2 * size,
            "far_clip": 1e3 * size,
        },
        size=(16, 16),
        max_depth=3,
    )
    return picture(scene, 16)


@pytest.mark.parametrize("size", [1e-12, 1e-9, 1e-6, 1e6, 1e9, 1e12])
@pytest.mark.parametrize("name", SHAPES)
def test_pictures_do_not_depend_on_size(name: str, size: float) -> None:
    """The same random numbers find the same light, but for paths that rounding turns elsewhere."""
    if name == "smooth mesh" and size < 1e-11:
        size = 1e-11  # its edges are a tenth of that: Embree multiplies three lengths
    for shines in (False, True) if name in LIGHTS else (False,):
        same = beside_a_floor(SHAPES[name](1), 1, shines=shines)
        other = beside_a_floor(SHAPES[name](size), size, shines=shines)
        assert np.abs(other - same).mean() < 2e-3 * same.mean()


@pytest.mark.parametrize("size", [1e-3, 1e3, 1e6])
@pytest.mark.parametrize(("basis", "points"), [("linear", LINEAR), ("bspline", BSPLINE)])
def test_curves_within_their_sizes(basis: str, points: list[list[float]], size: float) -> None:
    same = beside_a_floor(curves(points, 1, basis), 1, shines=False)
    other = beside_a_floor(curves(points, size, basis), size, shines=False)
    assert np.abs(other - same).mean() < 2e-3 * same.mean()


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        (SHAPES["cube"](1e13), r"shapes\[0\]: the shape reaches coordinates of 1.*e.?13; .* up to 4.*e.?12"),
        (SHAPES["sphere"](1e20), r"shapes\[0\]: the shape reaches coordinates of 1e.?20"),
        (SHAPES["cube"](1e-13), r"shapes\[0\]: the whole scene measures 2e-13; .* 1e-12 or more"),
        (curves(LINEAR, 1e8, "linear"), r"shapes\[0\]: the longest segment measures 2\d{8}; .* to 3e.?06"),
        (curves(LINEAR, 1e-8, "linear"), r"shapes\[0\]: the longest segment measures .*e-0?8"),
        (
            curves(BSPLINE, 1e11, "bspline"),
            r"shapes\[0\]: the longest segment measures 1\d{11}; .* to 3e.?09",
        ),
    ],
)
def test_other_sizes_are_refused(shape: Settings, message: str) -> None:
    with pytest.raises(_core.DescriptionError, match=message):
        make_scene(shapes=[{**shape, "material": 0}])


# ---- far from the origin


def room(place: np.ndarray, **more: object) -> Settings:
    """A bit of everything that has a place, moved by a matrix."""
    wall = box_mesh()

    def at(matrix: np.ndarray) -> list[list[float]]:
        return (place @ matrix).tolist()

    lamp = translation(0, 0.875, 0) @ rotation((1, 0, 0), 90) @ scaling(0.25)
    shapes: list[Settings] = [
        {"type": "mesh", "mesh": wall, "to_world": at(np.eye(4)), "material": 0},
        {"type": "sphere", "radius": 0.25, "to_world": at(translation(-0.5, -0.5, 0)), "material": 0},
        {"type": "rectangle", "to_world": at(lamp), "material": 0, "emitter": 0},
        {"type": "disk", "to_world": at(translation(0.5, -0.5, 0) @ scaling(0.25)), "material": 0},
        {"type": "cylinder", "p1": [0, 0.5, 0], "radius": 0.125, "to_world": at(np.eye(4)), "material": 0},
        {"type": "mesh", "mesh": wall, "to_world": scaling(0.125).tolist(), "material": 0},  # of the group
        {
            "type": "mesh",
            "mesh": wall,
            "to_world": at(translation(0.5, 0.25, 0.5) @ scaling(0.25)),
            "material": 1,
            "interior": 0,
        },
    ]
    haze = translation(0.25, 0, 0.25) @ scaling(0.5)
    values = np.linspace(1, 3, 8, dtype=np.float32).reshape(2, 2, 2, 1)
    return {
        "bsdfs": [GREY, {"type": "null"}],
        "materials": [{"front": 0, "back": 0}, {"front": 1, "back": 1}],
        "volumes": [{"type": "gridvolume", "grid": _core.Grid(values), "to_world": at(haze)}],
        "media": [{"type": "heterogeneous", "sigma_t": {"volume": 0}, "albedo": 0.5}],
        "emitters": [
            area(3),
            {"type": "point", "position": (place @ [0.5, 0.5, -0.5, 1])[:3].tolist(), "intensity": 0.1},
            {"type": "spot", "to_world": at(translation(0, 0.5, 0)), "cutoff_angle": 60},
        ],
        "shapes": shapes,
        "groups": [{"shapes": [5]}],
        "instances": [{"group": 0, "to_world": at(translation(-0.5, 0.25, 0.5))}],
        "sensor": {
            "type": "perspective",
            "to_world": at(look_at((0, 0, -0.9375), (0, 0, 0))),
            "fov": 80,
            "near_clip": 0.001,
        },
        "film": {"width": 12, "height": 12},
        "rfilter": {"type": "box"},
        "sampler": {"type": "independent"},
        "integrator": {"type": "volpath", "max_depth": 6},
        **more,
    }


@pytest.mark.parametrize("distance", [2.0**10, 2.0**20, 2.0**30])
def test_a_scene_that_is_placed_by_a_round_translation_is_the_same(distance: float) -> None:
    here = picture(_core.Scene(room(np.eye(4))), 4)
    there = picture(_core.Scene(room(translation(distance, -3 * distance, distance / 2))), 4)
    assert here.mean() > 0.05
    np.testing.assert_array_equal(there, here)


@pytest.mark.parametrize("distance", [1234.567, 1e6 / 3, 7e8 / 9])
def test_a_scene_looks_the_same_anywhere(distance: float) -> None:
    """In double, a billion units away, places are known to 1e-7."""
    here = picture(_core.Scene(room(np.eye(4))), 16)
    there = picture(_core.Scene(room(translation(distance, -distance, 0.3 * distance))), 16)
    assert np.abs(there - here).mean() < 2e-2 * here.mean()


@pytest.mark.parametrize("distance", [0.0, 1e4, 1e6, 1e9])
@pytest.mark.parametrize("turned", [False, True])
def test_a_closed_box_is_dark(distance: float, turned: bool) -> None:
    place = translation(distance, distance, -distance) @ (TURNED if turned else np.eye(4))
    scene = make_scene(
        shapes=[{"type": "mesh", "mesh": box_mesh(), "to_world": place, "material": 0}],
        emitters=[{"type": "constant", "radiance": 1}],
        sensor={"type": "perspective", "to_world": place, "fov": 120},
        size=(32, 32),
        max_depth=20,
    )
    assert picture(scene, 16).max() == 0


FAR_PLACES = [(1234567.3, 7654321.1, -2345678.7), (3e7, -2e6, 5e6), (0.1, 0.2, 0.3)]


@pytest.mark.parametrize("contents", FAR_PLACES)
@pytest.mark.parametrize("copies", FAR_PLACES)
def test_contents_of_groups_are_moved_too(contents: tuple[float, ...], copies: tuple[float, ...]) -> None:
    """However far the contents of a group are from its origin: instances are placed in double."""
    box = {"type": "mesh", "mesh": box_mesh(), "material": 0}
    ball = {"type": "sphere", "radius": 1.25, "center": (1, 0, 0), "material": 0}
    place = translation(*copies)
    back = place @ TURNED @ translation(*(-x for x in contents))

    def seen(shapes: list[Settings], **more: object) -> np.ndarray:
        scene = make_scene(
            shapes=shapes,
            emitters=[BRIGHT, {"type": "directional", "direction": (-1, -2, -3), "irradiance": 1}],
            sensor={"type": "perspective", "to_world": place @ look_at((4, 3, 5), (0, 0, 0))},
            **more,
        )
        return picture(scene, 16)

    placed = seen([{**box, "to_world": place @ TURNED}, {**ball, "to_world": place @ TURNED}])
    away = translation(*contents)
    grouped = seen(
        [{**box, "to_world": away}, {**ball, "to_world": away}],
        groups=[{"shapes": [0, 1]}],
        instances=[{"group": 0, "to_world": back}],
    )
    assert np.abs(grouped - placed).mean() < 2e-3 * placed.mean()


def test_a_shape_of_two_groups_stays() -> None:
    """It cannot be moved by both."""
    shapes = [{"type": "sphere", "center": (2.0**10, 0, 0), "material": 0}]
    view = translation(2.0**10, 0, 0) @ look_at((4, 3, 5), (0, 0, 0))
    options = {"emitters": [BRIGHT], "sensor": {"type": "perspective", "to_world": view}}
    instances = [{"group": 0}, {"group": 1, "to_world": translation(0, 3, 0)}]
    groups = [{"shapes": [0]}, {"shapes": [0]}]
    image = picture(make_scene(shapes=shapes, groups=groups, instances=instances, **options), 16)
    upper = {**shapes[0], "center": (2.0**10, 3, 0)}
    placed = picture(make_scene(shapes=[shapes[0], upper], **options), 16)
    assert np.abs(image - placed).mean() < 2e-3 * placed.mean()


def test_sizes_are_checked_where_shapes_are_moved_to() -> None:
    here, there = (
        picture(
            make_scene(
                shapes=[{"type": "sphere", "center": (x, 0, 0), "material": 0}],
                emitters=[BRIGHT],
                sensor={
                    "type": "perspective",
                    "to_world": translation(x, 0, 0) @ look_at((0, 0, 5), (0, 0, 0)),
                },
            ),
            4,
        )
        for x in (0, 2.0**44)
    )
    assert here.mean() > 0
    np.testing.assert_array_equal(there, here)


def test_vertices_far_away_are_moved_too() -> None:
    """Where float32 holds the vertices exactly, nothing is lost."""
    near = box_mesh()
    far = _core.Mesh(near.vertices + np.float32(2**20), near.faces)
    pictures = [
        picture(
            make_scene(
                shapes=[{"type": "mesh", "mesh": mesh, "material": 0}],
                emitters=[{"type": "constant", "radiance": 1}],
                sensor={
                    "type": "perspective",
                    "to_world": translation(x, x, x) @ look_at((4, 3, 5), (0, 0, 0)),
                },
            ),
            4,
        )
        for mesh, x in ((near, 0), (far, 2**20))
    ]
    np.testing.assert_array_equal(*pictures)


def test_positions_are_those_of_the_world() -> None:
    place = translation(1e6, 0, -1e6)
    channel = {"integrator": {"type": "field", "field": "position"}}
    here = picture(_core.Scene(room(np.eye(4), **channel)), 1)
    there = picture(_core.Scene(room(place, **channel)), 1)
    np.testing.assert_allclose(there, here + np.array([1e6, 0, -1e6]), atol=0.07)  # ulps of float32


def test_queries_are_in_the_world() -> None:
    x = 2.0**20
    scene = _core.Scene(room(translation(x, 0, 0)))
    origin = np.array([[x, 0, -0.5]], np.float32)
    hits = _core_testing.hit_many(scene, origin, np.array([[0, 0, 1], [0, 1, 0]], np.float32))
    assert hits["valid"].all()
    np.testing.assert_allclose(hits["position"][:, 0], x)
    sampled = _core_testing.shape_sample_many(scene, 2, np.full((1, 3), 0.5, np.float32))
    np.testing.assert_allclose(sampled["position"], [[x, 0.875, 0]])


def test_files_whose_vertices_are_too_far_away_are_told_once(tmp_path: Path) -> None:
    vertices = box_mesh().vertices.astype(float) + 1e8
    for name in ("a", "b"):
        lines = [f"v {x} {y} {z}\n" for x, y, z in vertices.tolist()]
        (tmp_path / f"{name}.obj").write_text("".join(lines) + "f 1 2 3\n")
    shapes = "".join(f'<shape type="obj"><string name="filename" value="{n}.obj"/></shape>' for n in "ab")
    told = [line for line in messages(read(tmp_path, shapes), tmp_path) if "float32" in line]
    assert len(told) == 1
    assert '"a.obj": its vertices are so far from their origin' in told[0]
