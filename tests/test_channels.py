"""What is rendered beside red, green and blue: variables of the first surface, moments, alpha; and the
integrators that follow no paths. The oracle is the mitsuba package, channel by channel and pixel by pixel.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from oracle import RELATIVE_ALLOWANCE
from scene_tools import (
    Settings,
    area,
    batch_means,
    check_mean,
    check_same_mean,
    front_view,
    look_at,
    make_scene,
    picture,
    scaling,
    translation,
)
from scipy import stats

import lajolla
from lajolla import _core
from lajolla.scene.description.plugins.integrators import VARIABLES

# What the oracle knows, but for indices: it counts shapes, and the triangles of its own, in another order.
AOVS = "d.y:depth, n:sh_normal,a:albedo,g:geo_normal,uv:uv,p:position,u:dp_du,v:dp_dv"
SENSOR = """<sensor type="perspective">
    <transform name="to_world"><lookat origin="0,3,-6" target="0,0.5,0" up="0,1,0"/></transform>
    <float name="fov" value="40"/><float name="near_clip" value="1e-4"/>
    <film type="hdrfilm"><string name="pixel_format" value="{}"/><rfilter type="box"/>
        <integer name="width" value="24"/><integer name="height" value="20"/></film></sensor>"""
SHAPES = """<shape type="sphere"><point name="center" x="0" y="1" z="0"/>
    <bsdf type="plastic"><rgb name="diffuse_reflectance" value="0.2 0.4 0.6"/></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/></transform>
    <bsdf type="diffuse"><texture name="reflectance" type="checkerboard">
        <rgb name="color0" value="0.1 0.2 0.3"/><rgb name="color1" value="0.7 0.6 0.5"/></texture></bsdf>
</shape>
<shape type="cube"><transform name="to_world">
        <scale value="0.5"/><rotate y="1" angle="30"/><translate x="2" y="0.5"/></transform>
    <bsdf type="roughconductor"><float name="alpha" value="0.4"/></bsdf></shape>
<shape type="disk"><transform name="to_world">
        <rotate y="1" angle="200"/><scale value="0.7"/><translate x="-2" y="0.8"/></transform>
    <bsdf type="mask"><float name="opacity" value="0.4"/>
        <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></bsdf></shape>
<shape type="rectangle"><transform name="to_world"><scale value="0.5"/><translate y="2.7"/></transform>
    <bsdf type="thindielectric"/></shape>"""
POINT = """<emitter type="point"><point name="position" x="3" y="5" z="-4"/>
    <rgb name="intensity" value="30"/></emitter>"""
CONSTANT = '<emitter type="constant"><rgb name="radiance" value="0.3 0.4 0.5"/></emitter>'
PATH = '<integrator type="path" {}><integer name="max_depth" value="3"/>{}</integrator>'
HIDE = '<boolean name="hide_emitters" value="true"/>'
CORNERS = np.array([[x, y, 0] for y in (-1, 1) for x in (-1, 1)], np.float32)
BATCHES, SAMPLES = 16, 32


def text_of(integrator: str, lights: str = POINT + CONSTANT, pixel_format: str = "rgb") -> str:
    return f'<scene version="3.0.0">{integrator}{SENSOR.format(pixel_format)}{SHAPES}{lights}</scene>'


def with_mitsuba(text: str, samples: int = SAMPLES, renders: int = 1) -> tuple[list[str], np.ndarray]:
    """Names of the channels, and independent means of renders: (BATCHES, height, width, channels)."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    scene = mi.load_string(text)
    film = scene.sensors()[0].film()
    batches = []
    for batch in range(BATCHES):
        values = 0.0
        for render in range(renders):
            mi.render(scene, spp=samples, seed=batch * renders + render)
            values = values + np.array(film.bitmap(), dtype=np.float64) / renders
        batches.append(values)
    return [field.name for field in film.bitmap().struct_()], np.stack(batches)


def with_lajolla(folder: Path, text: str) -> tuple[list[str], np.ndarray]:
    """The same by lajolla, in the channels that its EXR file would have."""
    path = folder / "scene.xml"
    path.write_text(text)
    scene = lajolla.load(path)
    batches = []
    for batch in range(BATCHES):
        image = scene.render(spp=SAMPLES, seed=batch)
        others = [values for name, values in image.channels.items() if name != "A"]
        batches.append(np.dstack([image.film.develop(image.array, image.channels), *others]))
    names = [*image.film.names, *(name for name in image.channels if name != "A")]
    return names, np.stack(batches).astype(np.float64)


