"""lajolla against the mitsuba package: the same scene files, the same means.

Every comparison renders 16 independent batches on both sides, with fixed seeds. Channel means must agree
within three standard errors plus 0.3 %, and means of 8x8 blocks at a family-wise error of 0.1 % per scene
(see `oracle`).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from measured_tools import synthetic, write_tensors
from oracle import (
    Estimate,
    Setup,
    default_variant,
    differences,
    render_with_lajolla,
    render_with_mitsuba,
)

pytest.importorskip("mitsuba")

SETUP = Setup(max_depth=12)
SHARED = Path(__file__).resolve().parents[2] / "shared" / "scenes"

CAMERA = '<lookat origin="0.6, 2.2, 5" target="0, 0.8, 0" up="0, 1, 0"/>'
SENSOR = f"""<sensor type="perspective">
    <float name="fov" value="36"/> <transform name="to_world">{CAMERA}</transform> FILM
</sensor>"""
FILM = '<film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/></film>'
FLOOR = """<shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5 0.4 0.3"/></bsdf>
</shape>"""
SPHERE = '<shape type="sphere"><point name="center" x="0" y="1" z="0"/> BSDF </shape>'
AREA = """<shape type="rectangle">
    <transform name="to_world">
        <scale value="0.8"/><lookat origin="2.5, 4, 2" target="0, 1, 0" up="0, 1, 0"/>
    </transform>
    <emitter type="area"><rgb name="radiance" value="12 11 9"/></emitter>
