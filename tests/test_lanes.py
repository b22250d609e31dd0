"""Many paths in the lanes of vectors give the bits that one path after the other gives.

What is right is judged elsewhere, and mostly of lanes; here all of it is compared with the same code for
single numbers: elementary functions, BSDFs, and pictures of everything that there is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scatter_tools import MODELS, Settings, label, settings_of, values_of
from scene_tools import (
    area,
    box_mesh,
    look_at,
    make_scene,
    rotation,
    scaling,
    torus,
    translation,
    uv_sphere,
)
from statistics_tools import ONE_MINUS_ULP, SEED, generator, uniforms
from test_every_scene import FOLDER, scene_files

from lajolla import _core, _core_testing
from lajolla.options import Options, apply_options
from lajolla.scene import load_description

OWN = Path(__file__).resolve().parents[1] / "scenes"
SCHEMA = _core.schema()


def equal(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal bits, but for those of what is not a number."""
    if a.dtype != np.float32:
        return np.array_equal(a, b)
    numbers = ~np.isnan(a)
    return np.array_equal(numbers, ~np.isnan(b)) and np.array_equal(
        a[numbers].view(np.uint32), b[numbers].view(np.uint32)
    )


# --- Elementary functions -------------------------------------------------------------------------------

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
COUNT = 200_001
SMALLEST, LARGEST = 1.1754944e-38, 3.4028235e38  # of normal numbers
SPECIAL = [0, 1e-45, 1e-39, SMALLEST, 1e-20, 0.5, 1, 2, 87.2, 87.4, 88.7, 88.8, 103, 1e10, LARGEST, np.inf]
SPECIAL = np.array([*SPECIAL, *(-x for x in SPECIAL), np.nan], np.float32)
ONE_ARGUMENT = (
    "exp",
    "log",
    "sin",
    "cos",
    "acos",
    "log1p",
    "expm1",
    "tan",
    "tanh",
    "sqrt",
    "floor",
    "to_int",
    "isfinite",
)
TWO_ARGUMENTS = ("pow", "atan2", "min", "max", "copysign")


def elementary(name: str, x: np.ndarray, y: np.ndarray | None = None) -> np.ndarray:
    """A function of the core, after a look at whether it is the same in lanes."""
    x = np.ascontiguousarray(x, np.float32)
    y = np.zeros_like(x) if y is None else np.ascontiguousarray(y, np.float32)
    result = _core_testing.elementary(name, x, y)
    assert equal(result, _core_testing.elementary(name, x, y, one_lane=True)), name
    return result


def within(low: float, high: float) -> np.ndarray:
    return generator("within", low, high).uniform(low, high, COUNT).astype(np.float32)


def of_all_sizes(low: float, high: float) -> np.ndarray:
    """Positive numbers, as many of each order of magnitude."""
    return np.exp(generator("sizes", low, high).uniform(np.log(low), np.log(high), COUNT)).astype(np.float32)


def of_both_signs(low: float, high: float) -> np.ndarray:
    return of_all_sizes(low, high) * generator("signs", low, high).choice([-1, 1], COUNT)


def spacing(values: np.ndarray) -> np.ndarray:
    """Units in the last place of single precision numbers of this size."""
    return np.spacing(np.maximum(np.abs(values), SMALLEST).astype(np.float32)).astype(float)


# Largest errors in units in the last place.
ACCURACY: dict[str, tuple[str, np.ndarray, Function, float]] = {
    "exp": ("exp", within(-87.2, 88.7), lambda x, y: np.exp(x), 1.2),
    "exp of small numbers": ("exp", of_both_signs(1e-10, 1), lambda x, y: np.exp(x), 1.2),
    "log": ("log", of_all_sizes(SMALLEST, LARGEST), lambda x, y: np.log(x), 1.2),
    "log near one": ("log", 1 + of_both_signs(1e-7, 0.5), lambda x, y: np.log(x), 1.2),
    "log1p": ("log1p", of_all_sizes(1e-10, 1e30), lambda x, y: np.log1p(x), 3),
    "log1p of negative numbers": ("log1p", -of_all_sizes(1e-10, 0.9999), lambda x, y: np.log1p(x), 3),
    "expm1": ("expm1", of_both_signs(1e-10, 80), lambda x, y: np.expm1(x), 3),
    "tan": ("tan", of_both_signs(1e-10, 1.5), lambda x, y: np.tan(x), 4),
    "tanh": ("tanh", of_both_signs(1e-10, 80), lambda x, y: np.tanh(x), 4),
    "acos": ("acos", within(-1, 1), lambda x, y: np.arccos(x), 4),
    "acos near one": ("acos", 1 - of_all_sizes(1e-7, 0.1), lambda x, y: np.arccos(x), 4),
}


