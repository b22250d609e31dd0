"""Shadows at the terminator of smooth meshes, and the weights of vertex normals (docs/shading-normals.md)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scene_tools import (
    Settings,
    area,
    batch_means,
    check_mean,
    check_same_mean,
    front_view,
    look_at,
    make_scene,
    rotation,
    scaling,
    translation,
    uv_sphere,
)
from statistics_tools import generator
from test_lanes import BALL, CLEAR, TREES, check_lanes, stage

import lajolla
from lajolla import _core, cli
from lajolla.scene import Description, SceneError, load_description

MODES = ("none", "hanika", "chiang")
COARSE = uv_sphere(16, 8, smooth=True)
MESH: Settings = {"type": "mesh", "mesh": COARSE, "material": 0}
WHITE: Settings = {"type": "diffuse", "reflectance": 1}
SKY: Settings = {"type": "constant", "radiance": 1}
NORMALS: Settings = {"type": "field", "field": "sh_normal"}
SUN = np.array([-1, 0.5, 0.5]) / np.sqrt(1.5)


def ball(mode: str, *shapes: Settings, **settings: object) -> _core.Scene:
    """The coarse sphere, or other shapes, seen from above."""
    materials = [{"front": 0, "back": 0, "terminator": mode}]
    found = {"bsdfs": [WHITE], "sensor": front_view(4, 2), "materials": materials, **settings}
    return make_scene(shapes=shapes or (MESH,), **found)


def picture(scene: _core.Scene, samples: int) -> np.ndarray:
    render = _core.Render(scene, 0)
    assert render.advance(samples)
    return render.image().astype(float)


# --- The terminator -------------------------------------------------------------------------------------


def errors_at_the_terminator(*shapes: Settings, mode: str = "none") -> tuple[float, float]:
    """How much darker than a true sphere with the same normals the band before the terminator is, and the
    mean deviation; relative to the brightness of the band, where the cosine is below 0.3."""
    sun: Settings = {"type": "directional", "direction": SUN.tolist(), "irradiance": np.pi}
    common = {"emitters": [sun], "size": (128, 128)}
    lit = picture(ball(mode, *shapes, **common, max_depth=2), 16)[..., 0]
    cosine = -picture(ball(mode, *shapes, **common, **NORMALS), 16) @ SUN
    x, y = np.meshgrid((np.arange(128) + 0.5) / 64 - 1, (np.arange(128) + 0.5) / 64 - 1)
    band = (cosine < 0.3) & (cosine > -0.1) & (x**2 + y**2 < 0.75)
    wrong = lit[band] - np.maximum(cosine[band], 0)
    brightness = np.maximum(cosine[band], 0).mean()
    return float(wrong.mean() / brightness), float(np.abs(wrong).mean() / brightness)


def test_a_coarse_sphere_has_the_terminator_of_a_true_one() -> None:
    sphere: Settings = {"type": "sphere", "material": 0}
    assert np.abs(errors_at_the_terminator(sphere)).max() < 2e-3
    found = {mode: errors_at_the_terminator(mode=mode) for mode in MODES}
    print(found)  # the numbers in docs/shading-normals.md
    # Means of six seeds, and five times the standard deviation of one.
    expected = {"none": (-0.0613, 0.0017), "hanika": (0.00032, 0.00006), "chiang": (-0.1907, 0.0043)}
    for mode, (mean, error) in expected.items():
        assert found[mode][0] == pytest.approx(mean, abs=error)
        assert found[mode][1] == pytest.approx(abs(mean), abs=error + 0.0005)  # some points are brighter


def test_mirrors_have_no_terminator() -> None:
    """Their picture shows the way that light takes, which is not in the shadow of a triangle."""
    mirror: Settings = {"type": "conductor", "eta": 0, "k": 1}
    pictures = [
        picture(ball(mode, bsdfs=[mirror], emitters=[SKY], max_depth=2), 4) for mode in ("none", "chiang")
    ]
    np.testing.assert_array_equal(*pictures)


def test_no_triangle_is_black_before_the_terminator() -> None:
    """Of one sample in every pixel: there are neither shadows of the mesh on itself nor halos."""
    sun: Settings = {"type": "directional", "direction": SUN.tolist(), "irradiance": np.pi}
    for columns, rows in ((8, 4), (16, 8), (40, 20)):
        mesh = {**MESH, "mesh": uv_sphere(columns, rows, smooth=True)}
        common = {"emitters": [sun], "size": (160, 160), "rfilter": {"type": "box", "radius": 1e-3}}
        lit = picture(ball("hanika", mesh, **common, max_depth=2), 1)[..., 0]
        normals = picture(ball("hanika", mesh, **common, **NORMALS), 1)
        expected = np.maximum(-normals @ SUN, 0)
        facing = normals[..., 2] > 0.1  # others are bent towards the viewer
        np.testing.assert_allclose(lit[facing], expected[facing], atol=2e-5)


@pytest.mark.parametrize("mode", MODES)
def test_white_furnace(mode: str) -> None:
    """No light is gained. Triangles lose what is scattered into them; moved rays lose nothing."""
    scene = ball(mode, emitters=[SKY], sensor=front_view(4, 1.2))
    batches = batch_means(scene, 256)
    print(mode, 1 - batches.mean())
    # Of sixteen times as many samples; these are known to 0.0001.
    check_mean(mode, batches, {"none": 0.99623, "hanika": 1, "chiang": 0.97657}[mode], slack=1e-4)


SHADED: dict[str, tuple[list[Settings], dict[str, object]]] = {
    "diffuse": ([WHITE], {}),
    "plastic": ([{"type": "roughplastic", "alpha": 0.3}], {}),
    "metal": ([{"type": "roughconductor", "alpha_u": 0.3, "alpha_v": 0.3}], {}),
    "rough glass": ([{"type": "roughdielectric", "alpha_u": 0.4, "alpha_v": 0.4}], {"back": -1}),
    "leaf": ([{"type": "difftrans"}], {"back": -1}),
    "one side": ([WHITE], {"back": -1}),
}


@pytest.mark.parametrize("mode", ["hanika", "chiang"])
@pytest.mark.parametrize("name", SHADED)
def test_strategies_agree(name: str, mode: str) -> None:
    """Lights in front, behind and within, as samples of lights and of BSDFs find them."""
    bsdfs, sides = SHADED[name]
    lamps = [translation(3, 1, -0.5), translation(-2.5, -1, -2.5), scaling(0.3)]
    shapes = [
        MESH,
        *({"type": "sphere", "to_world": m @ scaling(0.7), "emitter": i} for i, m in enumerate(lamps)),
    ]
    materials = [{"front": 0, "back": 0, "terminator": mode, **sides}]
    means = {}
    for strategy in ("mis", "light", "bsdf"):
        scene = ball(
            mode,
            *shapes,
            bsdfs=bsdfs,
            materials=materials,
            emitters=[area(), area(), area(0.2), {**SKY, "radiance": 0.1}],
            strategy=strategy,
            max_depth=5,
        )
        means[strategy] = batch_means(scene, 128)
    check_same_mean(f"{name}: mis and light", means["mis"], means["light"])
    check_same_mean(f"{name}: mis and bsdf", means["mis"], means["bsdf"])


@pytest.mark.parametrize("strategy", ["light", "bsdf"])
def test_strategies_agree_in_fog(strategy: str) -> None:
    """A ball in a medium, filled with another."""
    media = [
        {"type": "homogeneous", "sigma_a": 0.08, "sigma_s": 0.32},
        {"type": "homogeneous", "sigma_a": 0.2, "sigma_s": 1.8},
    ]
    room = {"type": "sphere", "to_world": scaling(3), "material": 1, "interior": 0}
    shapes = [{**MESH, "interior": 1, "exterior": 0}, room]
    means = []
    for each in ("mis", strategy):
        core = {
            "bsdfs": [{"type": "roughdielectric", "alpha_u": 0.5, "alpha_v": 0.5}, {"type": "null"}],
            "materials": [{"front": 0, "terminator": "hanika"}, {"front": 1}],
            "media": media,
            "shapes": shapes,
            "emitters": [{**SKY, "radiance": 0.5}],
            "sensor": {**front_view(2, 2), "medium": 0},
            "film": {"width": 8, "height": 8},
            "rfilter": {"type": "box"},
            "sampler": {"type": "independent"},
            "integrator": {"type": "volpath", "max_depth": 6, "strategy": each},
        }
        means.append(batch_means(_core.Scene(core), 64))
    check_same_mean("fog", *means)


def smooth_positions(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points on the coarse sphere at barycentric weights (N, 3) in each triangle, and where rays start there,
    if nothing is in the way."""
    corners = np.asarray(COARSE.vertices, float)[COARSE.faces]
    points = np.einsum("nk,fkc->fnc", weights, corners)
    heights = np.einsum("fnkc,fkc->fnk", corners[:, None] - points[:, :, None], corners)
    lifts = np.einsum("nk,fnk,fkc->fnc", weights, np.maximum(heights, 0), corners)
    return points.reshape(-1, 3), (points + lifts).reshape(-1, 3)


