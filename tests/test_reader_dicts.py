"""Values in Python dicts: what every one of them becomes, and how impossible ones are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_tools import write_scene

import lajolla
from lajolla.scene import describe, load_description

HUGE = 10**400  # more than a float holds
NAN, INFINITY = float("nan"), float("inf")


def scene_with(**objects: object) -> dict[str, Any]:
    return {"type": "scene", "integrator": {"type": "path"}, "sensor": {"type": "perspective"}, **objects}


def lit_by(radiance: object) -> dict[str, Any]:
    return scene_with(light={"type": "constant", "radiance": radiance})


def seen_by(**sensor: object) -> dict[str, Any]:
    return scene_with(sensor={"type": "perspective", **sensor})


def sampled(count: object) -> dict[str, Any]:
    return seen_by(sampler={"type": "independent", "sample_count": count})


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (sampled(NAN), '"sample_count" of sampler "independent" expects a whole number'),
        (sampled(INFINITY), '"sample_count" of sampler "independent" expects a whole number'),
        (sampled(2.5), '"sample_count" of sampler "independent" expects a whole number'),
        (sampled(HUGE), "the number is too large"),
        (sampled(10**30), '"sample_count" must be between 1 and 1073741824, not 1e+30'),
        (seen_by(fov=HUGE), "the number is too large"),
        (seen_by(fov=NAN), '"fov" must be finite'),
        (seen_by(to_world=[[HUGE] * 4] * 4), '"to_world" of sensor "perspective" expects a transform'),
        (seen_by(to_world=np.full((4, 4), NAN)), "numbers that are not finite"),
        (seen_by(to_world=np.eye(5)), '"to_world" of sensor "perspective" expects a transform'),
        (lit_by({"type": "rgb", "value": {"r": 1}}), "a colour is one number or three"),
        (lit_by({"type": "rgb", "value": [HUGE, 1, 1]}), "a colour is one number or three"),
        (lit_by({"type": "rgb", "value": [1, 1]}), "expected"),
        (lit_by({"type": "rgb", "value": NAN}), "expected"),
        (lit_by({"type": "spectrum", "value": HUGE}), "a spectrum needs"),
        (lit_by({"type": "spectrum", "value": NAN}), '"radiance" of emitter "constant" must be finite'),
        (lit_by({"type": "blackbody", "temperature": 5000, "scale": "x"}), '"scale" of texture "blackbody"'),
        (lit_by({"type": "blackbody", "temperature": 0}), '"temperature" must be at least 1, not 0'),
        (lit_by({"type": "blackbody", "temperature": "x"}), '"temperature" of texture "blackbody"'),
        (lit_by({"type": "blackbody"}), 'texture "blackbody" needs "temperature"'),
        (scene_with(integrator=5), 'a scene has no property "integrator"'),
        ({"type": "shape"}, 'the dict must have {"type": "scene"}'),
    ],
)
def test_impossible_values(scene: dict[str, Any], message: str) -> None:
    with pytest.raises(lajolla.SceneError) as caught:
        describe(scene, strict=True)
    assert message in str(caught.value)


def test_a_blackbody_is_that_of_files() -> None:
    colour = describe(lit_by({"type": "blackbody", "temperature": 5000, "scale": 2})).core["emitters"][0]
    single = describe(lit_by({"type": "blackbody", "temperature": 5000})).core["emitters"][0]
    np.testing.assert_allclose(colour["radiance"], 2 * np.array(single["radiance"]))


@pytest.mark.parametrize("size", [3, 4])
def test_square_arrays_are_pictures_where_pictures_belong(size: int) -> None:
    bitmap = {"type": "bitmap", "data": np.eye(size, dtype=np.float32)}
    ball = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": bitmap}}
    image = describe(scene_with(ball=ball)).core["textures"][0]["image"]
    assert (image.width, image.height) == (size, size)


def test_matrices_of_texture_space_may_be_3x3() -> None:
    matrix = np.array([[2, 0, 0.5], [0, 3, 0.25], [0, 0, 1]])
    board = {"type": "checkerboard", "to_uv": matrix}
    ball = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": board}}
    embedded = describe(scene_with(ball=ball)).core["textures"][0]["to_uv"]
    np.testing.assert_array_equal(embedded, [[2, 0, 0, 0.5], [0, 3, 0, 0.25], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("name", "properties"),
    [
        ("independent", {}),
        ("sobol", {"scramble": 3}),
        ("stratified", {"jitter": False, "dimension": 6}),
        ("multijitter", {"jitter": True}),
        ("orthogonal", {"jitter": True, "strength": 2}),
        ("ldsampler", {"dimension": 8}),
        ("halton", {"scramble": 0}),
        ("hammersley", {"scramble": -1}),
    ],
)
def test_samplers(name: str, properties: dict[str, Any]) -> None:
    """All mean the same points, with a count and a seed; parameters of their own make no difference."""
    sampler = {"type": name, "sample_count": 9, "seed": 2, **properties}
    description = describe(scene_with(sensor={"type": "perspective", "sampler": sampler}))
    assert description.core["sampler"] == {"type": "sobol", "sample_count": 9, "seed": 2}
    assert not [w for w in description.warnings if "no light" not in w.message]


@pytest.mark.parametrize(
    "rfilter",
    [
        {"type": "box", "radius": 0.7},
        {"type": "tent", "radius": 1.5},
        {"type": "gaussian", "stddev": 0.4},
        {"type": "mitchell", "B": 0.2, "C": 0.4},
        {"type": "catmullrom"},
        {"type": "lanczos", "lobes": 2},
    ],
)
def test_filters(rfilter: dict[str, Any]) -> None:
    film = {"type": "hdrfilm", "rfilter": rfilter}
    description = describe(scene_with(sensor={"type": "perspective", "film": film}))
    assert description.core["rfilter"] == rfilter
    assert not [w for w in description.warnings if "no light" not in w.message]


def test_dicts_give_back_light_between_microfacets_and_files_do_not(tmp_path: Path) -> None:
    def multiscatter(**bsdf: object) -> bool:
        description = describe(scene_with(ball={"type": "sphere", "bsdf": bsdf}))
        lajolla._core.Scene(description.core)
        return description.core["bsdfs"][0].get("multiscatter", False)

    for name in ("roughconductor", "roughdielectric", "roughplastic"):
        assert multiscatter(type=name, alpha=0.4)
        assert not multiscatter(type=name, alpha=0.4, multiscatter=False)
        bsdf = f'<bsdf type="{name}"><float name="alpha" value="0.4"/></bsdf>'
        for version in ("0.6.0", "3.0.0"):
            scene = write_scene(tmp_path, f'<shape type="sphere">{bsdf}</shape>', version)
            assert not load_description(scene).core["bsdfs"][0].get("multiscatter", False)
    assert multiscatter(type="roughconductor", alpha_u=0.4, alpha_v=0.1)
    assert multiscatter(type="roughdielectric", alpha_u=0.4, alpha_v=0.4)
    assert not multiscatter(type="roughdielectric", alpha_u=0.4, alpha_v=0.2)
    assert not multiscatter(type="roughdielectric", alpha_u=0.4)
    assert not multiscatter(type="principled")


class Bitmap:
    """What a bitmap of Mitsuba shows of itself."""

    def __init__(self, pixels: np.ndarray, *, encoded: bool) -> None:
        self.pixels, self.encoded = pixels, encoded

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        return self.pixels

    def srgb_gamma(self) -> bool:
        return self.encoded


@pytest.mark.parametrize("encoded", [False, True])
@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_bitmaps_of_mitsuba_tell_their_encoding(kind: type, encoded: bool) -> None:
    """128 of 255 is 0.2159 where it is encoded, on surfaces and around the scene."""
    top = {np.uint8: 255, np.uint16: 65535, np.float32: 1}[kind]
    bitmap = Bitmap(np.full((2, 4, 3), 128 / 255 * top).astype(kind), encoded=encoded)
    wanted = 0.2159 if encoded else 0.502
    facing = np.diag([-10.0, 10.0, -1.0, 1.0])
    facing[2, 3] = 3
    glow = {"type": "area", "radiance": {"type": "bitmap", "bitmap": bitmap}}
    for light in (
        {"type": "envmap", "bitmap": bitmap},
        {"type": "rectangle", "to_world": facing, "emitter": glow},
    ):
        scene = scene_with(
            integrator={"type": "path", "max_depth": 1},
            sensor={"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
            light=light,
        )
        np.testing.assert_allclose(lajolla.load_dict(scene).render(spp=1).array, wanted, rtol=2e-3)


def test_a_bitmap_and_a_file_are_too_much() -> None:
    twice = {"type": "bitmap", "bitmap": np.zeros((2, 2)), "filename": "a.png"}
    ball = {"type": "sphere", "bsdf": {"type": "diffuse", "reflectance": twice}}
    with pytest.raises(lajolla.SceneError, match="takes one of"):
        describe(scene_with(ball=ball))


def test_objects_of_mitsuba_are_refused() -> None:
    """They hold no properties that could be read; bitmaps, arrays and transforms are taken."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    with pytest.raises(lajolla.SceneError, match=r"scene\[ball\].*Shape cannot be part of a scene"):
        describe(scene_with(ball=mitsuba.load_dict({"type": "sphere"})))
    pixels = np.random.default_rng(0).random((4, 4, 3), np.float32)
    texture = {"type": "bitmap", "bitmap": mitsuba.Bitmap(pixels)}
    moved = mitsuba.ScalarTransform4f().translate([1, 2, 3])
    plate = {"type": "rectangle", "to_world": moved, "bsdf": {"type": "diffuse", "reflectance": texture}}
    core = describe(scene_with(plate=plate)).core
    np.testing.assert_array_equal(np.array(core["shapes"][0]["to_world"])[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(core["textures"][0]["image"].bounds(), [pixels.min(), pixels.max()])
