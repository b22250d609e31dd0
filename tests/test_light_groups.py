"""Light groups: the picture by lights. The layers add up to the picture, and each is what the lights of its
group alone make of the scene.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tools import check_same_mean, look_at, rotation, scaling, translation

import lajolla
from lajolla import _core, cli
from lajolla.aovs import WITH_GROUPS
from lajolla.scene import convert

Scene = dict[str, Any]

SIZE, SAMPLES, BATCHES = 12, 16, 16
GREY = {"type": "twosided", "inner": {"type": "diffuse", "reflectance": 0.6}}
CHECKS = {"type": "checkerboard", "color0": 0.5, "color1": 4.0}
GLOSSY = {"type": "roughconductor", "alpha": 0.2}
LEAF = {"type": "mask", "opacity": 0.6, "inner": GREY}


def rectangle(*matrices: np.ndarray, **parts: object) -> Scene:
    return {"type": "rectangle", "to_world": np.linalg.multi_dot([*matrices, np.eye(4)]), **parts}


def down(x: float, y: float, **parts: object) -> Scene:
    """A small rectangle that faces down."""
    return rectangle(translation(x, y, 0), rotation((1, 0, 0), 90), scaling(0.4), **parts)


# Every kind of light, by the name of its group; two are in the same one.
LIGHTS: dict[str, tuple[str, Scene]] = {
    "lamp": ("warm", down(-1, 2, emitter={"type": "area", "radiance": {"type": "rgb", "value": [9, 5, 2]}})),
    "screen": ("", down(1, 2, emitter={"type": "area", "radiance": CHECKS})),
    "ball": ("warm", {"type": "sphere", "center": [0, 1, 1], "radius": 0.2, "emitter": {"type": "area"}}),
    "bulb": ("cool", {"type": "point", "position": [0, 3, -2], "intensity": 8.0}),
    "sun": ("sun", {"type": "sun", "sun_direction": [0.5, 1, 0.5], "turbidity": 3.0, "scale": 0.05}),
    "sky": ("sky-1", {"type": "constant", "radiance": {"type": "rgb", "value": [0.1, 0.2, 0.4]}}),
}
GROUPS = ("rest", "warm", "cool", "sun", "sky-1")


def in_group(light: Scene, group: str) -> Scene:
    if "emitter" in light:
        return {**light, "emitter": {**light["emitter"], "lightgroup": group}}
    return {**light, "lightgroup": group}


def dark(light: Scene) -> Scene:
    """What is left of a light that is off: its shape."""
    return {**light, "emitter": {"type": "area", "radiance": 0.0}} if "emitter" in light else {}


def scene_of(names: list[str], integrator: Scene, *, leaf: bool = True, fog: bool = False) -> Scene:
    shapes = {
        "floor": rectangle(rotation((1, 0, 0), -90), scaling(3), bsdf=GREY),
        "block": {"type": "cube", "to_world": translation(0.6, 0.4, 0) @ scaling(0.4), "bsdf": GLOSSY},
    }
    if leaf:
        shapes["leaf"] = rectangle(translation(-0.7, 0.8, 0), scaling(0.5), bsdf=LEAF)
    if fog:
        flame = {"type": "homogeneous", "sigma_t": 0.4, "albedo": 0.5, "emission": 0.3}
        shapes["fog"] = {
            "type": "sphere",
            "center": [0, 1, 0],
            "radius": 1.2,
            "bsdf": {"type": "null"},
            "interior": flame,
        }
    return {
        "type": "scene",
        "integrator": integrator,
        "sensor": {
            "type": "perspective",
            "to_world": look_at((0, 2, -5), (0, 0.8, 0)),
            "film": {"type": "hdrfilm", "width": SIZE, "height": SIZE},
        },
        **shapes,
        **{
            name: shown
            for name, (group, light) in LIGHTS.items()
            if (shown := in_group(light, group) if name in names else dark(light))
        },
    }


def load(integrator: Scene, names: list[str] | None = None, **options: Any) -> lajolla.Scene:  # noqa: ANN401
    scene = scene_of(list(LIGHTS) if names is None else names, integrator, **options)
    aovs = ["lightgroups"] if names is None else []
    return lajolla.load_dict(scene, aovs=aovs, spp=SAMPLES)


def layers(image: lajolla.Image) -> dict[str, np.ndarray]:
    arrays = image.arrays()
    return {name: arrays[f"lightgroup_{name}"] for name in GROUPS}


INTEGRATORS: list[tuple[str, Scene, dict[str, bool]]] = [
    ("path", {"type": "path", "max_depth": 4}, {}),
    ("opaque", {"type": "path", "max_depth": 4}, {"leaf": False}),
    ("hidden", {"type": "path", "max_depth": 4, "hide_emitters": True}, {}),
    ("bsdf", {"type": "path", "max_depth": 3, "strategy": "bsdf"}, {}),
    ("volpath", {"type": "volpath", "max_depth": 4}, {"fog": True}),
    ("direct", {"type": "direct", "emitter_samples": 2, "bsdf_samples": 3}, {}),
]


@pytest.mark.parametrize(("integrator", "options"), [row[1:] for row in INTEGRATORS], ids=lambda x: None)
def test_layers_add_up_to_the_picture(integrator: Scene, options: dict[str, bool]) -> None:
    scene = load(integrator, **options)
    image = scene.render(seed=1)
    parts = layers(image)
    np.testing.assert_allclose(sum(parts.values()), image.array, rtol=2e-5, atol=1e-6)
    seen = {name for name, part in parts.items() if part.any()}
    assert seen >= {*GROUPS} - {"sun"}
    assert "sun" in seen or integrator.get("strategy") == "bsdf"  # whose paths hardly hit it
    # They change no bit of the picture, and are the same in lanes and one by one, on any number of threads.
    plain = lajolla.load_dict(scene_of(list(LIGHTS), integrator, **options), spp=SAMPLES)
    assert plain.render(seed=1).array.tobytes() == image.array.tobytes()
    renders = [_core.Render(scene.core, 1) for _ in range(2)]
    renders[0].advance(SAMPLES, threads=1, one_lane=True)
    renders[1].advance(SAMPLES, threads=2)
    assert renders[0].image().tobytes() == renders[1].image().tobytes()


@pytest.mark.parametrize("name", GROUPS)
@pytest.mark.parametrize(
    ("integrator", "options"), [INTEGRATORS[i][1:] for i in (0, 4, 5)], ids=lambda x: None
)
def test_a_layer_is_what_its_lights_make(name: str, integrator: Scene, options: dict[str, bool]) -> None:
    """Statistically: which lights are sampled depends on all of them."""
    if name == "rest" and options.get("fog"):
        pytest.skip("the emission of the medium is in it, and cannot be removed from the others")
    group = "" if name == "rest" else name
    alone = load({**integrator}, [light for light, (own, _) in LIGHTS.items() if own == group])
    if options.get("fog"):
        options = {**options}
        alone = without_emission(integrator, group)
    together = load(integrator, **options)
    a = [layers(together.render(seed=seed))[name].mean() for seed in range(BATCHES)]
    b = [alone.render(seed=100 + seed).array.mean() for seed in range(BATCHES)]
    check_same_mean(name, np.array(a), np.array(b))


def without_emission(integrator: Scene, group: str) -> lajolla.Scene:
    scene = scene_of([light for light, (own, _) in LIGHTS.items() if own == group], integrator, fog=True)
    scene["fog"]["interior"]["emission"] = 0.0
    return lajolla.load_dict(scene, spp=SAMPLES)


def test_lights_in_instances_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = """<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="4"/><integer name="height" value="4"/></film></sensor>
        <shape type="shapegroup" id="g"><shape type="sphere"><emitter type="area">
        <string name="lightgroup" value="left"/></emitter></shape></shape>
        <shape type="instance"><ref id="g"/><transform name="to_world"><translate z="4"/></transform></shape>
        <emitter type="constant"><string name="lightgroup" value="{}"/></emitter></scene>"""
    path = tmp_path / "scene.xml"
    path.write_text(text.format("sky"))
    out = tmp_path / "a.npz"
    assert (
        cli.main(["render", str(path), "--spp", "4", "--quiet", "--aov", "lightgroups", "-o", str(out)]) == 0
    )
    with np.load(out) as file:
        assert set(file) == {"rgb", "lightgroup_rest", "lightgroup_left", "lightgroup_sky"}
        left = file["lightgroup_left"]
        assert left[1:3, 1:3].min() > 0.5 and not file["lightgroup_rest"].any()
    assert "lightgroup" not in convert(path, tmp_path / "out.xml").text
    assert cli.main(["list", "emitter", "point"]) == 0
    assert "lightgroup" in capsys.readouterr().out
    for name, message in (("a b", "is no name of a light group"), ("rest", "is no name of a light group")):
        path.write_text(text.format(name))
        with pytest.raises(lajolla.SceneError, match=message):
            lajolla.load(path)


def test_scenes_without_groups() -> None:
    path = {"type": "path"}
    plain = scene_of(["screen"], path)
    with pytest.raises(lajolla.OptionError, match="no emitter of the scene has a lightgroup"):
        lajolla.load_dict(plain, aovs=["lightgroups"])
    for integrator in ("ao", "depth"):
        with pytest.raises(lajolla.OptionError, match=r"the integrator '\w+' has no light groups"):
            lajolla.load_dict(scene_of(["lamp"], {"type": integrator}), aovs=["lightgroups"])
    for integrator in WITH_GROUPS:
        lajolla.load_dict(scene_of(["lamp"], {"type": integrator}), aovs=["lightgroups"])