def differing(ours: np.ndarray, theirs: np.ndarray) -> str:
    """What speaks against equal means of one channel: in a pixel (Welch, Bonferroni), or in all together."""
    defined = np.isfinite(theirs).all(axis=0)
    a, b = ours[:, defined], theirs[:, defined]
    scale = np.abs(b).mean()
    error = np.hypot(stats.sem(a), stats.sem(b))
    excess = np.abs(a.mean(axis=0) - b.mean(axis=0)) - RELATIVE_ALLOWANCE * (np.abs(b.mean(axis=0)) + scale)
    level = stats.t.isf(1e-4 / 2 / defined.sum(), BATCHES - 1)
    pixels = excess > level * error
    x, y = a.mean(axis=1), b.mean(axis=1)
    excess = (
        abs(x.mean() - y.mean()) - 3.5 * np.hypot(stats.sem(x), stats.sem(y)) - RELATIVE_ALLOWANCE * scale
    )
    if not pixels.any() and excess <= 0:
        return ""
    return f"{pixels.sum()} pixels differ; the mean is {x.mean():.5g}, not {y.mean():.5g}"


def check_channels(folder: Path, text: str) -> None:
    names, ours = with_lajolla(folder, text)
    expected, theirs = with_mitsuba(text)
    assert sorted(names) == sorted(expected)  # channels of a file have no order
    found = {n: differing(ours[..., i], theirs[..., expected.index(n)]) for i, n in enumerate(names)}
    assert not any(found.values()), {name: what for name, what in found.items() if what}


def test_variables(tmp_path: Path) -> None:
    """Names, order and values are those of Mitsuba 3."""
    aov = f'<integrator type="aov"><string name="aovs" value="{AOVS}"/>{PATH.format("", "")}</integrator>'
    check_channels(tmp_path, text_of(aov))


def test_steps_of_a_pixel(tmp_path: Path) -> None:
    """The oracle takes steps of a pixel over the root of the number of samples."""
    aov = '<integrator type="aov"><string name="aovs" value="x:duv_dx,y:duv_dy"/></integrator>'
    text = text_of(aov).replace(
        SHAPES, SHAPES[SHAPES.index("<shape", 1) : SHAPES.index('<shape type="disk"')]
    )
    names, ours = with_lajolla(tmp_path, text)
    _, theirs = with_mitsuba(text, samples=1, renders=SAMPLES)
    theirs[..., :3] = ours[..., :3]  # this picture shows the first variable, the oracle's nothing
    assert not any(differing(ours[..., i], theirs[..., i]) for i, _ in enumerate(names))


@pytest.mark.parametrize("pixel_format", ["rgba", "luminance"])
def test_integrators_inside_others(tmp_path: Path, pixel_format: str) -> None:
    inner = PATH.format('name="p"', "")
    moment = f'<integrator type="moment" name="m">{inner}</integrator>'
    aov = f"""<integrator type="aov"><string name="aovs" value="n:sh_normal"/>
        {moment}{PATH.format("", "")}{PATH.format("", "")}</integrator>"""
    check_channels(tmp_path, text_of(aov, pixel_format=pixel_format))


def test_moments(tmp_path: Path) -> None:
    check_channels(tmp_path, text_of(f'<integrator type="moment">{PATH.format("", "")}</integrator>'))


@pytest.mark.parametrize("hidden", ["", HIDE])
@pytest.mark.parametrize("lights", [POINT, CONSTANT])
def test_alpha(tmp_path: Path, lights: str, hidden: str) -> None:
    """Through masks and thin glass, with and without a visible background.

    Colours are not compared: without one, the oracle drops the light of paths that pass a cut-out.
    """
    text = text_of(PATH.format("", hidden), lights, "rgba")
    _, ours = with_lajolla(tmp_path, text)
    _, theirs = with_mitsuba(text)
    assert not differing(ours[..., 3], theirs[..., 3])
    assert ours[..., 3].min() == (1 if lights == CONSTANT and not hidden else 0)