def test_a_closed_mesh_lets_no_light_through() -> None:
    """Neither outwards nor inwards, where the surface is convex, concave, or touches another one."""
    flat = {"type": "rectangle", "to_world": translation(0, 0, -1) @ scaling(5), "material": 0}
    lamp = {"type": "sphere", "to_world": scaling(0.2), "emitter": 0}
    inside = {**MESH, "to_world": scaling(1, 1, 0.3)}
    dark = ball("hanika", inside, lamp, emitters=[area(100)], max_depth=6)
    assert picture(dark, 64).max() == 0
    below: Settings = {"type": "directional", "direction": [0.03, 0.3, 1], "irradiance": 100}
    lowered = {**flat, "to_world": translation(0, 0, -0.55) @ scaling(5)}
    close = {
        "type": "orthographic",
        "to_world": look_at((0, -4, -0.52), (0, 0, -0.53)) @ scaling(0.02, 0.02, 1),
    }
    points, starts = smooth_positions(generator("points").dirichlet((1, 1, 1), 200))
    seen = (points[:, 2] > -0.548) & (points[:, 2] < -0.508)
    assert np.mean(starts[seen, 2] < -0.55) > 0.1  # they would be below the ground
    for ground, sensor in ((flat, front_view(4, 2)), (lowered, close)):
        shaded = ball("hanika", MESH, ground, emitters=[below], sensor=sensor, size=(32, 32), max_depth=6)
        assert picture(shaded, 64).max() == 0
    hollow = ball(
        "hanika", MESH, emitters=[SKY], sensor={**front_view(0.2, 1), "type": "orthographic"}, max_depth=8
    )
    assert picture(hollow, 64).max() == 0


