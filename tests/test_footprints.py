"""Footprints of pixels: ray differentials against differences of neighbouring rays, and filtered pictures."""

from __future__ import annotations

import itertools
from pathlib import Path

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

import lajolla
from lajolla import _core, _core_testing

SIZE = (24, 16)
SCENES = Path(__file__).parent.parent / "scenes"
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
    rays: int = 400,
    least: float = 0.3,
    most_wrong: float = 0,
) -> None:
    """Against central differences of rays that meet the same triangles.

    `least` of all are compared, and `most_wrong` of these may be wrong: where the normal of a mesh is turned
    because the mirror direction is below the surface, the differentials are those of the normal before.
    """
    film = generator().uniform(0.02, 0.98, (rays, 2))
    lens = generator().uniform(0.1, 0.9, (rays, 2)).astype(np.float32)
    pixels = 0.02

    def follow(dx: float, dy: float) -> dict[str, np.ndarray]:
        moved = film + pixels * np.array([dx, dy]) / SIZE
        found: dict[str, np.ndarray] = _core_testing.differentials_after(
            scene, moved.astype(np.float32), lens, 0.999999, bounces
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


RARELY_HIT = "two mirror balls"  # one after the other


@pytest.mark.parametrize("name", BOUNCES)
def test_bounces(name: str) -> None:
    shapes, bounces = BOUNCES[name]
    check_differentials(
        scene_of(*shapes),
        bounces,
        rays=4000 if name == RARELY_HIT else 400,
        least=0.015 if name == RARELY_HIT else 0.3,
        most_wrong=0.04 if SMOOTH["mesh"] in [s.get("mesh") for s in shapes] else 0,
    )


def test_bounces_of_a_camera_with_a_lens() -> None:
    check_differentials(scene_of({**BALL, "material": MIRROR}, camera="thinlens"), 1)
    check_differentials(scene_of({**BALL, "material": GLASS}, camera="telecentric"), 2)


ELLIPSOID = rotation((1, 2, 3), 40) @ scaling(0.4, 1.5, 1)


def test_reflections_inside_of_glass() -> None:
    """Into an ellipsoid, total reflection inside, and out: only such rays meet it three times."""
    scene = scene_of(
        {**BALL, "material": GLASS},
        groups=[{"shapes": [1]}],
        instances=[{"group": 0, "to_world": ELLIPSOID}],
    )
    check_differentials(scene, 3, rays=2000, least=0.2, most_wrong=0.002)


@pytest.mark.parametrize(("tilt", "turned"), [(0.1, 0.02), (0.5, 0.25)])
def test_mapped_normals_turn_with_the_surface(tilt: float, turned: float) -> None:
    """A constant normal map on a mirror tube, on which the axes of the map do not spin.

    On one of its sides, mirror directions are below the surface, if the angle to the normal is more than 90
    degrees minus twice the tilt: for 30 degrees, on a quarter of the tube's width.
    """
    normal = np.array([tilt, 0, np.sqrt(1 - tilt**2)])
    tilted = np.full((4, 4, 3), normal / 2 + 0.5, np.float32)
    scene = make_scene(
        shapes=[ROOM, BOUNCES["mirror tube"][0][0] | {"material": 1}],
        bsdfs=BSDFS[:2],
        adapters=[{"type": "normalmap", "normalmap": {"texture": 1}, "child": 1}],
        materials=[{"front": 0, "back": 0}, {"front": {"adapter": 0}, "back": {"adapter": 0}}],
        textures=[READS_FOOTPRINTS, {"type": "bitmap", "image": _core.Image(tilted, srgb=False)}],
        sensor={**CAMERAS["perspective"], "to_world": EYE},
        size=SIZE,
    )
    check_differentials(scene, 1, most_wrong=turned)


# --- Texture coordinates without an area ------------------------------------------------------------------


def mapped_ball(by_u: tuple[float, float], start: tuple[float, float]) -> _core.Mesh:
    """A ball whose texture coordinates are start + longitude * by_u."""

    def point(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        u, v = 2 * np.pi * u, np.pi * (0.05 + 0.9 * v)
        return np.stack([np.sin(v) * np.cos(u), np.cos(v), np.sin(v) * np.sin(u)], -1)

    u, v = np.meshgrid(np.linspace(0, 1, 25), np.linspace(0, 1, 13))
    corner = (np.arange(12)[:, None] * 25 + np.arange(24)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 25, corner + 26], 1), np.stack([corner, corner + 26, corner + 1], 1)]
    )
    positions = point(u, v).reshape(-1, 3).astype(np.float32)
    uvs = np.array(start) + u.reshape(-1, 1) * np.array(by_u)
    return _core.Mesh(positions, faces.astype(np.uint32), positions, uvs.astype(np.float32))