def test_alpha_of_lights(tmp_path: Path) -> None:
    """A visible light covers what is behind it, a hidden one does not."""
    light = """<shape type="sphere"><emitter type="area"/></shape>"""
    for hidden, expected in (("", 1), (HIDE, 0)):
        path = tmp_path / "scene.xml"
        text = text_of(PATH.format("", hidden), light, "rgba").replace(SHAPES, "")
        path.write_text(text)
        alpha = lajolla.load(path).render(spp=4).channels["A"]
        assert alpha[12, 12] == expected and alpha[0, 0] == 0


def load(integrator: Settings, film: Settings | None = None) -> lajolla.Scene:
    size = {"type": "hdrfilm", "width": 6, "height": 4, "rfilter": {"type": "mitchell"}}
    return lajolla.load_dict(
        {
            "type": "scene",
            "integrator": integrator,
            "sensor": {"type": "perspective", "film": {**size, **(film or {})}},
            "ball": {"type": "sphere", "center": [0, 0, 5]},
            "sky": {"type": "constant"},
        }
    )


def test_every_variable_has_a_channel() -> None:
    variables = ",".join(f"{name}:{name}" for name in VARIABLES)
    image = load({"type": "aov", "aovs": variables}).render(spp=4)
    assert list(image.channels) == [f"{n}.{letter}" for n, letters in VARIABLES.items() for letter in letters]
    np.testing.assert_array_equal(image.channels["albedo.G"], image.array[..., 1])  # the picture's own
    for field in _core.schema()["integrator"]["field"]["fields"]:
        if field["name"] == "field":
            assert set(field["choices"]) == set(VARIABLES)


def test_variables_share_one_ray() -> None:
    """However many are recorded, a camera ray is traced once; beside paths too, and for alpha."""
    variables = ",".join(f"{name}:{name}" for name in VARIABLES)
    rendering = load({"type": "aov", "aovs": variables}).rendering(spp=4)
    rendering.run()
    assert rendering.accumulator.rays.sum() == 6 * 4 * 4
    paths = {"type": "path", "max_depth": 1, "hide_emitters": True}
    alone = load(paths).rendering(spp=4)
    beside = load({"type": "aov", "aovs": variables, "p": paths}, {"pixel_format": "rgba"}).rendering(spp=4)
    alone.run(), beside.run()
    assert beside.accumulator.rays.sum() == alone.accumulator.rays.sum() + 6 * 4 * 4


def test_indices() -> None:
    """Shapes count from 1 in the order of the scene, primitives from 0 in that of the mesh."""
    mesh = {"type": "mesh", "mesh": _core.Mesh(CORNERS, np.array([[0, 1, 3], [0, 3, 2]], np.uint32))}
    shapes = [{"type": "disk", "to_world": translation(0, 0, -1)}, mesh]
    view = {"shapes": shapes, "sensor": front_view(2, 2), "type": "field"}
    assert (picture(make_scene(**view, field="shape_index"), 4) == 2).all()
    assert (picture(make_scene(**view, field="shape_index", first_shape=0), 4) == 1).all()
    primitives = picture(make_scene(**view, field="prim_index"), 4)[..., 0]
    columns, rows = np.meshgrid(np.arange(8), np.arange(8))
    right, left = columns + rows > 7, columns + rows < 7
    assert {*primitives[right]} | {*primitives[left]} == {0, 1} and primitives[right].std() == 0


def test_channels_are_filtered_like_the_picture() -> None:
    """Bit for bit the same samples and weights, whatever is beside them."""
    alone = load({"type": "path"}).render(spp=16).array
    image = load({"type": "aov", "aovs": "d:depth", "p": {"type": "path"}}).render(spp=16)
    np.testing.assert_array_equal(image.array, alone)
    np.testing.assert_array_equal(image.channels["p.R"], alone[..., 0])
    depth = load({"type": "depth"}).render(spp=16).array
    np.testing.assert_array_equal(image.channels["d.T"], depth[..., 0])


def test_channels_do_not_depend_on_threads_or_passes() -> None:
    scene = load({"type": "moment", "p": {"type": "path"}}, {"pixel_format": "rgba"})
    one = scene.rendering(spp=8, threads=1)
    one.accumulator.advance(8, 1)
    parts = scene.rendering(spp=8, threads=2)
    for samples in range(2, 9, 2):
        parts.accumulator.advance(samples, 2)
    for name, values in one.image().channels.items():
        np.testing.assert_array_equal(parts.image().channels[name], values)