def test_features_are_those_that_paths_see() -> None:
    """A mirror close to a grey floor: what misses the sky finds the floor, and no ray starts below it."""
    floor = {"type": "rectangle", "to_world": translation(0, 0, -0.55) @ scaling(5), "material": 1}
    close = {
        "type": "orthographic",
        "to_world": look_at((0, -4, -0.52), (0, 0, -0.53)) @ scaling(0.02, 0.02, 1),
    }
    common = {
        "bsdfs": [{"type": "conductor", "eta": 0, "k": 1}, {"type": "diffuse", "reflectance": 0.25}],
        "materials": [{"front": 0, "back": 0, "terminator": "hanika"}, {"front": 1, "back": -1}],
        "sensor": close,
        "size": (32, 32),
    }
    sky = picture(ball("", MESH, floor, emitters=[SKY], max_depth=2, **common), 64)
    above: Settings = {"type": "directional", "direction": [0, 0, 1], "irradiance": 1}
    features = {"type": "features", "feature": "albedo", "emitters": [above]}
    albedo = picture(ball("", MESH, floor, **features, **common), 64)
    print(sky.mean(), albedo.mean())
    np.testing.assert_allclose(albedo, 0.25 * (1 - sky), atol=1e-5)


@pytest.mark.parametrize("bsdf", [{"type": "roughdielectric", "alpha_u": 0.3, "alpha_v": 0.3}, WHITE])
def test_true_surfaces_and_flat_meshes_need_no_more_rays(bsdf: Settings) -> None:
    """They have no smooth positions: the same bits, of as many rays."""
    shapes = [
        {"type": "sphere", "to_world": scaling(0.5), "material": 0},
        {"type": "rectangle", "to_world": translation(0, 0, -0.7), "material": 0},
        {
            "type": "mesh",
            "mesh": uv_sphere(8, 4, smooth=False),
            "to_world": translation(0.6, 0, 0),
            "material": 0,
        },
    ]
    renders = []
    for mode in ("none", "hanika"):
        materials = [{"front": 0, "back": -1, "terminator": mode}]
        renders.append(
            _core.Render(ball(mode, *shapes, bsdfs=[bsdf], materials=materials, emitters=[SKY]), 0)
        )
        assert renders[-1].advance(16)
    assert renders[0].rays == renders[1].rays
    np.testing.assert_array_equal(*(render.image() for render in renders))