</shape>"""
CONSTANT = '<emitter type="constant"><rgb name="radiance" value="0.4 0.5 0.7"/></emitter>'

GOLD = '<string name="material" value="Au"/>'
BLUE = '<rgb name="diffuse_reflectance" value="0.1 0.27 0.36"/>'
CHECKER = """<texture name="{}" type="checkerboard">
    <transform name="to_uv"><scale x="12" y="6"/></transform></texture>"""
GREY = """<texture name="{}" type="bitmap">
    <string name="filename" value="grey.png"/><boolean name="raw" value="true"/></texture>"""
NORMALS = GREY.replace("grey", "normals").format("normalmap")
RED = '<bsdf type="diffuse"><rgb name="reflectance" value="0.7 0.1 0.1"/></bsdf>'

BSDFS = {
    "diffuse": RED,
    "dielectric": '<bsdf type="dielectric"><rgb name="specular_transmittance" value="0.9 1 0.8"/></bsdf>',
    "dielectric-diamond": '<bsdf type="dielectric"><string name="int_ior" value="diamond"/></bsdf>',
    "thindielectric": '<bsdf type="thindielectric"/>',
    "roughdielectric-beckmann": '<bsdf type="roughdielectric"><float name="alpha" value="0.3"/></bsdf>',
    "roughdielectric-ggx": """<bsdf type="roughdielectric">
        <string name="distribution" value="ggx"/><float name="alpha" value="0.15"/></bsdf>""",
    "conductor": f'<bsdf type="conductor">{GOLD}</bsdf>',
    "conductor-none": '<bsdf type="conductor"><rgb name="specular_reflectance" value="0.5 0.7 0.9"/></bsdf>',
    "roughconductor-beckmann": f'<bsdf type="roughconductor">{GOLD}<float name="alpha" value="0.4"/></bsdf>',
    "roughconductor-ggx": """<bsdf type="roughconductor"><string name="distribution" value="ggx"/>
        <string name="material" value="Cr"/><float name="alpha_u" value="0.1"/>
        <float name="alpha_v" value="0.5"/></bsdf>""",
    "roughconductor-textured": f"""<bsdf type="roughconductor">{GREY.format("alpha")}
        <spectrum name="eta" value="0.789"/><spectrum name="k" value="6.15"/></bsdf>""",
    "plastic": f'<bsdf type="plastic">{BLUE}<float name="int_ior" value="1.9"/></bsdf>',
    "plastic-nonlinear": f'<bsdf type="plastic">{BLUE}<boolean name="nonlinear" value="true"/></bsdf>',
    "roughplastic": f'<bsdf type="roughplastic">{BLUE}<float name="alpha" value="0.3"/></bsdf>',
    "roughplastic-nonlinear": f"""<bsdf type="roughplastic">{BLUE}<string name="distribution" value="ggx"/>
        <float name="alpha" value="0.1"/><boolean name="nonlinear" value="true"/></bsdf>""",
    # Mitsuba mixes densities of directions with probabilities where one side of a blend is a mirror.
    "blendbsdf": f"""<bsdf type="blendbsdf"><float name="weight" value="0.3"/>
        {RED}<bsdf type="roughconductor">{GOLD}</bsdf></bsdf>""",
    "blendbsdf-textured": f"""<bsdf type="blendbsdf">{GREY.format("weight")}
        <bsdf type="twosided">{RED}</bsdf><bsdf type="roughdielectric"/></bsdf>""",
    "blendbsdf-nested": f"""<bsdf type="twosided"><bsdf type="blendbsdf">{GREY.format("weight")}
        <bsdf type="blendbsdf"><float name="weight" value="0.6"/>{RED}<bsdf type="roughplastic"/></bsdf>
        <bsdf type="roughconductor">{GOLD}<float name="alpha" value="0.4"/></bsdf></bsdf></bsdf>""",
    "bumpmap": f"""<bsdf type="bumpmap">{GREY.format("grey")}<float name="scale" value="0.3"/>{RED}</bsdf>""",
    "bumpmap-two-sided": f"""<bsdf type="twosided"><bsdf type="bumpmap">{GREY.format("grey")}
        <float name="scale" value="0.1"/><bsdf type="roughplastic">{BLUE}</bsdf></bsdf></bsdf>""",
    "bumpmap-plain": f"""<bsdf type="bumpmap">{GREY.format("grey")}<float name="scale" value="0.1"/>
        <boolean name="use_shadowing_function" value="false"/>{RED}</bsdf>""",
    "normalmap": f"""<bsdf type="normalmap">{NORMALS}{RED}</bsdf>""",
    "normalmap-two-sided": f"""<bsdf type="twosided"><bsdf type="normalmap">{NORMALS}
        {RED}</bsdf></bsdf>""",
    "principled": """<bsdf type="principled"><rgb name="base_color" value="0.8 0.4 0.1"/>
        <float name="metallic" value="0.3"/><float name="anisotropic" value="0.6"/>
        <float name="sheen" value="0.8"/><float name="clearcoat" value="1"/>
        <float name="flatness" value="0.5"/><float name="spec_tint" value="0.7"/></bsdf>""",
    "principled-glass": """<bsdf type="principled"><rgb name="base_color" value="0.8 0.9 0.7"/>
        <float name="spec_trans" value="0.8"/><float name="roughness" value="0.3"/></bsdf>""",
    "principledthin": """<bsdf type="principledthin"><rgb name="base_color" value="0.3 0.8 0.2"/>
        <float name="spec_trans" value="0.4"/><float name="diff_trans" value="1"/></bsdf>""",
    "measured": '<bsdf type="measured"><string name="filename" value="brushed.bsdf"/></bsdf>',
    "null": '<bsdf type="null"/>',
    "mask": f'<bsdf type="mask"><float name="opacity" value="0.3"/>{RED}</bsdf>',
    "mask-checkered": f'<bsdf type="mask">{CHECKER.format("opacity")}{RED}</bsdf>',
    "mask-textured": f"""<bsdf type="mask">{GREY.format("opacity")}
        <bsdf type="twosided">{RED}</bsdf></bsdf>""",
}

ENVMAP = """<emitter type="envmap">
    <string name="filename" value="sky.pfm"/> <float name="scale" value="0.8"/>
    <transform name="to_world"><rotate x="1" angle="20"/><rotate y="1" angle="75"/></transform>