def test_the_variance_of_a_constant_is_zero() -> None:
    channels = (
        load({"type": "moment", "p": {"type": "path"}}, {"rfilter": {"type": "box"}}).render(spp=4).channels
    )
    corner = {name: values[0, 0] for name, values in channels.items()}
    for letter in "XYZ":
        np.testing.assert_allclose(corner[f"m2_p.{letter}"], corner[f"p.{letter}"] ** 2, rtol=1e-5)


def test_multichannel(tmp_path: Path) -> None:
    """Mitsuba 0.6's formats and names, one for each integrator."""
    path = tmp_path / "scene.xml"
    path.write_text(
        """<scene version="0.6.0"><integrator type="multichannel"><integrator type="path"/>
        <integrator type="field"><string name="field" value="shNormal"/></integrator>
        <integrator type="field"><string name="field" value="distance"/>
            <float name="undefined" value="-1"/></integrator>
        <integrator type="field"><string name="field" value="shapeIndex"/></integrator></integrator>
        <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="5"/>
        <integer name="height" value="5"/><rfilter type="box"/>
        <string name="pixelFormat" value="rgb, rgba, luminance, luminance"/>
        <string name="channelNames" value="colour, normal, distance, shape"/></film></sensor>
        <shape type="sphere"><point name="center" x="0" y="0" z="4"/></shape>
        <emitter type="constant"/></scene>"""
    )
    scene = lajolla.load(path)
    assert not scene.warnings
    channels = scene.render(spp=4).channels
    expected = "colour.R colour.G colour.B normal.R normal.G normal.B normal.A distance.Y shape.Y"
    assert " ".join(channels) == expected
    np.testing.assert_allclose(channels["distance.Y"][2, 2], 3, rtol=0.02)
    assert channels["distance.Y"][0, 0] == -1 and channels["normal.A"][0, 0] == 0
    assert channels["normal.B"][2, 2] < -0.95 and channels["shape.Y"][2, 2] == 0


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<integrator type="aov"/>', 'needs "aovs" or an integrator inside'),
        ('<integrator type="moment"/>', "needs an integrator inside"),
        ('<integrator type="multichannel"/>', "needs an integrator inside"),
        ('<integrator type="aov"><string name="aovs" value="normals"/></integrator>', "not NAME:VARIABLE"),
        (
            '<integrator type="aov"><string name="aovs" value="n:sh_norml"/></integrator>',
            'unknown variable "sh_norml"; did you mean "sh_normal"?',
        ),
        (
            '<integrator type="aov"><string name="aovs" value="n:depth,n:depth"/></integrator>',
            'two channels "n.T"',
        ),
        (
            '<integrator type="direct"><integer name="emitter_samples" value="0"/>'
            '<integer name="bsdf_samples" value="0"/></integrator>',
            "are both 0",
        ),
        (
            '<integrator type="direct"><integer name="shading_samples" value="2"/>'
            '<integer name="bsdf_samples" value="3"/></integrator>',
            'either "shading_samples" or "bsdf_samples"',
        ),
    ],
)
def test_mistakes_are_told(tmp_path: Path, body: str, message: str) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0">{body}<sensor type="perspective"/></scene>')
    with pytest.raises(lajolla.SceneError, match=message.replace("?", r"\?")):
        lajolla.load(path)


def test_the_core_checks_channels() -> None:
    with pytest.raises(_core.DescriptionError, match="there is no integrator 1"):
        _core.Scene({"channels": [{"label": "a", "source": 1}]})


def test_other_methods_are_replaced_with_one_warning(tmp_path: Path) -> None:
    for name in ("ptracer", "bdpt", "photonmapper", "pssmlt"):
        path = tmp_path / "scene.xml"
        path.write_text(
            text_of(f'<integrator type="{name}"><integer name="max_depth" value="4"/></integrator>')
        )
        scene = lajolla.load(path)
        assert [w.message for w in scene.warnings] == [f'unknown integrator "{name}"; "path" is used']


# --- Integrators that are no path tracers ---------------------------------------------------------