# --- Lanes ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["hanika", "chiang"])
@pytest.mark.parametrize("strategy", ["mis", "bsdf", "light"])
def test_lanes(mode: str, strategy: str) -> None:
    """The same bits for single paths: meshes, mirrored, in instances, in trees, of several materials."""
    mesh = {**BALL, "type": "mesh", "mesh": uv_sphere(12, 7, smooth=True)}
    moved = [translation(0.9 * i, 0.7 * i, 0) @ BALL["to_world"] @ scaling(0.6) for i in (-2, -1, 1, 2)]
    shapes = [
        {**mesh, "to_world": moved[0], "flip_normals": True},
        {**mesh, "to_world": moved[1], "material": 2},
        {**mesh, "to_world": moved[2], "material": 3},
        {**BALL, "to_world": moved[3]},
        {**mesh, "to_world": np.eye(4)},
    ]
    placed = translation(0, 0, 1) @ rotation((1, 0, 1), 40) @ scaling(0.8, 1.1, -0.6)
    scene = stage(
        *shapes,
        groups=[{"shapes": [len(shapes) + 1]}],
        instances=[{"group": 0, "to_world": placed}],
        bsdfs=(
            {"type": "roughdielectric", "alpha_u": 0.3, "alpha_v": 0.3},
            {"type": "roughconductor", "alpha_u": 0.2, "alpha_v": 0.2},
            CLEAR,
        ),
        adapters=TREES["all of them"],
        materials=(
            {"front": 1, "terminator": mode},
            {"front": {"adapter": 3}, "back": 2, "terminator": mode},
            {"front": 2, "back": 0, "terminator": mode},
        ),
        strategy=strategy,
    )
    check_lanes(scene)


def test_other_scenes_need_no_lifts() -> None:
    """Materials without the property have the same bits beside others with it."""
    far: Settings = {**MESH, "to_world": translation(0, 0, 50), "material": 1}
    pictures = []
    for mode in MODES:
        materials = [{"front": 0, "back": 0}, {"front": 0, "back": 0, "terminator": mode}]
        scene = ball("none", MESH, far, emitters=[SKY], materials=materials, max_depth=4)
        pictures.append(picture(scene, 4))
    for each in pictures[1:]:
        np.testing.assert_array_equal(each, pictures[0])


# --- The property ---------------------------------------------------------------------------------------

SCENE = """<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"/>
<emitter type="constant"/>{}</scene>"""


def described(content: str, tmp_path: Path) -> Description:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(content))
    return load_description(path, strict=True)


def terminators(description: Description) -> list[str]:
    return [entry.get("terminator", "none") for entry in description.core["materials"]]


def said(mode: str) -> str:
    return f'<string name="terminator" value="{mode}"/>'


def test_defaults(tmp_path: Path) -> None:
    """Files look as in Mitsuba; dicts are smooth, also where the bsdf is missing."""
    shape = '<shape type="sphere">{}</shape>'
    content = shape.format("") + shape.format('<bsdf type="conductor"/>')
    assert terminators(described(content, tmp_path)) == ["none", "none"]
    content = shape.format(f'<bsdf type="plastic">{said("chiang")}</bsdf>')
    assert terminators(described(content, tmp_path)) == ["chiang"]

    dark: Settings = {"type": "diffuse", "terminator": "none"}
    scene = lajolla.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path"},
            "sky": {"type": "constant"},
            "bare": {"type": "sphere"},
            "a": {"type": "sphere", "bsdf": {"type": "plastic"}},
            "b": {"type": "sphere", "bsdf": dark},
        }
    )
    assert [scene.params[f"{name}.bsdf.terminator"] for name in ("bare", "a", "b")] == [
        "hanika",
        "hanika",
        "none",
    ]


def test_bsdfs_inside_others(tmp_path: Path) -> None:
    """The outermost one counts; if it says nothing, those inside, which have to agree."""
    grey = '<bsdf type="diffuse">{}</bsdf>'
    shape = '<shape type="sphere"><bsdf type="{}">{}</bsdf></shape>'

    def found(plugin: str, *inside: str) -> list[str]:
        return terminators(described(shape.format(plugin, "".join(inside)), tmp_path))

    assert found("twosided", grey.format(said("hanika"))) == ["hanika"]
    assert found("twosided", grey.format(said("hanika")), said("chiang")) == ["chiang"]
    assert found("mask", grey.format(said("hanika"))) == ["hanika"]
    assert found("blendbsdf", grey.format(said("chiang")), grey.format("")) == ["chiang"]
    blend = grey.format(said("chiang")), grey.format(said("none"))
    with pytest.raises(SceneError, match='have the terminators "chiang" and "none"'):
        found("blendbsdf", *blend)
    assert found("blendbsdf", *blend, said("none")) == ["none"]