@pytest.mark.parametrize("by_u", [(0, 0), (1, 0), (0, 1), (1, 0.3)])
def test_texture_coordinates_on_a_line(by_u: tuple[float, float]) -> None:
    shape: Settings = {"type": "mesh", "mesh": mapped_ball(by_u, (0.3, 0.4)), "to_world": scaling(2)}
    check_differentials(scene_of({**shape, "material": 0}), 0, least=0.5)
    check_differentials(scene_of({**shape, "material": MIRROR}), 1, most_wrong=0.04)


@pytest.mark.parametrize("footprint", ["differentials", "cone"])
@pytest.mark.parametrize("kind", ["trilinear", "ewa"])
def test_one_texel_of_a_palette(kind: str, footprint: str) -> None:
    """Is not mixed with others, however small the mesh is in the picture."""
    palette = np.zeros((16, 16, 3), np.float32)
    palette[:, :8, 0] = palette[:, 8:, 2] = 1
    scene = make_scene(
        shapes=[{"type": "mesh", "mesh": mapped_ball((0, 0), (0.3, 0.5)), "material": 0}],
        emitters=[{"type": "constant"}],
        textures=[{"type": "bitmap", "image": _core.Image(palette), "filter_type": kind}],
        bsdfs=BSDFS[:1],
        sensor={"type": "perspective", "fov": 40, "to_world": EYE},
        footprint=footprint,
        strategy="bsdf",
        max_depth=2,
    )
    np.testing.assert_allclose(picture(scene, 4)[3:5, 3:5], np.broadcast_to((1, 0, 0), (2, 2, 3)), atol=1e-5)


# --- Rough surfaces -----------------------------------------------------------------------------------


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


@pytest.mark.parametrize("distance", [1, 2.5, 4, 6, 9, 14])
def test_roughness_widens_footprints_where_rays_converge(distance: float) -> None:
    """At all distances from a concave mirror that focuses parallel rays at the distance 4."""
    film = np.stack(np.meshgrid(*2 * [np.linspace(0.35, 0.65, 5)]), -1).reshape(-1, 2).astype(np.float32)

    def size(alpha: float) -> np.ndarray:
        screen = {"type": "rectangle", "to_world": translation(0, 0, 8 - distance) @ scaling(9)}
        camera: Settings = {"type": "orthographic", "to_world": look_at((0.2, 0.1, 7.5), (0.2, 0.1, 8))}
        scene = make_scene(
            shapes=[
                {**screen, "material": 0},
                {**BALL, "radius": 8, "flip_normals": True, "material": 1},
            ],
            bsdfs=[BSDFS[0], {"type": "roughconductor", "alpha_u": alpha, "alpha_v": alpha}],
            materials=[{"front": 0, "back": 0}, {"front": 1, "back": 1}],
            textures=[READS_FOOTPRINTS],
            sensor=camera,
            size=SIZE,
        )
        found = _core_testing.differentials_after(scene, film, film, 0.5, 1)
        assert found["valid"].all() and found["followed"].all()
        squares: np.ndarray = (found["position_dx"] ** 2 + found["position_dy"] ** 2).sum(1)
        return np.sqrt(squares)

    sizes = [size(alpha) for alpha in (1e-4, 0.01, 0.02, 0.05)]
    for smoother, rougher in itertools.pairwise(sizes):
        assert (rougher > smoother).all()


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