def room(sampler: str = "sobol", point: bool = True, **integrator: Any) -> _core.Scene:  # noqa: ANN401
    """A glossy floor with a half-transparent screen, under two lights, a point and the sky."""
    return make_scene(
        shapes=[
            {"type": "rectangle", "to_world": scaling(4), "material": 0},
            {"type": "sphere", "center": [0, 0, 1], "material": 2},
            {"type": "rectangle", "to_world": translation(1, -1, 1) @ scaling(0.5), "material": 1},
            {"type": "sphere", "center": [2.5, 0, 1.5], "radius": 0.8, "emitter": 0, "material": 0},
            {"type": "sphere", "center": [-2, 2, 2], "radius": 0.3, "emitter": 1, "material": 0},
        ],
        emitters=[
            area(2),
            area(8),
            {"type": "constant", "radiance": 0.3},
            *([{"type": "point", "position": [-2, -1, 3], "intensity": 4}] if point else []),
        ],
        bsdfs=[
            {"type": "roughplastic", "alpha": 0.2},
            {"type": "roughdielectric", "alpha_u": 0.3, "alpha_v": 0.3},
        ],
        adapters=[{"type": "mask", "opacity": 0.6, "child": 0}],
        materials=[
            {"front": 0, "back": 0},
            {"front": {"adapter": 0}, "back": {"adapter": 0}},
            {"front": 1},
        ],
        sensor={"type": "perspective", "to_world": look_at((-3, -5, 3), (0, 0, 1)), "fov": 35},
        size=(12, 12),
        sampler=sampler,
        **integrator,
    )


@pytest.mark.parametrize("hide_emitters", [False, True])
@pytest.mark.parametrize("counts", [(1, 1), (3, 1), (1, 4), (2, 0), (0, 2)])
def test_direct_light_does_not_depend_on_counts(counts: tuple[int, int], hide_emitters: bool) -> None:
    """It is what the path tracer finds with at most one bounce."""
    lights, bsdfs = counts
    strategy = {"strategy": "light" if bsdfs == 0 else "bsdf" if lights == 0 else "mis"}
    settings = {"type": "direct", "emitter_samples": lights, "bsdf_samples": bsdfs}
    point = lights > 0  # paths sample it even where they sample no other light
    path = room(point=point, max_depth=2, hide_emitters=hide_emitters, **strategy)
    direct = room(point=point, hide_emitters=hide_emitters, **settings)
    check_same_mean(f"{counts}", batch_means(direct, 64), batch_means(path, 64))


def test_more_samples_are_less_noise() -> None:
    one = np.std([picture(room("independent", type="direct"), 4, seed) for seed in range(24)], axis=0).mean()
    eight = {"type": "direct", "emitter_samples": 8, "bsdf_samples": 8}
    many = np.std([picture(room("independent", **eight), 4, seed) for seed in range(24)], axis=0).mean()
    assert many < 0.7 * one


@pytest.mark.parametrize("samples", [1, 5])
@pytest.mark.parametrize("length", [-1.0, 0.0, 1.2, 2.0, 1e6])
def test_ambient_occlusion_under_a_disk(length: float, samples: int) -> None:
    """A disk of radius 1 at height 1 hides all directions with sin^2 < 1/2 and cos > 1/length.

    Cosine-weighted directions are uniform in sin^2.
    """
    scene = make_scene(
        shapes=[
            {"type": "rectangle", "to_world": scaling(4)},
            {"type": "disk", "to_world": translation(0, 0, 1)},
        ],
        sensor=front_view(0.5, 1e-4),
        size=(2, 2),
        type="ao",
        shading_samples=samples,
        ray_length=length,
    )
    reach = length if length >= 0 else np.sqrt(4**2 + 4**2 + 0.5**2) / 2  # half of the scene's radius
    hidden = min(0.5, max(1 - 1 / reach**2, 0)) if reach > 0 else 0
    check_mean(f"{length}", batch_means(scene, 256), 1 - hidden)


def test_ambient_occlusion_is_white_where_nothing_is() -> None:
    assert (picture(make_scene(type="ao"), 1) == 1).all()
    assert "must be between 1 and 65536" in error_ao()


def error_ao() -> str:
    with pytest.raises(lajolla.SceneError) as caught:
        load({"type": "ao", "shading_samples": 0})
    return str(caught.value)