def test_unknown_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.xml"
    bsdf = f'<bsdf type="diffuse">\n{said("hanica")}</bsdf>'
    path.write_text(SCENE.format(f'<shape type="sphere">{bsdf}</shape>'))
    assert cli.main(["check", str(path)]) == 1
    error = capsys.readouterr().err
    assert f"{path}:3:" in error and 'did you mean "hanika"?' in error and "Traceback" not in error
    with pytest.raises(_core.DescriptionError, match=r"materials\[0\]\.terminator"):
        ball("smooth")


def test_listing(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("diffuse", "twosided", "roughconductor"):
        assert cli.main(["list", "bsdf", name]) == 0
        assert "one of none, hanika, chiang" in capsys.readouterr().out


def test_runs(tmp_path: Path) -> None:
    """Shapes that are read together have the materials of those read one by one."""
    one = '<shape type="sphere"><point name="center" x="{0}" y="0" z="5"/><bsdf type="diffuse">{1}' + (
        '<rgb name="reflectance" value="{2}, 0, 0"/></bsdf></shape>'
    )
    content = "\n".join(one.format(i, said("hanika"), i / 10) for i in range(9))
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(content))
    whole, single = (load_description(path, runs=runs) for runs in (True, False))
    for description in (whole, single):
        scene = _core.Scene(description.core)
        assert scene.summary()["bsdfs"] == 9
    assert whole.core["materials"][0]["terminator"] == "hanika"
    assert terminators(single) == ["hanika"] * 9


def loaded(content: str, tmp_path: Path) -> lajolla.Scene:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE.format(content))
    return lajolla.load(path, size=(16, 16))


TWO = """<bsdf type="diffuse" id="red"/><shape type="sphere" id="a"><ref id="red"/></shape>
<shape type="sphere" id="b"><point name="center" x="3"/><bsdf type="twosided"><ref id="red"/></bsdf></shape>
<shape type="sphere" id="c"><bsdf type="plastic"/></shape>"""


def test_parameters(tmp_path: Path) -> None:
    scene = loaded(TWO, tmp_path)
    assert scene.params["red.terminator"] == scene.params["c.bsdf.terminator"] == "none"
    assert scene.params.field("red.terminator").choices == MODES
    other = scene.with_params({"red.terminator": "hanika"})
    assert terminators(other.description) == ["hanika", "hanika", "none"]
    assert other.params["red.terminator"] == "hanika" and scene.params["red.terminator"] == "none"
    back = other.with_params({"red.terminator": "none"})
    assert back.description.core["materials"] == scene.description.core["materials"]
    with pytest.raises(lajolla.SceneError, match="hanika"):
        scene.with_params({"red.terminator": "hanica"})
    scene["c.bsdf"] = {"type": "conductor"}
    assert scene.params["c.bsdf.terminator"] == "hanika"


def test_saving(tmp_path: Path) -> None:
    scene = loaded(TWO, tmp_path)
    scene["red.terminator"] = "hanika"
    scene["c.bsdf.terminator"] = "chiang"
    scene.save(tmp_path / "saved.xml")
    saved = lajolla.load(tmp_path / "saved.xml", size=(16, 16))
    assert terminators(saved.description) == ["hanika", "hanika", "chiang"]
    saved["c.bsdf"] = {"type": "conductor"}
    saved["red.terminator"] = "none"
    saved.save(tmp_path / "again.xml")
    again = lajolla.load(tmp_path / "again.xml")
    assert terminators(again.description) == ["none", "none", "hanika"]


def test_saving_what_two_sides_say(tmp_path: Path) -> None:
    """A bsdf inside another one that sets the property, in place or by reference."""
    inside = f'<bsdf type="twosided" id="red">{said("hanika")}<bsdf type="diffuse"/></bsdf>'
    grey, both = (
        '<bsdf type="diffuse" id="grey"/>',
        f'<bsdf type="twosided">{said("chiang")}<ref id="grey"/></bsdf>',
    )
    shapes = f'<shape type="sphere">{inside}</shape><shape type="sphere" id="b">{both}</shape>'
    scene = loaded(grey + shapes, tmp_path)
    assert terminators(scene.description) == ["hanika", "chiang"]
    scene["red.terminator"] = "none"
    scene["grey.terminator"] = "hanika"
    scene.save(tmp_path / "saved.xml")
    assert terminators(lajolla.load(tmp_path / "saved.xml").description) == ["none", "hanika"]