</emitter>"""
EMITTERS = {
    "area-rectangle": AREA,
    # Mitsuba's light sampling takes vertex normals for the geometric ones: its estimators disagree then.
    "area-mesh": AREA.replace('type="rectangle"', 'type="obj"').replace(
        "<transform",
        '<string name="filename" value="tile.obj"/><boolean name="face_normals" value="true"/><transform',
    ),
    "area-sphere": """<shape type="sphere"><point name="center" x="1.6" y="2.6" z="1"/>
        <float name="radius" value="0.35"/>
        <emitter type="area"><rgb name="radiance" value="20 16 10"/></emitter></shape>""",
    "area-disk": AREA.replace('type="rectangle"', 'type="disk"'),
    "envmap": ENVMAP,
    "constant": CONSTANT,
    "point": """<emitter type="point"><point name="position" x="2" y="3" z="2"/>
        <rgb name="intensity" value="30 25 20"/></emitter>""",
    "directional": """<emitter type="directional"><vector name="direction" x="-1" y="-2" z="-0.6"/>
        <rgb name="irradiance" value="3 2.5 2"/></emitter>""",
    "spot": """<emitter type="spot"><rgb name="intensity" value="60 50 40"/>
        <transform name="to_world"><lookat origin="2, 4, 2" target="0, 0.6, 0.3" up="0, 1, 0"/></transform>
        <float name="cutoff_angle" value="20"/><float name="beam_width" value="12"/></emitter>""",
    "spot-textured": """<emitter type="spot"><rgb name="intensity" value="60 50 40"/>
        <texture name="texture" type="bitmap"><string name="filename" value="noise.png"/></texture>
        <transform name="to_world"><lookat origin="2, 4, 2" target="0, 0.6, 0.3" up="0, 1, 0"/></transform>
        <float name="cutoff_angle" value="25"/></emitter>""",
    "projector": """<emitter type="projector"><float name="scale" value="6"/>
        <texture name="irradiance" type="bitmap"><string name="filename" value="noise.png"/></texture>
        <transform name="to_world"><lookat origin="2, 4, 2" target="0, 0.6, 0.3" up="0, 1, 0"/></transform>
        <float name="fov" value="35"/><string name="fov_axis" value="smaller"/></emitter>""",
    "area-textured": AREA.replace(
        '<rgb name="radiance" value="12 11 9"/>',
        """<texture name="radiance" type="bitmap"><string name="filename" value="noise.png"/>
        <boolean name="raw" value="true"/></texture>""",
    ),
    "sunsky": """<emitter type="sunsky"><vector name="sun_direction" x="0.5" y="0.4" z="0.7"/>
        <transform name="to_world"><rotate x="1" angle="-90"/><rotate y="1" angle="20"/></transform>
        </emitter>""",
    "sunsky-of-a-time": """<emitter type="sunsky"><float name="turbidity" value="5.3"/>
        <rgb name="albedo" value="0.1 0.5 0.9"/><float name="sun_aperture" value="3"/>
        <integer name="month" value="11"/><float name="hour" value="11.5"/><float name="sky_scale" value="3"/>
        <float name="latitude" value="47"/><float name="longitude" value="8"/>
        <float name="timezone" value="1"/>
        <transform name="to_world"><rotate x="1" angle="-90"/></transform></emitter>""",
    "several": AREA
    + CONSTANT
    + '<emitter type="point"><point name="position" x="-2" y="3" z="2"/></emitter>',
}

TILTED = """<transform name="to_world">
    <rotate x="1" angle="-50"/><rotate y="1" angle="30"/><translate y="1"/></transform>"""
TEXTURED = f'<bsdf type="twosided"><bsdf type="diffuse">{CHECKER.format("reflectance")}</bsdf></bsdf>'
SHAPES = {
    "sphere": f'<shape type="sphere">{TILTED}{TEXTURED}</shape>',
    "sphere-flipped": f"""<shape type="sphere">{TILTED}
        <boolean name="flip_normals" value="true"/>{RED}</shape>""",
    "rectangle": f'<shape type="rectangle">{TILTED}{TEXTURED}</shape>',
    "cube": f'<shape type="cube">{TILTED}{TEXTURED}</shape>',
    "disk": f'<shape type="disk">{TILTED}{TEXTURED}</shape>',
    "cylinder": f"""<shape type="cylinder"><point name="p0" x="-1" y="0.3" z="0"/>
        <point name="p1" x="0.8" y="1.5" z="0"/>
        <float name="radius" value="0.5"/>{TEXTURED}</shape>""",
    "obj": f'<shape type="obj"><string name="filename" value="tile.obj"/>{TILTED}{TEXTURED}</shape>',
    "obj-face-normals": f"""<shape type="obj"><string name="filename" value="tile.obj"/>
        <boolean name="face_normals" value="true"/>{TILTED}{TEXTURED}</shape>""",
    "ply": f'<shape type="ply"><string name="filename" value="tile.ply"/>{TILTED}{TEXTURED}</shape>',
}

BITMAP = """<bsdf type="diffuse"><texture name="reflectance" type="bitmap">
    <string name="filename" value="noise.png"/> {} <transform name="to_uv">
    <scale x="1.7" y="2.3"/><rotate z="1" angle="25"/><translate x="0.31" y="-0.4"/></transform>