@pytest.mark.parametrize("kind", ["trilinear", "ewa"])
def test_differentials_see_through_glass(kind: str) -> None:
    """One sample is nearer to the truth than with cones, which are too narrow behind a glass ball."""

    def board(kind: str, footprint: str, spp: int, seed: int) -> lajolla.Image:
        scene = lajolla.load(
            SCENES / "book/checkerboard.xml",
            parameters={"sky": "0", "filter": kind},
            footprint=footprint,
            size=(90, 60),
            aovs=["position"],
        )
        return scene.render(spp=spp, seed=seed)

    truth = board("bilinear", "cone", 512, 0)
    position = np.stack([truth.channels[f"position.{c}"] for c in "xyz"], -1)
    ball = np.linalg.norm(position - np.array([2, 1.7, 0]), axis=-1) < 1.7 * 1.01
    assert ball.sum() > 200

    def error(footprint: str) -> float:
        images = [board(kind, footprint, 1, seed).array for seed in range(1, 5)]
        return float(np.mean([((i - truth.array) ** 2 / (truth.array**2 + 0.01))[ball] for i in images]))

    assert error("differentials") < 0.85 * error("cone")


def floor(kind: str, footprint: str, variables: str) -> lajolla.Image:
    """A picture with one sample per pixel, and variables of an `aov` integrator around `path`."""
    board = np.asarray(np.indices((64, 64)).sum(0) % 2 * 0.8 + 0.1)[..., None].repeat(3, 2)
    path = {"type": "path", "max_depth": 2, "strategy": "bsdf", "footprint": footprint}
    scene = lajolla.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "aov", "aovs": variables, "picture": path},
            "sensor": {
                "type": "perspective",
                "fov": 50,
                "to_world": lajolla.look_at(origin=(0, 4, -9), target=(0, 1.5, 0), up=(0, 1, 0)),
                "film": {"type": "hdrfilm", "width": 32, "height": 24, "rfilter": {"type": "box"}},
                "sampler": {"type": "independent", "sample_count": 1},
            },
            "light": {"type": "constant"},
            "floor": {
                "type": "rectangle",
                "to_world": rotation((1, 0, 0), -90) @ scaling(20),
                "bsdf": {
                    "type": "diffuse",
                    "reflectance": {
                        "type": "bitmap",
                        "data": board,
                        "raw": True,
                        "filter_type": kind,
                    },
                },
            },
        }
    )
    return scene.render(spp=1)


@pytest.mark.parametrize("footprint", ["differentials", "cone"])
@pytest.mark.parametrize("kind", ["trilinear", "ewa"])
def test_channels_are_filtered_as_the_picture_is(kind: str, footprint: str) -> None:
    image = floor(kind, footprint, "albedo:albedo")
    albedo = np.stack([image.channels[f"albedo.{c}"] for c in "RGB"], -1)
    seen = albedo.sum(-1) > 0
    assert seen.sum() > 100
    np.testing.assert_allclose(albedo[seen], image.array[seen], rtol=1e-4)


@pytest.mark.parametrize("footprint", ["differentials", "cone"])
def test_levels_are_those_of_the_footprint(footprint: str) -> None:
    """Of a cone they depend on nothing but its radius; of differentials on the angle to the surface too."""
    channels = floor("trilinear", footprint, "level:mip_level,cone:ray_cone").channels
    radius = channels["cone.R"]
    offset = (channels["level.L"] - np.log2(np.maximum(radius, 1e-9)))[radius > 0]
    assert len(offset) > 100
    assert (np.ptp(offset) < 1e-2) == (footprint == "cone")


def test_footprints_do_not_depend_on_the_number_of_samples() -> None:
    """One sample in the middle of each pixel, and 64 of them: no footprint shrinks with their number."""

    def plate(kind: str, spp: int) -> np.ndarray:
        scene = make_scene(
            shapes=[{**PLATE, "material": 0}],
            emitters=[{"type": "constant"}],
            textures=[{**READS_FOOTPRINTS, "filter_type": kind, "to_uv": scaling(4)}],
            bsdfs=BSDFS[:1],
            sensor={**CAMERAS["perspective"], "to_world": EYE},
            size=(48, 32),
            rfilter=PINHOLE,
            max_depth=2,
            strategy="bsdf",
        )
        return picture(scene, spp)

    one = plate("ewa", 1)
    np.testing.assert_allclose(one, plate("ewa", 64), atol=2e-3)
    assert one.std() < 0.5 * plate("bilinear", 1).std()  # so that a smaller footprint would be seen
