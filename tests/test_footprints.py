"""Footprints of pixels: ray differentials against differences of neighbouring rays, and filtered pictures."""

from __future__ import annotations

import numpy as np
import pytest
from scene_tools import (
    PINHOLE,
    Settings,
    look_at,
    make_scene,
    picture,
    rotation,
    scaling,
    translation,
    uv_sphere,
)
from statistics_tools import generator

from lajolla import _core, _core_testing

SIZE = (24, 16)
BOARD = _core.Image((np.indices((64, 64)).sum(0) % 2 * 0.8 + 0.1)[..., None].astype(np.float32))
READS_FOOTPRINTS: Settings = {"type": "bitmap", "image": BOARD, "filter_type": "ewa"}
BSDFS: tuple[Settings, ...] = (
    {"type": "diffuse", "reflectance": {"texture": 0}},
    {"type": "conductor"},
    {"type": "dielectric", "int_ior": 1.5, "ext_ior": 1.0},
)
MIRROR, GLASS = 1, 2
ROOM: Settings = {"type": "sphere", "radius": 20, "material": 0}  # what all rays end at
EYE = look_at((0.3, 0.2, -6), (0, 0, 0))
SMOOTH: Settings = {"type": "mesh", "mesh": uv_sphere(12, 7, smooth=True), "to_world": scaling(1.5)}
BALL: Settings = {"type": "sphere", "radius": 1.5}
PLATE: Settings = {"type": "rectangle", "to_world": rotation((1, 0.3, 0), 150) @ scaling(4)}
CAMERAS: dict[str, Settings] = {
    "perspective": {"type": "perspective", "fov": 40, "principal_point_offset_x": 0.1},
    "scaled perspective": {"type": "perspective", "fov": 60, "to_world": scaling(2, 3, 0.7)},
    "thinlens": {"type": "thinlens", "fov": 40, "aperture_radius": 0.3, "focus_distance": 4},
    "orthographic": {"type": "orthographic", "to_world": scaling(2, 3, 1)},
    "telecentric": {"type": "telecentric", "aperture_radius": 0.3, "focus_distance": 4},
    "spherical": {"type": "spherical"},
}


def scene_of(*shapes: Settings, camera: str = "perspective", **parts: list[Settings]) -> _core.Scene:
    sensor = CAMERAS[camera]
    return make_scene(
        shapes=[ROOM, *shapes],
        bsdfs=BSDFS,
        materials=[{"front": i, "back": i} for i in range(len(BSDFS))],
        textures=[READS_FOOTPRINTS],
        sensor={**sensor, "to_world": EYE @ np.asarray(sensor.get("to_world", np.eye(4)))},
        size=SIZE,
        **parts,
    )


def check_differentials(
    scene: _core.Scene,
    bounces: int,
    *,
    u_lobe: float = 0.999999,
    least: float = 0.015,
    most_wrong: float = 0,
) -> None:
    """Against central differences of rays that meet the same triangles.

    `least` of all are compared, and `most_wrong` of these may be wrong: where the normal of a mesh is turned
    because the mirror direction is below the surface, the differentials are those of the normal before.
    """
    film = generator().uniform(0.02, 0.98, (400, 2))
    lens = generator().uniform(0.1, 0.9, (400, 2)).astype(np.float32)
    pixels = 0.02

    def follow(dx: float, dy: float) -> dict[str, np.ndarray]:
        moved = film + pixels * np.array([dx, dy]) / SIZE
        found: dict[str, np.ndarray] = _core_testing.differentials_after(
            scene, moved.astype(np.float32), lens, u_lobe, bounces
        )
        return found

    middle = follow(0, 0)
    compared = 0
    for axis, step in (("x", (1, 0)), ("y", (0, 1))):
        after, before = follow(*step), follow(-step[0], -step[1])
        valid = middle["followed"] & after["valid"] & before["valid"]
        valid &= (after["route"] == middle["route"]) & (before["route"] == middle["route"])
        for name in ("position", "direction", "uv"):
            steps = after[name] - middle[name].astype(float), middle[name].astype(float) - before[name]
            bend = np.linalg.norm(steps[0] - steps[1], axis=1)
            difference = (steps[0] + steps[1]) / (2 * pixels)
            size = np.linalg.norm(difference, axis=1)
            rounding = 1e-5 * (1 + np.abs(middle[name]).max()) / pixels
            steady = valid & (bend / pixels <= 0.05 * size + rounding)
            error = np.linalg.norm(middle[f"{name}_d{axis}"] - difference, axis=1)[steady]
            right = error <= 0.02 * size[steady] + rounding
            assert right.mean() >= 1 - most_wrong, (name, axis, error[~right])
            compared += int(steady.sum())
    assert compared > least * 6 * len(film)