def test_conversion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Mitsuba has no such thing."""
    path = tmp_path / "scene.xml"
    path.write_text(
        SCENE.format(f'<shape type="sphere"><bsdf type="diffuse">{said("hanika")}</bsdf></shape>')
    )
    assert cli.main(["convert", str(path), str(tmp_path / "new.xml")]) == 0
    assert 'Mitsuba 3 does not support "terminator" of bsdf "diffuse"' in capsys.readouterr().err
    assert "terminator" not in (tmp_path / "new.xml").read_text()


# --- Weights of vertex normals --------------------------------------------------------------------------

WEIGHTS = ("angle", "area", "max")


def fan(corners: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Triangles around a vertex; all points are on the unit sphere."""
    around = (np.arange(corners) + 0.45 * rng.random(corners)) / corners * 2 * np.pi
    down = rng.uniform(0.2, 0.9, corners)
    rim = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], 1)
    faces = [(0, 1 + i, 1 + (i + 1) % corners) for i in range(corners)]
    return np.concatenate([[[0, 0, 1]], rim]), np.array(faces)


@pytest.mark.parametrize("size", [1e-10, 1, 1e10])
def test_weights_on_spheres(size: float) -> None:
    """Max's weights give the normal of any mesh whose vertices are on a sphere; the others are off."""
    rng = generator("fans")
    errors = {name: [] for name in WEIGHTS}
    for corners in [*range(3, 9)] * 50:
        vertices, faces = fan(corners, rng)
        mesh = _core.Mesh((vertices * size).astype(np.float32), faces.astype(np.uint32))
        for name in WEIGHTS:
            normal = mesh.with_vertex_normals(np.eye(4).tolist(), name).normals[0].astype(float)
            errors[name].append(np.degrees(np.arctan2(np.hypot(*normal[:2]), normal[2])))
    found = {name: float(np.sqrt(np.mean(np.square(errors[name])))) for name in WEIGHTS}
    print(found)  # the numbers in docs/shading-normals.md
    assert found["max"] < 1e-4
    assert 1 < found["angle"] < found["area"]


def test_weights_at_hard_edges() -> None:
    vertices, faces = fan(5, generator("fan"))
    mesh = _core.Mesh(vertices.astype(np.float32), faces.astype(np.uint32))
    smooth = mesh.with_smooth_normals(np.eye(4).tolist(), 180, "max")
    np.testing.assert_allclose(smooth.normals[0], [0, 0, 1], atol=1e-6)
    assert not np.allclose(mesh.with_smooth_normals(np.eye(4).tolist(), 180).normals[0], [0, 0, 1], atol=1e-3)


def ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = fan(6, generator("file"))
    lines = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property float {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(repr, map(float, row))) for row in vertices]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")
    return vertices, faces


def normals_of(scene: lajolla.Scene) -> np.ndarray:
    return np.asarray(scene.params["mesh.normals"])


@pytest.mark.parametrize("name", WEIGHTS)
def test_hard_edges_are_those_of_the_world(name: str, tmp_path: Path) -> None:
    """If no edge is hard, the normals are those of smooth meshes, also of one that is stretched."""
    ply(tmp_path / "fan.ply")
    shape = """<shape type="ply" id="mesh"><string name="filename" value="fan.ply"/>
        <string name="normal_weights" value="{}"/>{}
        <transform name="to_world"><scale x="1" y="3" z="0.5"/></transform></shape>"""
    smooth = loaded(shape.format(name, ""), tmp_path)
    angle = '<float name="max_smooth_angle" value="180"/>'
    hard = loaded(shape.format(name, angle), tmp_path)
    np.testing.assert_allclose(normals_of(hard)[0], normals_of(smooth)[0], atol=1e-6)
    flat = loaded(shape.format(name, angle.replace("180", "0")), tmp_path)
    assert len(normals_of(flat)) == 18