</texture></bsdf>"""
TEXTURES = {
    "repeat": BITMAP.format(""),
    "mirror": BITMAP.format('<string name="wrap_mode" value="mirror"/>'),
    "clamp": BITMAP.format('<string name="wrap_mode" value="clamp"/>'),
    "nearest": BITMAP.format('<string name="filter_type" value="nearest"/>'),
    "raw": BITMAP.format('<boolean name="raw" value="true"/>'),
}

WIDE = FILM.replace('name="height" value="32"', 'name="height" value="24"')
CROP = FILM.replace("</film>", "{}</film>").format(
    "".join(
        f'<integer name="crop_{name}" value="{value}"/>'
        for name, value in (("offset_x", 10), ("offset_y", 4), ("width", 16), ("height", 24))
    )
)
FOCUS = '<float name="aperture_radius" value="0.2"/><float name="focus_distance" value="4"/>'
SENSORS = {
    **{
        f"fov-{axis}": SENSOR.replace("FILM", f'<string name="fov_axis" value="{axis}"/>{WIDE}')
        for axis in ("x", "y", "diagonal", "smaller", "larger")
    },
    "focal-length": SENSOR.replace("FILM", WIDE).replace(
        '<float name="fov" value="36"/>', '<string name="focal_length" value="70mm"/>'
    ),
    "principal-point": SENSOR.replace(
        "FILM",
        '<float name="principal_point_offset_x" value="0.1"/>'
        f'<float name="principal_point_offset_y" value="-0.2"/>{WIDE}',
    ),
    "crop": SENSOR.replace("FILM", CROP),
    "thinlens": SENSOR.replace("perspective", "thinlens").replace("FILM", FOCUS + FILM),
    "mirror": SENSOR.replace(CAMERA, f'<scale x="-1"/>{CAMERA}').replace("FILM", WIDE),
    "clipped": SENSOR.replace(
        "FILM", f'<float name="near_clip" value="4.6"/><float name="far_clip" value="5.8"/>{FILM}'
    ),
    "orthographic": f"""<sensor type="orthographic">
        <transform name="to_world"><scale x="2" y="2"/>{CAMERA}</transform>{FILM}</sensor>""",
}


def scene_text(
    bsdf: str = RED,
    emitter: str = AREA,
    shape: str = SPHERE,
    sensor: str = SENSOR,
    floor: str = FLOOR,
) -> str:
    """One scene: a shape over a floor, a light and a camera."""
    parts = (sensor.replace("FILM", FILM), floor, shape.replace("BSDF", bsdf), emitter)
    return f'<scene version="3.0.0"><integrator type="path"/>{"".join(parts)}</scene>'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the images and meshes that the small scenes name."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    path = tmp_path_factory.mktemp("oracle")
    rng = np.random.default_rng(7)
    sky = rng.gamma(0.5, 1.0, (8, 16, 3)).astype(np.float32)
    sky[2, 5] = 40.0
    mi.Bitmap(sky).write(str(path / "sky.pfm"))
    mi.Bitmap(rng.integers(0, 256, (9, 7, 3), dtype=np.uint8)).write(str(path / "noise.png"))
    normals = rng.integers([80, 80, 180], [180, 180, 256], (12, 9, 3))
    mi.Bitmap(normals.astype(np.uint8)).write(str(path / "normals.png"))
    mi.Bitmap(rng.integers(20, 256, (8, 16, 1), dtype=np.uint8)).write(str(path / "grey.png"))
    write_tensors(path / "brushed.bsdf", synthetic(4))
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    # Little tilted: where normals lean far, Mitsuba lets light from behind such a sheet through, we do not.
    normals = [(-0.1, 0, 0.9), (0.1, 0.03, 0.9), (0.05, 0.08, 0.9), (-0.08, 0.08, 0.9)]
    uvs = [(0, 0), (1, 0), (1, 0.9), (0.1, 1)]
    lines = [
        f"{tag} {' '.join(map(str, row))}"
        for tag, rows in zip(("v", "vn", "vt"), (corners, normals, uvs), strict=True)
        for row in rows
    ]
    (path / "tile.obj").write_text("\n".join([*lines, "f 1/1/1 2/2/2 3/3/3 4/4/4\n"]))
    names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
    header = ["ply", "format ascii 1.0", "element vertex 4", *(f"property float {name}" for name in names)]
    header += ["element face 2", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(str, (*p, *n, *t))) for p, n, t in zip(corners, normals, uvs, strict=True)]
    (path / "tile.ply").write_text("\n".join([*header, *rows, "3 0 1 2", "3 0 2 3\n"]))
    return path


def check_small(folder: Path, text: str, setup: Setup = SETUP, spp: int = 1024, margin: int = 0) -> None:
    """Compares both renders of a small scene."""
    path = folder / "scene.xml"
    path.write_text(text)
    theirs = render_with_mitsuba(path, spp=spp, seed=1000, setup=setup, variant="scalar_rgb")
    ours = render_with_lajolla(path, spp=spp, seed=1, setup=setup)
    found = differences(ours.inner(margin), theirs.inner(margin))
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("mutant", "found"),
    [
        (lambda batches: batches, False),
        (lambda batches: batches * [1, 1.01, 1], True),
        (lambda batches: np.flip(batches, axis=2), True),
        (lambda batches: np.roll(batches, 1, axis=1), True),
    ],
    ids=["none", "one-percent-of-green", "mirrored", "shifted-by-a-pixel"],
)
def test_the_comparison_itself(folder: Path, mutant: Callable[[np.ndarray], np.ndarray], found: bool) -> None:
    """Two renders of the oracle agree; small errors made on purpose are seen."""
    path = folder / "scene.xml"
    path.write_text(scene_text(bsdf=TEXTURED))
    first, second = (
        render_with_mitsuba(path, spp=1024, seed=seed, setup=SETUP, variant="scalar_rgb")
        for seed in (1000, 2000)
    )
    assert bool(differences(Estimate(mutant(second.batches)), first)) is found


@pytest.mark.parametrize("emitter", ["area", "envmap"])
@pytest.mark.parametrize("name", BSDFS)
def test_bsdf(folder: Path, name: str, emitter: str) -> None:
    """The area light comes with a background: without, Mitsuba drops the light of paths through cut-outs."""
    check_small(
        folder, scene_text(bsdf=BSDFS[name], emitter=AREA + CONSTANT if emitter == "area" else ENVMAP)
    )


@pytest.mark.parametrize("name", EMITTERS)
def test_emitter(folder: Path, name: str) -> None:
    bsdf = BSDFS["roughplastic"]
    check_small(folder, scene_text(bsdf=bsdf, emitter=EMITTERS[name]))


@pytest.mark.parametrize("name", SHAPES)
def test_shape(folder: Path, name: str) -> None:
    check_small(folder, scene_text(shape=SHAPES[name], emitter=AREA + CONSTANT))


@pytest.mark.parametrize("name", TEXTURES)
def test_texture(folder: Path, name: str) -> None:
    floor = FLOOR.replace(FLOOR[FLOOR.index("<bsdf") : FLOOR.index("</shape>")], TEXTURES[name])
    check_small(folder, scene_text(floor=floor))


@pytest.mark.parametrize("name", SENSORS)
def test_sensor(folder: Path, name: str) -> None:
    check_small(folder, scene_text(bsdf=TEXTURED, sensor=SENSORS[name]))


@pytest.mark.parametrize("name", ["tent", "gaussian", "mitchell", "catmullrom", "lanczos"])
def test_filter(folder: Path, name: str) -> None:
    """A margin is left out: the oracle takes no samples outside of the film."""
    check_small(folder, scene_text(bsdf=TEXTURED), Setup(max_depth=3, rfilter=name), spp=1024, margin=4)


REAL_SCENES = {
    "lajolla/cbox/cbox.xml": (64, 64, 1024),
    "lajolla/veach_mi/mi.xml": (72, 48, 2048),
    "lajolla/sponza/sponza.xml": (72, 54, 512),
    "lajolla/matpreview/matpreview.xml": (64, 48, 1024),
    "lajolla/pixel_filter_test/pixel_filter_test.xml": (64, 48, 1024),
    "bitterli/veach-mis/scene.xml": (80, 48, 2048),
    "bitterli/cornell-box/scene.xml": (64, 64, 1024),
    "bitterli/staircase2/scene.xml": (80, 48, 1024),
    "bitterli/veach-ajar/scene.xml": (80, 48, 1024),
}


@pytest.mark.parametrize("name", REAL_SCENES)
def test_real_scene(name: str) -> None:
    path = SHARED / name
    if not path.is_file():
        message = f"needs {path}"
        pytest.fail(message) if os.environ.get("CI") else pytest.skip(message)
    width, height, spp = REAL_SCENES[name]
    setup = Setup(width, height)
    theirs = render_with_mitsuba(path, spp=spp, seed=1000, setup=setup, variant=default_variant())
    found = differences(render_with_lajolla(path, spp=spp, seed=1, setup=setup), theirs)
    assert not found, "\n".join(found)