@pytest.mark.parametrize("camera", CAMERAS)
def test_cameras(camera: str) -> None:
    check_differentials(scene_of(camera=camera), 0, least=0.95)
    check_differentials(scene_of({**PLATE, "material": 0}, camera=camera), 0, least=0.9)


@pytest.mark.parametrize("camera", ["radiancemeter", "distant"])
def test_cameras_whose_pixels_see_the_same_have_no_footprint(camera: str) -> None:
    scene = make_scene(shapes=[ROOM], bsdfs=BSDFS[:1], textures=[READS_FOOTPRINTS], sensor={"type": camera})
    point = np.full((1, 2), 0.5, np.float32)
    found = _core_testing.differentials_after(scene, point, point, 0.5, 0)
    assert found["valid"].all() and not found["position_dx"].any() and not found["position_dy"].any()


BOUNCES: dict[str, tuple[list[Settings], int]] = {
    "flat mirror": ([{**PLATE, "material": MIRROR}], 1),
    "two flat mirrors": (
        [
            {**PLATE, "material": MIRROR},
            {**PLATE, "to_world": translation(0, 0, -9) @ scaling(12), "material": MIRROR},
        ],
        2,
    ),
    "mirror ball": ([{**BALL, "material": MIRROR}], 1),
    "inside of a mirror ball": ([{**BALL, "radius": 8, "flip_normals": True, "material": MIRROR}], 1),
    "two mirror balls": (
        [
            {**BALL, "center": [1.2, 0, 0], "radius": 1, "material": MIRROR},
            {**BALL, "center": [-1.2, 0, 0], "radius": 1, "material": MIRROR},
        ],
        2,
    ),
    "mirror tube": (
        [{"type": "cylinder", "p0": [-3, -1, 0], "p1": [3, 1, 0.5], "radius": 1.2, "material": MIRROR}],
        1,
    ),
    "mirror with interpolated normals": ([{**SMOOTH, "material": MIRROR}], 1),
    "flipped normals": ([{**SMOOTH, "flip_normals": True, "material": MIRROR}], 1),
    "sheet of glass": ([{**PLATE, "material": GLASS}], 1),
    "glass ball": ([{**BALL, "material": GLASS}], 2),
    "glass mesh": ([{**SMOOTH, "material": GLASS}], 2),
    "facets": (
        [{"type": "mesh", "mesh": uv_sphere(6, 4, smooth=False), "to_world": scaling(2), "material": MIRROR}],
        1,
    ),
}


@pytest.mark.parametrize("name", BOUNCES)
def test_bounces(name: str) -> None:
    shapes, bounces = BOUNCES[name]
    check_differentials(
        scene_of(*shapes),
        bounces,
        most_wrong=0.04 if SMOOTH["mesh"] in [s.get("mesh") for s in shapes] else 0,
    )


def test_bounces_of_a_camera_with_a_lens() -> None:
    check_differentials(scene_of({**BALL, "material": MIRROR}, camera="thinlens"), 1)
    check_differentials(scene_of({**BALL, "material": GLASS}, camera="telecentric"), 2)


def test_reflections_inside_of_glass() -> None:
    """In, once around the inside, and out: the reflection is chosen by the random number alone."""
    scene = scene_of({**BALL, "material": GLASS, "flip_normals": True})
    check_differentials(scene, 1, u_lobe=0.0)