@pytest.mark.parametrize("name", ACCURACY)
def test_elementary_functions(name: str) -> None:
    function, x, expected, most = ACCURACY[name]
    expected = expected(x.astype(np.float32).astype(float), x)
    assert (np.abs(elementary(function, x) - expected) / spacing(expected)).max() < most


@pytest.mark.parametrize("largest", [1, 100, 5000])
def test_sine_and_cosine(largest: float) -> None:
    """Within 1e-7 wherever their zeros are; small angles have sines of full precision."""
    x = within(-largest, largest)
    for name, function in (("sin", np.sin), ("cos", np.cos)):
        assert np.abs(elementary(name, x) - function(x.astype(float))).max() < 1e-7
    x = of_both_signs(1e-30, 0.7)
    assert (np.abs(elementary("sin", x) - np.sin(x.astype(float))) / spacing(np.sin(x))).max() < 1.5


def test_atan2() -> None:
    y, x = of_both_signs(1e-20, 1e20), of_both_signs(1e-19, 1e19)
    for b, a in ((y, x), (within(-1, 1), within(-1, 1.5)), (x * np.float32(1.0001), x)):
        a, b = a.astype(np.float32), b.astype(np.float32)
        expected = np.arctan2(b.astype(float), a.astype(float))
        assert (np.abs(elementary("atan2", b, a) - expected) / spacing(expected)).max() < 4


def test_pow() -> None:
    """The error grows with the exponent of e: y log(x) is rounded before it becomes one."""
    for x, y in ((of_all_sizes(1e-6, 1e6), within(-5, 5)), (within(0.01, 1), within(0, 15))):
        expected = x.astype(float) ** y.astype(float)
        exponent = np.abs(y * np.log(x.astype(float)))
        assert (np.abs(elementary("pow", x, y) - expected) / spacing(expected) / (1 + exponent)).max() < 2.5


def test_lanes_of_elementary_functions_on_special_values() -> None:
    for name in ONE_ARGUMENT:
        elementary(name, SPECIAL)
    first, second = (values.ravel() for values in np.meshgrid(SPECIAL, SPECIAL))
    for name in TWO_ARGUMENTS:
        elementary(name, first, second)


def test_special_values() -> None:
    inf, nan, tiny = np.inf, np.nan, 1e-39
    for name, x, expected in (
        ("exp", [0, -0.0, -inf, -88, -1e30, 89, inf, nan, tiny], [1, 1, 0, 0, 0, inf, inf, nan, 1]),
        ("log", [0, -0.0, tiny, 1, inf, -1, -inf, nan], [-inf, -inf, -inf, 0, inf, nan, nan, nan]),
        ("sin", [0, -0.0, tiny, -tiny, inf, nan], [0, -0.0, tiny, -tiny, nan, nan]),
        ("cos", [0, -0.0, tiny, -inf, nan], [1, 1, 1, nan, nan]),
        ("acos", [1, 1.001, 0, -1, -1.001], [0, 0, np.pi / 2, np.pi, np.pi]),
        ("log1p", [0, -0.0, tiny, -tiny, -1, -2, nan], [0, -0.0, tiny, -tiny, -inf, nan, nan]),
        ("expm1", [0, -0.0, tiny, -tiny, -inf, inf, nan], [0, -0.0, tiny, -tiny, -1, inf, nan]),
    ):
        np.testing.assert_array_equal(elementary(name, np.array(x)), np.float32(expected), err_msg=name)
    y, x = (
        np.float32([0, -0.0, 0, -0.0, 1, -1, 2, inf, -inf]),
        np.float32([0, 0, -0.0, -1, 0, -0.0, inf, 1, 1]),
    )
    np.testing.assert_allclose(elementary("atan2", y, x), np.arctan2(y, x), rtol=1e-6)
    x, y = np.float32([0, 0, 2, inf, 0, nan, 1e30]), np.float32([0, 2, 0, -1, -1, 0, 2])
    np.testing.assert_array_equal(elementary("pow", x, y), np.float32([1, 0, 1, 0, inf, 1, inf]))