def test_weights_are_parameters_of_computed_normals(tmp_path: Path) -> None:
    ply(tmp_path / "fan.ply")
    file = '<shape type="ply" id="mesh"><string name="filename" value="{}"/>{}</shape>'
    angle = '<float name="max_smooth_angle" value="30"/>'
    own = Path(__file__).resolve().parent.parent / "scenes" / "meshes" / "coarse-sphere.ply"
    for content in (
        file.format("fan.ply", angle),
        file.format(own, ""),
        '<shape type="cube" id="mesh"/>',
    ):
        scene = loaded(content, tmp_path)
        assert "mesh.normal_weights" not in scene.params
        with pytest.raises(lajolla.ParamError, match="the normals of mesh are not computed"):
            scene["mesh.normal_weights"] = "area"
    flat = loaded(file.format("fan.ply", '<boolean name="face_normals" value="true"/>'), tmp_path)
    flat["mesh.normal_weights"] = "max"
    flat["mesh.face_normals"] = False
    np.testing.assert_allclose(normals_of(flat)[0], [0, 0, 1], atol=1e-6)


def test_weights_of_files_and_arrays(tmp_path: Path) -> None:
    """Changes of the placement, of vertices and of the weights give what a scene read anew has."""
    vertices, faces = ply(tmp_path / "fan.ply")
    shape = '<shape type="ply" id="mesh"><string name="filename" value="fan.ply"/>{}</shape>'
    weights = '<string name="normal_weights" value="{}"/>'
    scenes = {name: loaded(shape.format(weights.format(name)), tmp_path) for name in WEIGHTS}
    assert np.array_equal(normals_of(scenes["angle"]), normals_of(loaded(shape.format(""), tmp_path)))
    np.testing.assert_allclose(normals_of(scenes["max"])[0], [0, 0, 1], atol=1e-6)

    def from_arrays(name: str, points: np.ndarray = vertices, matrix: object = None) -> lajolla.Scene:
        mesh = {"type": "mesh", "positions": points, "triangles": faces, "normal_weights": name}
        mesh |= {} if matrix is None else {"to_world": matrix}
        return lajolla.load_dict(
            {"type": "scene", "sky": {"type": "constant"}, "mesh": mesh, "integrator": {"type": "path"}}
        )

    for name in WEIGHTS:
        assert np.array_equal(normals_of(from_arrays(name)), normals_of(scenes[name]))
        assert scenes[name].params["mesh.normal_weights"] == name
        for other in WEIGHTS:
            changed = scenes[name].with_params({"mesh.normal_weights": other})
            assert np.array_equal(normals_of(changed), normals_of(scenes[other]))
        moved = vertices * [1, 2, 1]
        changed = scenes[name].with_params({"mesh.positions": moved})
        assert np.array_equal(normals_of(changed), normals_of(from_arrays(name, moved)))
        stretched = scaling(1, 3, 0.5)
        changed = scenes[name].with_params({"mesh.to_world": stretched})
        assert np.array_equal(normals_of(changed), normals_of(from_arrays(name, matrix=stretched)))
        saved = tmp_path / f"{name}.xml"
        changed.save(saved)
        assert np.array_equal(normals_of(lajolla.load(saved)), normals_of(changed))


def test_weights_that_change_nothing_or_are_unknown(tmp_path: Path) -> None:
    ply(tmp_path / "fan.ply")
    shape = '<shape type="ply"><string name="filename" value="fan.ply"/>{}{}</shape>'
    weights = '<string name="normal_weights" value="{}"/>'
    flat = '<boolean name="face_normals" value="true"/>'
    with pytest.warns(lajolla.SceneWarning, match='"normal_weights" of shape "ply" changes nothing'):
        loaded(shape.format(weights.format("max"), flat), tmp_path)
    with pytest.raises(SceneError, match='did you mean "angle"'):
        loaded(shape.format(weights.format("angel"), ""), tmp_path)


def test_weights_are_converted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Mitsuba computes others: the mesh is written with its normals."""
    ply(tmp_path / "fan.ply")
    path, target = tmp_path / "scene.xml", tmp_path / "new.xml"
    weights = '<string name="normal_weights" value="max"/>'
    path.write_text(
        SCENE.format(
            f'<shape type="ply" id="mesh"><string name="filename" value="fan.ply"/>{weights}</shape>'
        )
    )
    assert cli.main(["convert", str(path), str(target)]) == 0
    assert "Mitsuba 3" not in capsys.readouterr().err
    np.testing.assert_allclose(normals_of(lajolla.load(target)), normals_of(lajolla.load(path)), atol=1e-6)