@pytest.mark.parametrize("shape", [BALL, SMOOTH], ids=["sphere", "mesh"])
@pytest.mark.parametrize("material", [MIRROR, GLASS])
def test_instances(shape: Settings, material: int) -> None:
    """Stretched, so that a ball becomes an ellipsoid."""
    placed = translation(0.2, 0, 0.5) @ rotation((1, 2, 3), 40) @ scaling(0.7, 1.3, 1)
    scene = scene_of(
        {**shape, "material": material},
        groups=[{"shapes": [1]}],
        instances=[{"group": 0, "to_world": placed}],
    )
    check_differentials(scene, 1 if material == MIRROR else 2, most_wrong=0.04 if shape is SMOOTH else 0)


def test_rough_surfaces_widen_or_end_differentials() -> None:
    def found(alpha: float) -> dict[str, np.ndarray]:
        rough = {"type": "roughconductor", "alpha_u": alpha, "alpha_v": alpha}
        scene = make_scene(
            shapes=[ROOM, {**PLATE, "material": 1}],
            bsdfs=[BSDFS[0], rough],
            materials=[{"front": 0, "back": 0}, {"front": 1, "back": 1}],
            textures=[READS_FOOTPRINTS],
            sensor={**CAMERAS["perspective"], "to_world": EYE},
            size=SIZE,
        )
        film = np.full((1, 2), 0.5, np.float32)
        result: dict[str, np.ndarray] = _core_testing.differentials_after(scene, film, film, 0.5, 1)
        return result

    widths = [np.linalg.norm(found(alpha)["direction_dx"]) for alpha in (0.001, 0.02, 0.05)]
    assert widths[0] < widths[1] < widths[2]
    assert found(0.05)["followed"].all() and not found(0.6)["followed"].any()


# --- Pictures -------------------------------------------------------------------------------------------


def checkered(filter_type: str, footprint: str, *shapes: Settings, spp: int, sensor: Settings) -> np.ndarray:
    """An even light on a wide checkered floor, and what is above it."""
    scene = make_scene(
        shapes=[
            {"type": "rectangle", "to_world": rotation((1, 0, 0), -90) @ scaling(200), "material": 0},
            *shapes,
        ],
        emitters=[{"type": "constant"}],
        bsdfs=BSDFS,
        materials=[{"front": i, "back": i} for i in range(len(BSDFS))],
        textures=[{**READS_FOOTPRINTS, "filter_type": filter_type, "to_uv": scaling(6)}],
        sensor=sensor,
        size=(48, 32),
        sampler="sobol",
        strategy="bsdf",
        footprint=footprint,
        max_depth=5,
    )
    return picture(scene, spp)


ABOVE: Settings = {"type": "perspective", "fov": 50, "to_world": look_at((0, 4, -9), (0, 1.5, 0))}
SEEN: dict[str, list[Settings]] = {
    "floor": [],
    "mirror ball": [{"type": "sphere", "center": [0, 2, 0], "radius": 2, "material": MIRROR}],
    "glass ball": [{"type": "sphere", "center": [0, 2, 0], "radius": 2, "material": GLASS}],
}


@pytest.mark.parametrize("name", SEEN)
@pytest.mark.parametrize("footprint", ["differentials", "cone"])
def test_filters_bring_one_sample_near_the_reference(name: str, footprint: str) -> None:
    truth = checkered("bilinear", footprint, *SEEN[name], spp=1024, sensor=ABOVE)

    def error(kind: str) -> float:
        image = checkered(kind, footprint, *SEEN[name], spp=1, sensor=ABOVE)
        return float(np.mean((image - truth) ** 2 / (truth**2 + 0.01)))

    assert error("ewa") < error("trilinear") < error("bilinear")


def test_footprints_do_not_depend_on_the_number_of_samples() -> None:
    """Two halves of a render are the whole: no footprint shrinks with the number of samples."""
    scene = make_scene(
        shapes=[{**PLATE, "material": 0}],
        emitters=[{"type": "constant"}],
        textures=[{**READS_FOOTPRINTS, "to_uv": scaling(20)}],
        bsdfs=BSDFS[:1],
        sensor={**CAMERAS["perspective"], "to_world": EYE},
        rfilter=PINHOLE,
        max_depth=2,
        strategy="bsdf",
    )
    np.testing.assert_allclose(picture(scene, 1), picture(scene, 64), atol=2e-3)
