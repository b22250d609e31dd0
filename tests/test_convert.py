"""`lajolla convert`: what it writes is a scene of Mitsuba 3 with the same mean."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest
from oracle import Setup, default_variant, differences, render_with_lajolla, render_with_mitsuba
from reader_tools import entries

from lajolla import _core, cli, image, load, whole_files
from lajolla.catalog import catalog
from lajolla.scene import SceneError, convert, load_description

SHARED = Path(__file__).resolve().parents[2] / "shared" / "scenes"
SETUP = Setup(max_depth=8)
EXR_DATE = re.compile(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d")  # when it was written

OLD_SCENE = """<scene version="0.6.0">
    <default name="grey" value="0.4"/>
    <sensor type="perspective">
        <string name="focalLength" value="40mm"/>
        <transform name="toWorld"><scale x="-2" y="2" z="2"/>
            <lookat origin="0, 2, 6" target="0, 0.5, 0" up="0, 1, 0"/></transform>
        <film type="ldrfilm"><integer name="width" value="32"/><integer name="height" value="24"/></film>
        <sampler type="halton"><integer name="sampleCount" value="16"/></sampler>
    </sensor>
    <bsdf type="mixturebsdf" id="mixed">
        <string name="weights" value="0.5, 0.3"/>
        <bsdf type="diffuse"><srgb name="reflectance" value="#80c020"/></bsdf>
        <bsdf type="roughconductor"><float name="alpha" value="0.3"/></bsdf>
    </bsdf>
    <shape type="sphere"><point name="center" x="-1.2" y="0.5" z="0"/><ref id="mixed"/></shape>
    <shape type="sphere"><transform name="toWorld"><scale x="0.5" y="1" z="1"/><translate x="1"/></transform>
        <ref id="mixed"/></shape>
    <shape type="obj"><string name="filename" value="floor.obj"/><float name="maxSmoothAngle" value="30"/>
        <bsdf type="twosided"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
            <string name="filename" value="floor.png"/><float name="gamma" value="1.8"/>
            <string name="channel" value="g"/><string name="filterType" value="nearest"/>
            <float name="uscale" value="2"/><float name="voffset" value="0.3"/></texture></bsdf></bsdf>
        </shape>
    <emitter type="point"><point name="position" x="1" y="4" z="3"/><rgb name="intensity" value="30 25 20"/>
        </emitter>
    <emitter type="constant"><spectrum name="radiance" value="$grey"/></emitter>
</scene>"""


@pytest.fixture
def old_scene(tmp_path: Path) -> Path:
    """A scene full of what Mitsuba 3 does not read."""
    import OpenImageIO as oiio

    pixels = np.random.default_rng(0).integers(20, 255, (4, 4, 3), np.uint8)
    picture = oiio.ImageBuf(pixels)
    assert picture.write(str(tmp_path / "floor.png"))
    corners = "v -3 -1 -3\nv -3 -1 3\nv 3 -1 3\nv 3 -1 -3\nvt 0 0\nvt 0 1\nvt 1 1\nvt 1 0\n"
    (tmp_path / "floor.obj").write_text(corners + "f 1/1 2/2 3/3 4/4\n")
    path = tmp_path / "old.xml"
    path.write_text(OLD_SCENE)
    return path


def check_means(path: Path, target: Path, setup: Setup, spp: int) -> None:
    """lajolla on the scene, the mitsuba package on what `convert` makes of it."""
    assert cli.main(["convert", str(path), str(target)]) == 0
    pytest.importorskip("mitsuba")
    theirs = render_with_mitsuba(target, spp=spp, seed=1000, setup=setup, variant=default_variant())
    found = differences(render_with_lajolla(path, spp=spp, seed=1, setup=setup), theirs)
    assert not found, "\n".join(found)


def load_with_mitsuba(path: Path) -> str:
    """Why the mitsuba package refuses a file; empty when it does not."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    try:
        mitsuba.load_file(str(path))
    except RuntimeError as problem:
        return str(problem)
    return ""