def test_minima_and_maxima_are_those_of_the_standard_library() -> None:
    """Of a number and a NaN, and of two zeros, the first operand."""
    a, b = (values.ravel() for values in np.meshgrid(SPECIAL, SPECIAL))
    assert equal(elementary("min", a, b), np.where(b < a, b, a))
    assert equal(elementary("max", a, b), np.where(a < b, b, a))


# --- BSDFs ----------------------------------------------------------------------------------------------


def directions(count: int, *key: object) -> np.ndarray:
    """Anywhere on the sphere, some of them grazing, horizontal or along the normal."""
    rng = generator("directions", count, *key)
    w = rng.normal(size=(count, 3))
    w[5::7, 2] *= 1e-3
    w[6::11, 2] = 0
    w[3::13] = 0, 0, 1
    return (w / np.linalg.norm(w, axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize("name", MODELS)
def test_bsdfs(name: str) -> None:
    """Counts fill the lanes of the last vector, or leave most of them off; numbers reach their bounds."""
    for settings in settings_of(name):
        bsdf = _core.Bsdf(settings)
        if not bsdf.wide:
            pytest.skip("written for one path")
        for count in (1, 7, 37, 200):
            wo, wi = directions(count, "wo", label(settings)), directions(count, "wi", label(settings))
            if not bsdf.transmissive:
                wo[:, 2] = np.abs(wo[:, 2])
            u = uniforms(generator("lanes", label(settings), count), count, 3)
            u[3::9, 0], u[4::9, 1], u[5::9, 2] = 0, ONE_MINUS_ULP, 0
            draws, alone = bsdf.sample_many(wo, u), bsdf.sample_many(wo, u, one_lane=True)
            valid = alone["valid"]
            for key, values in draws.items():
                same = equal(values[valid], alone[key][valid]) if key != "valid" else equal(values, valid)
                assert same, f"{label(settings)}: {key}"
            sampled = np.where(valid[:, None], draws["wi"], wi)
            for points in (wi, sampled, -wo):
                ours, ones = bsdf.eval_many(wo, points), bsdf.eval_many(wo, points, one_lane=True)
                assert all(map(equal, ours, ones)), label(settings)


# --- Pictures -------------------------------------------------------------------------------------------

SIZE = (40, 30)
SPP = 4


def picture(scene: _core.Scene, passes: tuple[int, ...], threads: int, one_lane: bool) -> np.ndarray:
    render = _core.Render(scene, SEED)
    for samples in np.cumsum(passes):
        assert render.advance(int(samples), threads, one_lane)
    assert render.nonfinite == 0, render.nonfinite_list
    return render.image()


def check_lanes(scene: _core.Scene) -> np.ndarray:
    """The same picture in lanes, on one or two threads and in any passes, as of one path after the other."""
    expected = picture(scene, (SPP,), 2, True)
    np.testing.assert_array_equal(picture(scene, (SPP,), 2, False), expected)
    np.testing.assert_array_equal(picture(scene, (1, SPP - 1), 1, False), expected)
    return expected


NOISE = generator("noise of lanes").integers(0, 256, (13, 17, 3)).astype(np.uint8)
PAINTED: Settings = {"type": "bitmap", "image": _core.Image(NOISE), "to_uv": scaling(2)}
HEIGHTS: Settings = {
    "type": "bitmap",
    "image": _core.Image(np.ascontiguousarray(NOISE[..., :1]), srgb=False),
}
CHECKERED: Settings = {"type": "checkerboard", "color0": 0.7, "color1": [0.2, 0.3, 0.1], "to_uv": scaling(5)}
TEXTURES = [CHECKERED, PAINTED, HEIGHTS]
FLOOR: Settings = {"type": "rectangle", "to_world": scaling(4), "material": 0}
ABOVE = translation(1, -1, 4) @ rotation((1, 0.2, 0), 190)
LAMP: Settings = {"type": "rectangle", "to_world": ABOVE @ scaling(0.7), "material": 0, "emitter": 0}
LIFTED = translation(0, 0, 1) @ rotation((1, 2, 0.5), 25)
BALL: Settings = {"type": "sphere", "to_world": LIFTED, "material": 1}
CAMERA: Settings = {"type": "perspective", "fov": 40, "to_world": look_at((0.5, -5, 2.5), (0, 0, 0.9))}


LIT: tuple[Settings, ...] = (area([9, 8, 7]), {"type": "constant", "radiance": [0.3, 0.4, 0.5]})


def stage(
    *shapes: Settings,
    lights: tuple[Settings, ...] = LIT,
    textures: tuple[Settings, ...] = (),
    bsdfs: tuple[Settings, ...] = ({"type": "roughplastic", "diffuse_reflectance": {"texture": 1}},),
    materials: tuple[Settings, ...] = ({"front": 1, "back": 1},),
    **settings: object,
) -> _core.Scene:
    """Shapes on a textured floor below a lamp. BSDFs begin with number 1, materials too, textures with 3."""
    shining = lights and lights[0]["type"] == "area"
    return make_scene(
        shapes=[FLOOR, *([LAMP] if shining else []), *shapes],
        emitters=lights,
        textures=[*TEXTURES, *textures],
        bsdfs=[{"type": "diffuse", "reflectance": {"texture": 0}}, *bsdfs],
        materials=[{"front": 0, "back": 0}, *materials],
        **{"sensor": CAMERA, "size": SIZE, "sampler": "sobol", **settings},
    )


@pytest.mark.parametrize("name", MODELS)
def test_pictures_of_models(name: str) -> None:
    """A BSDF on a smooth mesh, with a texture in every field that takes one; with other values on balls."""
    textured: Settings = {"type": name}
    textures: list[Settings] = []
    for field in MODELS[name]["fields"]:
        if field["type"].startswith("texture_"):
            low, high = (
                values_of({**field, "type": "float"})[1:3] if field["type"] == "texture_float" else (0.2, 0.9)
            )
            textured[field["name"]] = {"texture": len(TEXTURES) + len(textures)}
            textures.append({"type": "checkerboard", "color0": low, "color1": high, "to_uv": scaling(9)})
        elif field["type"] in ("measurement", "bsdf"):
            textured[field["name"]] = values_of(field)[0]
    bsdfs = (textured, *settings_of(name)[-2:])
    sides = [{"back": 1 + i} if not _core.transmissive(b) else {} for i, b in enumerate(bsdfs)]
    scene = stage(
        {**BALL, "type": "mesh", "mesh": uv_sphere(20, 10, smooth=True)},
        {**BALL, "to_world": translation(-1.6, 0.3, 0.7) @ scaling(0.7), "material": 2},
        {**BALL, "to_world": translation(1.6, 0.3, 0.7) @ scaling(0.7), "material": len(bsdfs)},
        textures=tuple(textures),
        bsdfs=bsdfs,
        materials=tuple({"front": 1 + i, **sides[i]} for i in range(len(bsdfs))),
        max_depth=6,
    )
    check_lanes(scene)


def strands() -> Settings:
    rng = generator("strands")
    points = np.cumsum(rng.normal(size=(40, 3)) * 0.3, axis=0)
    points = np.column_stack([points - points.mean(0), np.full(40, 0.1)]).astype(np.float32)
    return {
        "type": "curves",
        "curves": _core.Curves(points, np.arange(0, 37, dtype=np.uint32)),
        "basis": "bspline",
    }


def distances() -> Settings:
    axes = np.meshgrid(*[np.linspace(-1, 1, n) for n in (9, 8, 7)], indexing="ij")
    values = np.sqrt(sum(axis**2 for axis in axes)) - 0.7
    grid = _core.Grid(np.ascontiguousarray(values[..., None].astype(np.float32)))
    return {"type": "sdfgrid", "grid": grid, "to_world": LIFTED @ translation(-1, -1, -1) @ scaling(2)}


SHAPES: dict[str, Settings] = {
    "rectangle": {"type": "rectangle", "to_world": LIFTED @ rotation((1, 0, 0), 80)},
    "disk": {"type": "disk", "to_world": LIFTED @ rotation((1, 0, 0), 80), "flip_normals": True},
    "sphere": {"type": "sphere"},
    "cylinder": {"type": "cylinder", "p1": [0.3, 0.2, 0.8], "radius": 0.6},
    "mesh": {"type": "mesh", "mesh": torus(16, 9)},
    "smooth mesh": {"type": "mesh", "mesh": uv_sphere(12, 7, smooth=True)},
    "mesh of faces": {
        "type": "mesh",
        "mesh": box_mesh(),
        "to_world": LIFTED @ scaling(0.7),
        "face_normals": True,
    },
    "curves": strands(),
    "sdfgrid": distances(),
}
DARK = ("curves", "sdfgrid")


def test_everything_is_pictured() -> None:
    assert {shape["type"] for shape in SHAPES.values()} == set(SCHEMA["shape"])
    assert {light["type"] for light in LIGHTS.values()} | {"area"} == set(SCHEMA["emitter"])
    on_faces = {"ptex"}  # in scenes/subdivision.xml
    assert {texture["type"] for texture in TEXTURED.values()} == set(SCHEMA["texture"]) - on_faces
    assert {tree["type"] for trees in TREES.values() for tree in trees} == set(SCHEMA["adapter"])
    assert set(SENSORS) == set(SCHEMA["sensor"])


@pytest.mark.parametrize("place", ["by itself", "in instances"])
@pytest.mark.parametrize("name", SHAPES)
def test_pictures_of_shapes(name: str, place: str) -> None:
    """Seen and, where they can be, shining; by itself or in a group that stands there twice."""
    shape = {"to_world": LIFTED, "material": 1, **SHAPES[name]}
    if place == "by itself":
        check_lanes(stage(shape))
        if name not in DARK:
            check_lanes(stage({**shape, "emitter": 2}, lights=(*LIT, area({"texture": 1}))))
        return
    description = {
        "textures": TEXTURES,
        "bsdfs": [{"type": "diffuse", "reflectance": {"texture": 0}}, {"type": "plastic"}],
        "materials": [{"front": 0, "back": 0}, {"front": 1, "back": 1}],
        "emitters": list(LIT),
        "shapes": [FLOOR, LAMP, shape],
        "groups": [{"shapes": [2]}],
        "instances": [
            {"group": 0, "to_world": translation(-1, 0, 0) @ scaling(0.8)},
            {"group": 0, "to_world": translation(1.2, 0.5, 0) @ scaling(0.5, -0.9, 0.7)},
        ],
        "sensor": CAMERA,
        "film": {"width": SIZE[0], "height": SIZE[1]},
        "integrator": {"type": "path"},
    }
    check_lanes(_core.Scene(description))


HIGH = translation(-1, -2, 4) @ look_at((0, 0, 0), (1, 2, -3))
SKIES = generator("skies").random((2, 8, 16, 3), np.float32) ** 4 * 5
LIGHTS: dict[str, Settings] = {
    "constant": {"type": "constant", "radiance": [1, 2, 3]},
    "envmap": {"type": "envmap", "image": _core.Image(SKIES[0]), "to_world": rotation((1, 0.3, 0.2), 70)},
    "another envmap": {"type": "envmap", "image": _core.Image(SKIES[1]), "scale": 0.5},
    "distantdisk": {"type": "distantdisk", "direction": [0.3, 0.5, -1], "irradiance": 3, "angle": 5},
    "point": {"type": "point", "position": [-1, -2, 3], "intensity": [9, 8, 20]},
    "directional": {"type": "directional", "direction": [0.2, 0.4, -1], "irradiance": [1, 2, 3]},
    "spot": {"type": "spot", "intensity": 40, "to_world": HIGH, "texture": {"texture": 1}},
    "projector": {"type": "projector", "irradiance": {"texture": 1}, "scale": 30, "to_world": HIGH},
}


@pytest.mark.parametrize("name", LIGHTS)
def test_pictures_by_lights(name: str) -> None:
    """Each by itself, and one of several."""
    assert check_lanes(stage(BALL, lights=(LIGHTS[name],))).max() > 0
    check_lanes(stage(BALL, lights=(*LIT, LIGHTS[name])))


def test_picture_by_all_lights() -> None:
    check_lanes(stage(BALL, {**BALL, "to_world": LIFTED @ translation(1, 1, 1) @ scaling(0.4), "emitter": 2},
                      lights=(*LIT, area([1, 5, 1]), *LIGHTS.values())))  # fmt: skip


TEXTURED: dict[str, Settings] = {
    "checkerboard": CHECKERED,
    "bitmap": PAINTED,
    "nearest": {**PAINTED, "filter_type": "nearest", "wrap_mode": "mirror"},
    "bitmap with footprints": {**PAINTED, "filter_type": "ewa", "to_uv": scaling(30)},
    "trilinear bitmap": {**PAINTED, "filter_type": "trilinear", "wrap_mode": "clamp", "to_uv": scaling(30)},
    "gridtexture": {"type": "gridtexture", "line_width": 0.1, "color1": {"texture": 1}},
    "scale": {"type": "scale", "texture": {"texture": 0}, "scale": {"texture": 1}},
    "clamped": {"type": "clamped", "texture": {"texture": 1}, "low": 0.3, "high": 0.6},
    "mesh_attribute": {"type": "mesh_attribute", "name": "vertex_color"},
    "wireframe": {"type": "wireframe", "line_width": 0.05},
    "curvature": {"type": "curvature", "curvature": "mean", "scale": 0.3},
}


@pytest.mark.parametrize("name", TEXTURED)
def test_pictures_of_textures(name: str) -> None:
    """Seen directly, in a mirror and behind glass, where footprints are those of bounces."""
    check_lanes(seen_in_a_mirror_and_glass(TEXTURED[name]))


@pytest.mark.parametrize("footprint", ["differentials", "cone"])
@pytest.mark.parametrize("alpha", [0.0, 0.05, 0.4])
@pytest.mark.parametrize("filter_type", ["ewa", "trilinear"])
def test_pictures_of_footprints(filter_type: str, alpha: float, footprint: str) -> None:
    """In mirrors so rough that some differentials, or all, end there."""
    texture = {**PAINTED, "filter_type": filter_type, "to_uv": scaling(30)}
    rough = {"type": "roughconductor", "alpha_u": alpha, "alpha_v": alpha}
    check_lanes(seen_in_a_mirror_and_glass(texture, rough, footprint=footprint))


def seen_in_a_mirror_and_glass(
    texture: Settings, reflector: Settings | None = None, **integrator: object
) -> _core.Scene:
    seen = {**BALL, "type": "mesh", "mesh": uv_sphere(12, 7, smooth=True)}
    mirror = {"type": "rectangle", "to_world": translation(0, 2, 1) @ rotation((1, 0, 0), 80), "material": 2}
    lens = {"type": "sphere", "to_world": translation(0.8, -1.5, 0.8) @ scaling(0.4), "material": 3}
    return stage(
        seen,
        mirror,
        lens,
        textures=(texture,),
        bsdfs=(
            {"type": "diffuse", "reflectance": {"texture": 3}},
            reflector or {"type": "conductor"},
            {"type": "dielectric"},
        ),
        materials=({"front": 1, "back": 1}, {"front": 2, "back": 2}, {"front": 3}),
        **integrator,
    )


CLEAR: Settings = {"type": "thindielectric", "specular_transmittance": [0.9, 0.6, 0.3]}
TREES: dict[str, list[Settings]] = {
    "mask": [{"type": "mask", "opacity": 0.6, "child": 1}],
    "mask by a texture": [{"type": "mask", "opacity": {"texture": 2}, "child": 1}],
    "blend": [{"type": "blendbsdf", "weight": {"texture": 2}, "first": 1, "second": 2}],
    "blend with a sheet": [{"type": "blendbsdf", "weight": 0.4, "first": 3, "second": 2}],
    "bumps": [{"type": "bumpmap", "map": {"texture": 2}, "scale": 0.4, "child": 2}],
    "normals": [{"type": "normalmap", "normalmap": {"texture": 1}, "child": 1}],
    "all of them": [
        {"type": "mask", "opacity": {"texture": 2}, "child": 3},
        {"type": "blendbsdf", "weight": 0.4, "first": {"adapter": 0}, "second": 2},
        {"type": "normalmap", "normalmap": {"texture": 1}, "child": {"adapter": 1}},
        {"type": "bumpmap", "map": {"texture": 2}, "scale": 0.2, "child": {"adapter": 2}},
    ],
}
STRATEGIES = ("mis", "bsdf", "light")


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("name", TREES)
def test_pictures_of_adapters(name: str, strategy: str) -> None:
    """A ball with a tree of materials in it, before another whose sides differ, and behind a sheet."""
    sheet = {
        "type": "rectangle",
        "to_world": translation(0.5, -2, 1) @ rotation((1, 0, 0), 70),
        "material": 3,
    }
    tree = {"adapter": len(TREES[name]) - 1}
    scene = stage(
        BALL,
        {**BALL, "to_world": translation(1, 1.5, 1), "material": 2},
        sheet,
        bsdfs=({"type": "diffuse"}, {"type": "roughconductor", "alpha_u": 0.3, "alpha_v": 0.1}, CLEAR),
        adapters=TREES[name],
        materials=({"front": tree, "back": tree}, {"front": tree, "back": 1}, {"front": 3}),
        strategy=strategy,
    )
    check_lanes(scene)


@pytest.mark.parametrize("leaves", [2, 3, 4, 5, 8])
def test_blends_that_fill_the_picture(leaves: int) -> None:
    """Every path sends a shadow ray for each BSDF that is blended, if these are few: the most of them."""
    greys = tuple({"type": "diffuse", "reflectance": 0.2 + 0.1 * i} for i in range(leaves))
    blends: list[Settings] = [
        {"type": "blendbsdf", "weight": 0.4, "first": {"adapter": i - 1} if i else 1, "second": 2 + i}
        for i in range(leaves - 1)
    ]
    scene = stage(
        {"type": "sphere", "to_world": scaling(20), "flip_normals": True, "material": 1},
        lights=(*LIT[:1], LIGHTS["point"]),
        bsdfs=greys,
        adapters=blends,
        materials=({"front": {"adapter": leaves - 2}},),
        sensor={**CAMERA, "to_world": look_at((0, -5, 2.5), (0, -10, 6))},
    )
    assert check_lanes(scene).min() > 0


@pytest.mark.parametrize("hide_emitters", [False, True])
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_settings_of_the_integrator(strategy: str, hide_emitters: bool) -> None:
    """Paths of any length, with roulette from the start or late, among lamps that are hidden or masked."""
    for max_depth, rr_depth, sheets in itertools.product((0, 1, 2, 5, -1), (0, 3), (False, True)):
        scene = stage(
            BALL,
            {"type": "rectangle", "to_world": translation(-1, -1, 1) @ rotation((1, 0, 0), 75), "emitter": 2,
             "material": 2},
            lights=(*LIT, area([2, 3, 1])),
            bsdfs=({"type": "roughdielectric", "alpha_u": 0.2, "alpha_v": 0.2}, CLEAR),
            adapters=[{"type": "mask", "opacity": 0.5, "child": 0}],
            materials=({"front": 1}, {"front": {"adapter": 0} if sheets else 0}),
            strategy=strategy,
            hide_emitters=hide_emitters,
            max_depth=max_depth,
            rr_depth=rr_depth,
        )  # fmt: skip
        check_lanes(scene)


SENSORS: dict[str, Settings] = {
    "perspective": {**CAMERA, "principal_point_offset_x": 0.1, "near_clip": 3, "far_clip": 7},
    "thinlens": {**CAMERA, "aperture_radius": 0.2, "focus_distance": 4},
    "orthographic": {"to_world": CAMERA["to_world"] @ scaling(2)},
    "telecentric": {"to_world": CAMERA["to_world"] @ scaling(2), "aperture_radius": 0.2, "focus_distance": 4},
    "spherical": {"to_world": CAMERA["to_world"]},
    "radiancemeter": {"to_world": CAMERA["to_world"]},
    "distant": {"to_world": rotation((1, 0, 0), 150)},
}


@pytest.mark.parametrize("sampler", list(SCHEMA["sampler"]))
@pytest.mark.parametrize("name", SENSORS)
def test_pictures_of_sensors(name: str, sampler: str) -> None:
    """With filters by turns, some of them with negative lobes. Whole pictures hold those of crop windows."""
    rfilter = list(SCHEMA["rfilter"])[list(SENSORS).index(name) % len(SCHEMA["rfilter"])]
    size = (1, 1) if name == "radiancemeter" else SIZE
    settings: Settings = {"sensor": {**SENSORS[name], "type": name}, "rfilter": {"type": rfilter}}
    whole = check_lanes(stage(BALL, sampler=sampler, size=size, **settings))
    if size == SIZE:
        x, y, width, height = 7, 3, 19, 23
        film = {"crop_offset_x": x, "crop_offset_y": y, "crop_width": width, "crop_height": height}
        crop = check_lanes(stage(BALL, sampler=sampler, film=film, **settings))
        np.testing.assert_array_equal(crop, whole[y : y + height, x : x + width])


def test_infinite_samples_are_the_same() -> None:
    """A lamp that shines through another is brighter than floats are."""
    front: Settings = {"type": "rectangle", "emitter": 2, "material": 1}
    scene = stage(
        {**front, "to_world": translation(0, -1, 1) @ rotation((1, 0, 0), 90)},
        {**front, "to_world": translation(0, 0, 1) @ rotation((1, 0, 0), 90), "emitter": 3},
        lights=(*LIT, area([2.5e38, 1, 0]), area([2.5e38, 1, 0])),
        adapters=[{"type": "mask", "opacity": 0.3, "child": 1}],
        materials=({"front": {"adapter": 0}},),
    )
    renders = [_core.Render(scene, SEED) for _ in range(2)]
    for render, one_lane in zip(renders, (False, True), strict=True):
        assert render.advance(SPP, 2, one_lane)
    ours, ones = renders
    assert ours.nonfinite == ones.nonfinite > 0
    assert ours.nonfinite_list == ones.nonfinite_list
    np.testing.assert_array_equal(ours.image(), ones.image())


# --- Scenes ---------------------------------------------------------------------------------------------

OWN_SCENES = sorted(OWN.glob("*.xml"))


def check_scene(path: Path) -> None:
    """With the integrator that it asks for, and with path tracing alone."""
    core = apply_options(load_description(path).core, Options(size=SIZE, spp=SPP))
    check_lanes(_core.Scene(core))
    given = core["integrator"]
    known = {field["name"] for field in SCHEMA["integrator"]["path"]["fields"]}
    path_tracing = {"type": "path", **{key: value for key, value in given.items() if key in known}}
    if given["type"] != "path":
        check_lanes(_core.Scene({**core, "integrator": path_tracing}))


@pytest.mark.parametrize("path", scene_files(), ids=lambda path: str(path.relative_to(FOLDER)))
def test_public_scenes(path: Path) -> None:
    check_scene(path)


@pytest.mark.parametrize("path", OWN_SCENES, ids=lambda path: path.name)
def test_own_scenes(path: Path) -> None:
    check_scene(path)