def test_an_old_scene(old_scene: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    check_means(old_scene, tmp_path / "out" / "new.xml", SETUP, 1024)


def test_a_real_scene(shared_scenes: Path, tmp_path: Path) -> None:
    check_means(shared_scenes / "lajolla/cbox/cbox.xml", tmp_path / "new.xml", Setup(64, 64), 512)


@pytest.mark.parametrize("name", ["lajolla/cbox/cbox.xml", "velysian/layered_shoes/layered_shoes.xml"])
def test_lajolla_renders_the_result_as_the_original(name: str, shared_scenes: Path, tmp_path: Path) -> None:
    """Bit for bit. Of the shoes, Mitsuba's picture differs from ours by several percent in places, whether
    the scene was converted or not, so that it cannot tell whether `convert` was right."""
    target = tmp_path / "new.xml"
    assert cli.main(["convert", str(shared_scenes / name), str(target)]) == 0
    original, result = (
        load(path, size=(64, 64)).render(spp=4, seed=1).array for path in (shared_scenes / name, target)
    )
    assert np.array_equal(original, result)


def test_every_scene_loads(shared_scenes: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The mitsuba package, which refuses properties that it does not know, opens every result; so does
    lajolla, without a warning that the scene or converting it did not cause."""
    scenes = [
        p for p in sorted(shared_scenes.rglob("*.xml")) if p.parent.name not in ("include", "fragments")
    ]
    refused = []
    target = tmp_path / "scene.xml"
    for path in scenes:
        if "_rand_" in path.name:  # differ from the scene beside them in numbers only
            continue
        capsys.readouterr()
        assert cli.main(["convert", str(path), str(target)]) == 0
        told = capsys.readouterr().err
        if problem := load_with_mitsuba(target):
            refused.append(f"{path}: {problem}")
        new = [w.message for w in load_description(target).warnings if w.message not in told]
        refused += [f"{path}: {message}" for message in new]
    assert refused == []


def test_packed_meshes_are_the_same(old_scene: Path, tmp_path: Path) -> None:
    result = convert(old_scene, tmp_path / "new.xml", pack=True)
    meshes = {name: content for name, content in result.files.items() if name.endswith(".ply")}
    assert len(meshes) == 2 and "new-files/0.ply" in meshes  # the stretched sphere and the floor
    (tmp_path / "floor.ply").write_bytes(list(meshes.values())[-1])
    read = _core.load_ply(str(tmp_path / "floor.ply"))
    original = _core.load_obj(str(tmp_path / "floor.obj"), flip_uvs=True)
    assert np.array_equal(read.vertices[read.faces], original.vertices[original.faces])
    assert np.array_equal(read.uvs[read.faces], original.uvs[original.faces])


def test_old_files_and_new_ones_are_not_mixed(
    old_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever file cannot be written."""
    command = ["convert", "--pack", str(old_scene), str(tmp_path / "new.xml")]
    assert cli.main(command) == 0
    floor = tmp_path / "floor.obj"
    floor.write_text(floor.read_text().replace("v -3 -1 -3", "v -4 -1 -3"))
    old_scene.write_text(OLD_SCENE.replace('x="0.5" y="1"', 'x="0.5" y="2"'))

    def contents() -> dict[str, bytes]:
        files = {str(path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
        return {name: EXR_DATE.sub(b"", content) for name, content in files.items()}

    before, replacing = contents(), whole_files.replacing
    for failures in range(10):
        left = iter(range(failures))

        def failing(
            path: Path, ending: str | None = None, left: Iterator[int] = left
        ) -> AbstractContextManager[Path]:
            if next(left, None) is None:
                raise image.ImageError(f"{path}: no space left on the disk")
            return replacing(path, ending)

        monkeypatch.setattr(whole_files, "replacing", failing)
        if cli.main(command) == 0:
            break
        assert contents() == before
    assert 2 < failures < 9
    assert len([path for path, content in contents().items() if before[path] != content]) == 2


def test_what_cannot_be_written_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "scene.xml"
    path.write_text(
        """<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"/>
        <shape type="sphere"><bsdf type="hk"/></shape></scene>"""
    )
    assert cli.main(["convert", str(path), str(tmp_path / "new.xml")]) == 0
    assert 'unknown bsdf "hk"; "diffuse" is' in capsys.readouterr().err
    assert cli.main(["convert", str(path), str(path)]) == 1
    assert "is the scene itself" in capsys.readouterr().err
    assert cli.main(["convert", str(path), str(tmp_path / "nowhere" / "new.xml")]) == 1
    assert "nowhere" in capsys.readouterr().err


def converted(content: str, folder: Path) -> tuple[str, list[str]]:
    """What becomes of a scene, which both renderers open, and the warnings of converting it."""
    path, target = folder / "scene.xml", folder / "new.xml"
    path.write_text(f'<scene version="3.0.0"><integrator type="volpath"/>{content}</scene>')
    told = {warning.message for warning in convert(path, target).warnings}
    assert cli.main(["convert", str(path), str(target)]) == 0
    text = target.read_text()
    assert load_with_mitsuba(target) == "", text
    assert {warning.message for warning in load_description(target).warnings} <= told, text
    return text, sorted(told)


@pytest.mark.parametrize("kind", ["normalmap", "bumpmap"])
@pytest.mark.parametrize("name", ["", 'name="normalmap"', 'name="map"', 'name="of any name"'])
def test_the_texture_of_a_map_may_have_any_name(tmp_path: Path, kind: str, name: str) -> None:
    image.Image(np.full((2, 2, 3), 0.5, np.float32)).save(tmp_path / "map.png")
    texture = f'<texture type="bitmap" {name}><string name="filename" value="map.png"/></texture>'
    text, told = converted(CAMERA + SPHERE % f'<bsdf type="{kind}">{texture}{RED}</bsdf>', tmp_path)
    assert f'<texture name="{"map" if kind == "bumpmap" else kind}" type="bitmap"' in text
    assert told == ["the scene has no light and is black"]


CAMERA = '<sensor type="perspective"><film type="hdrfilm"/></sensor>'
SPHERE = '<shape type="sphere">%s</shape>'
RED = '<bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0, 0"/></bsdf>'


@pytest.mark.parametrize("name", ["sigma_t", "albedo", "sigma_a", "sigma_s"])
def test_a_homogeneous_medium_takes_constant_volumes(name: str, tmp_path: Path) -> None:
    value = '<{0} name="{1}" {2}value="0.1, 0.2, 0.3"/>'
    medium = '<medium name="interior" type="homogeneous">%s</medium>'
    volume = f'<volume name="{name}" type="constvolume">{value.format("rgb", "value", "")}</volume>'
    means = []
    for coefficient in (value.format("rgb", name, ""), volume):
        converted(CAMERA + SPHERE % (medium % coefficient), tmp_path)
        means += [load_description(tmp_path / file).core["media"][0] for file in ("scene.xml", "new.xml")]
    for entry in means[1:]:
        assert np.allclose(entry["sigma_a"], means[0]["sigma_a"], atol=1e-6)
        assert np.allclose(entry["sigma_s"], means[0]["sigma_s"], atol=1e-6)


def test_lists_of_numbers_survive(tmp_path: Path) -> None:
    phase = '<phase type="tabphase"><string name="values" value="0.5 1, 1.5"/></phase>'
    text, _ = converted(
        CAMERA + SPHERE % f'<medium type="homogeneous" name="interior">{phase}</medium>', tmp_path
    )
    assert '"0.5, 1, 1.5"' in text
    assert load_description(tmp_path / "new.xml").core["phases"][0]["values"] == (0.5, 1.0, 1.5)


GROUP = f"""<shape type="shapegroup" id="inner">{SPHERE % RED}{SPHERE % '<emitter type="area"/>'}</shape>
    <shape type="shapegroup" id="outer"><shape type="cube"/><shape type="instance"><ref id="inner"/>
        <transform name="to_world"><translate x="3"/></transform></shape></shape>"""
INSTANCE = """<shape type="instance"><ref id="outer"/><transform name="to_world"><scale x="-1"/></transform>
    </shape><shape type="instance"><ref id="outer"/></shape>"""


def test_groups_within_groups_and_their_lights(tmp_path: Path) -> None:
    """Mitsuba 3 has neither; what is seen stays the same."""
    converted(CAMERA + GROUP + INSTANCE, tmp_path)
    old, new = (load_description(tmp_path / name).core for name in ("scene.xml", "new.xml"))
    for kind in ("shapes", "groups", "instances", "emitters"):
        assert len(entries(old[kind])) == len(entries(new[kind]))
    places = [
        sorted(str(np.array(i["to_world"]).tolist()) for i in entries(core["instances"]))
        for core in (old, new)
    ]
    assert places[0] == places[1]


TEXTURE = '<texture type="checkerboard"/>'
SMALL = '<integer name="width" value="8"/><integer name="height" value="8"/>'
REFUSED = {  # by mitsuba, if it were written as it is: the scene, and what is told of it
    "aperture": ('<sensor type="thinlens"><film type="hdrfilm"/></sensor>', ""),
    "two bsdfs": (CAMERA + SPHERE % (RED + '<bsdf type="dielectric"/>'), "only this one is used"),
    "unnamed texture": (CAMERA + SPHERE % f'<bsdf type="diffuse">{TEXTURE}</bsdf>', "does not support"),
    "colours": (
        CAMERA
        + SPHERE
        % f"""<bsdf type="diffuse">{
            TEXTURE.replace("/>", ' name="reflectance"><rgb name="color1" value="3"/></texture>')
        }</bsdf>""",
        "is above 1",
    ),
    "environments": (CAMERA + '<emitter type="constant"/>' * 2, "one environment light"),
    "one ray": (
        '<sensor type="radiancemeter"><film type="hdrfilm"><integer name="width" value="8"/></film></sensor>',
        "has one pixel",
    ),
    "half of a pair": (
        CAMERA + SPHERE % '<bsdf type="roughconductor"><float name="alpha_u" value="0.3"/></bsdf>',
        "",
    ),
    "a map without a texture": (CAMERA + SPHERE % f'<bsdf type="normalmap">{RED}</bsdf>', "changes nothing"),
    "a flat map": (
        CAMERA + SPHERE % f'<bsdf type="bumpmap"><float name="map" value="1"/>{RED}</bsdf>',
        "",
    ),
    "bumps of checks": (
        CAMERA
        + SPHERE
        % f'<bsdf type="bumpmap"><texture type="checkerboard"/><bsdf type="twosided">{RED}</bsdf></bsdf>',
        "bumps are left out",
    ),
    "two-sided glass": (CAMERA + SPHERE % '<bsdf type="twosided"><bsdf type="dielectric"/></bsdf>', "alone"),
    "a two-sided plate": (CAMERA + SPHERE % '<bsdf type="twosided"><bsdf type="polarizer"/></bsdf>', "alone"),
    "a stretched view": (
        CAMERA.replace("<film", '<transform name="to_world"><scale x="2"/></transform><film'),
        "does not stretch",
    ),
    "a spot of one colour": (
        CAMERA + '<emitter type="spot"><rgb name="texture" value="1 0 0"/></emitter>',
        "",
    ),
    "a wide box": (
        CAMERA.replace(
            "/></sensor>", '><rfilter type="box"><float name="radius" value="2"/></rfilter></film>'
        )
        + "</sensor>",
        'does not support "radius" of rfilter "box"',
    ),
    "an offset without a size": (
        CAMERA.replace("/></sensor>", '><integer name="crop_offset_x" value="8"/></film></sensor>'),
        "",
    ),
    "a shifted lens": (
        CAMERA.replace('"perspective">', '"thinlens"><float name="principal_point_offset_x" value="0.1"/>'),
        'does not support "principal_point_offset_x" of sensor "thinlens"',
    ),
    "an axis of no view": (
        CAMERA.replace('"perspective">', '"perspective"><string name="fov_axis" value="y"/>'),
        "",
    ),
    "an attribute without a name": (
        CAMERA + SPHERE % '<bsdf type="diffuse"><texture type="mesh_attribute" name="reflectance"/></bsdf>',
        "no mesh has the attribute",
    ),
    "an id with a dollar": (
        CAMERA + RED.replace("<bsdf", '<bsdf id="a\\$b"') + SPHERE % '<ref id="a\\$b"/>',
        "",
    ),
    "missing file": (
        CAMERA + SPHERE % '<bsdf type="measured"><string name="filename" value="x.bsdf"/></bsdf>',
        "is ignored",
    ),
}


def test_what_is_not_used_is_not_told_of_twice(tmp_path: Path) -> None:
    """A colour is written where it is used, and a `subsurface` is left out with its shape's warning."""
    colour = '<spectrum type="srgb" id="c"><rgb name="color" value="1 0 0"/></spectrum>'
    red = '<bsdf type="diffuse"><ref name="reflectance" id="c"/></bsdf>'
    text, told = converted(colour + CAMERA + SPHERE % red, tmp_path)
    assert "1 0 0" in text and [w for w in told if "texture" in w] == []
    wax = '<subsurface type="dipole" id="w"/>'
    _, told = converted(wax + CAMERA + SPHERE % '<ref id="w"/>', tmp_path)
    assert len([w for w in told if "subsurface" in w]) == 1


def test_how_rays_and_directions_are_found_stays(tmp_path: Path) -> None:
    """Mitsuba's names for robust ray queries and for how environment maps are sampled."""
    image.write(tmp_path / "sky.pfm", np.full((2, 4, 3), 3.0))
    sky = '<emitter type="envmap"><string name="filename" value="sky.pfm"/>{}</emitter>'
    robust = '<boolean name="embree_use_robust_intersections" value="true"/>'
    for given, written in (
        ("", None),
        ('<string name="sampling" value="compensated"/>', "true"),
        ('<string name="sampling" value="uniform"/>', "false"),
        ('<boolean name="mis_compensation" value="true"/>', "true"),
        ('<boolean name="mis_compensation" value="false"/>', "false"),
    ):
        text, told = converted(f'{robust}{sky.format(given)}<sensor type="perspective"/>', tmp_path)
        assert robust.replace("/>", " />") in text and not told
        found = re.search(r'name="mis_compensation" value="(.*?)"', text)
        assert (found[1] if found else None) == written


def test_the_border_of_a_film_stays(tmp_path: Path) -> None:
    border = '><boolean name="sample_border" value="true"/></film></sensor>'
    text, _ = converted(CAMERA.replace("/></sensor>", border), tmp_path)
    assert '<boolean name="sample_border" value="true" />' in text


@pytest.mark.parametrize("case", REFUSED)
def test_what_mitsuba_refuses_is_not_written(case: str, tmp_path: Path) -> None:
    content, expected = REFUSED[case]
    _, told = converted(content, tmp_path)
    assert expected in " ".join(told)


def test_the_last_camera_of_an_old_file_comes_first(tmp_path: Path) -> None:
    path, target = tmp_path / "scene.xml", tmp_path / "new.xml"
    cameras = '<sensor type="perspective"/><sensor type="orthographic"/>'
    path.write_text(f'<scene version="0.6.0">{cameras}<emitter type="constant"/></scene>')
    assert cli.main(["convert", str(path), str(target)]) == 0
    sensors = [load_description(file).core["sensor"]["type"] for file in (path, target)]
    assert sensors == ["orthographic"] * 2


DIFFUSE = '<bsdf type="diffuse"/>'
IMAGE = '<string name="filename" value="picture.exr"/>'
WITHIN = {  # what a plugin cannot do without
    "twosided": DIFFUSE,
    "mask": DIFFUSE,
    "coating": DIFFUSE,
    "roughcoating": DIFFUSE,
    "blendbsdf": DIFFUSE * 2,
    "mixturebsdf": DIFFUSE + '<string name="weights" value="0.5"/>',
    "bumpmap": DIFFUSE + TEXTURE,
    "normalmap": DIFFUSE + TEXTURE,
    "measured": '<string name="filename" value="missing.bsdf"/>',
    "envmap": IMAGE,
    "projector": IMAGE,
    "blendphase": '<phase type="isotropic"/><phase type="hg"/>',
}
INSIDE = {  # the place of a plugin in a scene
    "bsdf": SPHERE,
    "emitter": '%s<emitter type="point"/>',
    "phase": SPHERE % '<medium type="homogeneous" name="interior">%s</medium>',
    "medium": SPHERE,
}
SAME = {"sun": "sunsky", "sky": "sunsky", "mixturebsdf": "blendbsdf"}  # the other's special case


@pytest.mark.parametrize("kind", INSIDE)
def test_every_plugin_is_written_or_told(kind: str, tmp_path: Path) -> None:
    """With its defaults, under its own name or with a warning."""
    image.write(tmp_path / "picture.exr", np.full((4, 8, 3), 0.5, np.float32))
    for name in sorted(catalog()[kind]):
        named = ' name="interior"' if kind == "medium" else ""
        place = SPHERE if name == "area" else INSIDE[kind]
        plugin = f'<{kind} type="{name}"{named}>{WITHIN.get(name, "")}</{kind}>'
        text, told = converted(CAMERA + place % plugin, tmp_path)
        assert f'type="{SAME.get(name, name)}"' in text or any(f'{kind} "{name}"' in line for line in told), (
            text
        )


FIELD_PLACES = {
    **INSIDE,
    "sensor": "%s",
    "film": '<sensor type="perspective">%s</sensor>',
    "rfilter": '<sensor type="perspective"><film type="hdrfilm">%s</film></sensor>',
    "integrator": CAMERA + "%s",
}
VALUES = {
    "boolean": '<boolean name="{name}" value="true"/>',
    "spectrum": '<rgb name="{name}" value="0.3, 0.4, 0.5"/>',
    "texture_spectrum": '<rgb name="{name}" value="0.3, 0.4, 0.5"/>',
    "volume_spectrum": '<rgb name="{name}" value="0.3, 0.4, 0.5"/>',
    "texture_float": '<float name="{name}" value="0.33"/>',
    "vector": '<vector name="{name}" x="0.1" y="0.2" z="1"/>',
    "transform": '<transform name="{name}"><translate x="0.3" y="0.1"/></transform>',
}


def fields(kind: str) -> Iterator[tuple[str, str]]:
    """Every field of every plugin of a kind that needs nothing else, with a value."""
    for name, model in sorted(catalog()[kind].items()):
        for field in model["fields"]:
            text = VALUES.get(field["type"], "").format(**field)
            if field["type"] == "choice":
                text = f'<string name="{field["name"]}" value="{field["choices"][-1]}"/>'
            if field["type"] in ("float", "integer"):
                low = field["minimum"] or 0
                middle = (low + min(field["maximum"] or low + 2, low + 3)) / 2 + 0.17
                value = middle if field["type"] == "float" else max(int(middle), int(low) + 1)
                text = f'<{field["type"]} name="{field["name"]}" value="{value}"/>'
            if text and name != "measured":
                yield name, text


@pytest.mark.parametrize("kind", FIELD_PLACES)
def test_every_field_opens(kind: str, tmp_path: Path) -> None:
    """Whatever is set of a plugin, Mitsuba opens what is written of it."""
    image.write(tmp_path / "picture.exr", np.full((4, 8, 3), 0.5, np.float32))
    for name, text in fields(kind):
        plugin = f'<{kind} type="{name}"{_place_name(kind)}>{WITHIN.get(name, "")}{text}</{kind}>'
        place = SPHERE if name == "area" else FIELD_PLACES[kind]
        content = ("" if "<sensor" in place or kind == "sensor" else CAMERA) + place % plugin
        path, target = tmp_path / "scene.xml", tmp_path / "new.xml"
        path.write_text(f'<scene version="3.0.0">{content}</scene>')
        try:
            convert(path, target)
        except SceneError:
            continue  # half of what belongs together
        assert cli.main(["convert", str(path), str(target)]) == 0
        assert load_with_mitsuba(target) == "", content


def _place_name(kind: str) -> str:
    return ' name="interior"' if kind == "medium" else ""


def test_an_orthographic_camera_keeps_its_size(tmp_path: Path) -> None:
    view = '<lookat origin="0, 0, 4" target="0, 0, 0"/>'
    place = f'<transform name="to_world"><scale x="3" y="2"/>{view}</transform>'
    converted(f'<sensor type="orthographic">{place}</sensor>', tmp_path)
    sizes = [
        np.linalg.norm(np.array(load_description(tmp_path / name).core["sensor"]["to_world"])[:3, :3], axis=0)
        for name in ("scene.xml", "new.xml")
    ]
    assert np.allclose(sizes, [[3, 2, 1]] * 2)


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("channel", ["", "g", "a"])
def test_channels_of_pictures_stay_what_they_are(channel: str, raw: bool, tmp_path: Path) -> None:
    import OpenImageIO as oiio

    pixels = np.random.default_rng(0).integers(0, 255, (4, 4, 4), np.uint8)
    assert oiio.ImageBuf(pixels).write(str(tmp_path / "a.png"))
    chosen = f'<string name="channel" value="{channel}"/>' if channel else ""
    texture = f"""<texture type="bitmap" name="reflectance"><string name="filename" value="a.png"/>{chosen}
        <boolean name="raw" value="{str(raw).lower()}"/></texture>"""
    view = CAMERA.replace("/></sensor>", f">{SMALL}</film></sensor>").replace("perspective", "orthographic")
    view = view.replace(
        "<film", '<transform name="to_world"><lookat origin="0,0,3" target="0,0,0"/></transform><film'
    )
    light = '<emitter type="constant"/>'
    converted(f'{view}{light}<shape type="rectangle"><bsdf type="diffuse">{texture}</bsdf></shape>', tmp_path)
    pictures = [load(tmp_path / name).render(spp=16, seed=1).array for name in ("scene.xml", "new.xml")]
    assert pictures[0].max() > 0 and np.allclose(*pictures, atol=1e-3)


PLY = """ply
format ascii 1.0
{}element vertex 4
property float x
property float y
property float z
{}element face {}
property list uchar int vertex_indices
end_header
"""
CORNERS = "0 0 0{0}\n1 0 0{0}\n1 1 0{0}\n0 1 0{0}\n"
TRIANGLES = "3 0 1 2\n3 0 2 3\n"
COLOURS = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
MESHES = {  # the file, and whether Mitsuba 3 reads the same
    "triangles": ("ply", PLY.format("", "", 2) + CORNERS.format("") + TRIANGLES, True),
    "a quad": ("ply", PLY.format("", "", 1) + CORNERS.format("") + "4 0 1 2 3\n", False),
    "bytes as colours": ("ply", PLY.format("", COLOURS, 2) + CORNERS.format(" 255 0 128") + TRIANGLES, False),
    "remarks": ("ply", PLY.format("obj_info made\n", "", 2) + CORNERS.format("") + TRIANGLES, False),
    "an obj": ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", True),
    "indices from the end": ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n", False),
    "long lines": ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n3\n", False),
    "whole numbers": (
        "ply",
        PLY.format("", "", 2).replace("float", "int") + CORNERS.format("") + TRIANGLES,
        False,
    ),
    "normals without a direction": (
        "ply",
        PLY.format("", "".join(f"property float n{axis}\n" for axis in "xyz"), 2)
        + CORNERS.format(" 0 0 0")
        + TRIANGLES,
        False,
    ),
    "colours of vertices": ("obj", "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n", False),
    "a byte order mark": ("obj", "\ufeffv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", False),
    "single coordinates": ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0\nvt 1\nf 1/1 2/2 3/1\n", False),
    "coordinates of some corners": (
        "obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 1\nf 1/1 2/1 3/1\nf 3 2 1\n",
        False,
    ),
    "normals of some corners": (
        "obj",
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1//1 2//1 3//1\nf 3 2 1\n",
        False,
    ),
    "a vertex that is no number": ("obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\n", False),
}


@pytest.mark.parametrize("case", MESHES)
def test_meshes_that_mitsuba_reads_otherwise_are_packed(case: str, tmp_path: Path) -> None:
    kind, content, alike = MESHES[case]
    (tmp_path / f"mesh.{kind}").write_text(content)
    shape = f'<shape type="{kind}"><string name="filename" value="mesh.{kind}"/></shape>'
    text, _ = converted(CAMERA + shape, tmp_path)
    assert ("new-files" in text) != alike
    ours, theirs = (
        load_description(tmp_path / n).core["shapes"][0]["mesh"] for n in ("scene.xml", "new.xml")
    )
    assert np.array_equal(ours.vertices[ours.faces], theirs.vertices[theirs.faces])
    assert ours.attributes.keys() == theirs.attributes.keys()
    assert all(np.array_equal(ours.attributes[name], theirs.attributes[name]) for name in ours.attributes)


@pytest.mark.parametrize("kind", ["obj", "ply"])
def test_meshes_without_faces_are_left_out(kind: str, tmp_path: Path) -> None:
    """Mitsuba 3 refuses them."""
    content = {"obj": "v 0 0 0\n", "ply": PLY.format("", "", 0) + CORNERS.format("")}[kind]
    (tmp_path / f"mesh.{kind}").write_text(content)
    shape = f'<shape type="{kind}"><string name="filename" value="mesh.{kind}"/></shape>'
    text, _ = converted(CAMERA + shape, tmp_path)
    assert "<shape" not in text


COATED = {  # what is inside a coating, and how far Mitsuba's picture may be from ours
    "diffuse": (RED, 0.01),
    "both sides": (f'<bsdf type="twosided">{RED}</bsdf>', 0.01),
    "another layer": (f'<float name="int_ior" value="1.8"/>{RED}', 0.01),
    "tinted": (f'<rgb name="sigma_a" value="0.1, 0.3, 0.5"/>{RED}', 0.02),
    "checks": ('<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>', 0.05),
    "cut out": (f'<bsdf type="mask"><float name="opacity" value="0.5"/>{RED}</bsdf>', 0.01),
    # The warning says 8 %. It was 6 % while Mitsuba's blend of mirrors, which is too dark, made up for some.
    "metal": ('<bsdf type="roughconductor"><string name="material" value="Au"/></bsdf>', 0.09),
    "glass": ('<bsdf type="dielectric"/>', 0.01),
}


@pytest.mark.parametrize("layer", ["coating", "roughcoating"])
@pytest.mark.parametrize("case", COATED)
def test_coatings_stay_as_near_as_they_can(case: str, layer: str, tmp_path: Path) -> None:
    inner, margin = COATED[case]
    path, target = tmp_path / "scene.xml", tmp_path / "new.xml"
    view = """<sensor type="perspective"><float name="fov" value="30"/><transform name="to_world">
        <lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform><film type="hdrfilm"><integer
        name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>"""
    shape = SPHERE % f'<bsdf type="{layer}">{inner}</bsdf>'
    path.write_text(
        f'<scene version="3.0.0"><integrator type="path"/>{view}<emitter type="constant"/>{shape}</scene>'
    )
    told = " ".join(warning.message for warning in convert(path, target).warnings)
    assert f'Mitsuba 3 does not support bsdf "{layer}"; ' in told
    assert cli.main(["convert", str(path), str(target)]) == 0
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant(default_variant())
    theirs = np.array(mitsuba.render(mitsuba.load_file(str(target)), spp=128)).mean((0, 1))
    ours = load(path).render(spp=128).array.mean((0, 1))
    rough = 0.04 if layer == "roughcoating" else 0.0
    assert np.allclose(ours, theirs, rtol=margin + rough), (ours, theirs)


@pytest.mark.parametrize("light", ["sky", "lamp"])
@pytest.mark.parametrize("coat", ["coating", "roughcoating"])
@pytest.mark.parametrize("base", ["conductor", "roughconductor"])
def test_coated_metal_is_as_bright_in_mitsuba(base: str, coat: str, light: str, tmp_path: Path) -> None:
    """Within what the warning says of rough metal; Mitsuba's blends of mirrors lost a tenth under lamps."""
    mi = pytest.importorskip("mitsuba")
    lamp = """<shape type="sphere"><point name="center" x="3" y="4" z="5"/>
        <emitter type="area"><rgb name="radiance" value="30"/></emitter></shape>"""
    body = f"""<integrator type="path"/><sensor type="perspective"><float name="fov" value="20"/>
        <transform name="toWorld"><lookat origin="0,0,4" target="0,0,0" up="0,1,0"/></transform>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
        <rfilter type="box"/></film></sensor>{lamp if light == "lamp" else '<emitter type="constant"/>'}
        <shape type="sphere"><bsdf type="{coat}"><bsdf type="{base}"/></bsdf></shape>"""
    source, target = tmp_path / "old.xml", tmp_path / "new.xml"
    source.write_text(f'<scene version="0.6.0">{body}</scene>')
    assert cli.main(["convert", str(source), str(target)]) == 0
    mi.set_variant(default_variant())
    mean = load(source).render(spp=1024, seed=1).array.mean((0, 1))
    theirs = np.array(mi.render(mi.load_file(str(target)), spp=1024, seed=1)).mean((0, 1))
    assert np.all(np.abs(theirs / mean - 1) < (0.05 if base == "conductor" else 0.1)), theirs / mean
