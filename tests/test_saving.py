"""Scenes that were changed and saved: loaded again, they render the same bits, and keep their text."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lajolla

SCENES = Path(__file__).resolve().parent.parent / "scenes"
pytestmark = pytest.mark.filterwarnings("ignore::lajolla.SceneWarning")

SCENE = """<?xml version="1.0"?>
<!-- a <scene> of one ball -->
<scene version="3.0.0">
    <default name="size" value="8"/>
    <integrator type="path"/>
    <sensor type="perspective" id="front"> <!-- the first -->
        <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="$size"/><integer name="height" value="8"/></film>
    </sensor>
    <sensor type="perspective" id="side">
        <transform name="to_world"><lookat origin="4, 0, 0" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
    </sensor>
    <include filename="parts/ball.xml"/>
    <emitter type="constant" id="sky"/>
</scene>
"""
BALL = """<scene version="3.0.0">
    <bsdf type="roughconductor" id="metal"><string name="material" value="Au"/></bsdf>
    <shape type="sphere" id="ball"><ref id="metal"/></shape>
    <shape type="ply" id="floor">
        <string name="filename" value="floor.ply"/>
        <bsdf type="diffuse"><texture type="bitmap" name="reflectance">
            <string name="filename" value="tiles.png"/>
        </texture></bsdf>
    </shape>
</scene>
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A scene with an included file, and a mesh and a texture beside that."""
    (tmp_path / "parts").mkdir()
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    (tmp_path / "parts" / "ball.xml").write_text(BALL)
    corners = "-2 -1 -2\n2 -1 -2\n2 -1 2\n-2 -1 2\n"
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "parts" / "floor.ply").write_text(f"{header}{faces}{corners}3 0 2 1\n3 0 3 2\n")
    pixels = np.random.default_rng(1).random((4, 4, 3)).astype(np.float32)
    lajolla.Image(pixels).save(tmp_path / "parts" / "tiles.png")
    return path


def moved(matrix: np.ndarray, x: float) -> np.ndarray:
    return matrix + np.array([[0, 0, 0, x], [0] * 4, [0] * 4, [0] * 4])


def mesh_of(scene: lajolla.Scene) -> str:
    return next(name for name, found in scene.params.objects.items() if found.model == "mesh")


@pytest.mark.parametrize(
    "name",
    ["cornell-box.xml", "lajolla/cbox/cbox.xml", "dppm/veach-lamp/scene.xml"],
    ids=["box", "0.5", "0.6"],
)
def test_edited_scenes_have_the_same_bits(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    """Colours, roughness, light, camera, film, depth, a placement, vertices, and pixels."""
    folder = SCENES if "/" not in name else request.getfixturevalue("shared_scenes")
    scene = lajolla.load(folder / name)
    values: dict[str, Any] = {"film.size": (24, 16), "sensor.fov": 33.25, "integrator.max_depth": 4}
    values["sensor.to_world"] = moved(scene["sensor.to_world"], 0.125)
    mesh = mesh_of(scene)
    values[f"{mesh}.to_world"] = moved(scene[f"{mesh}.to_world"], 0.1)
    values[f"{mesh}.positions"] = scene[f"{mesh}.positions"] * 1.1
    wanted = {"reflectance": lambda v: v * 0.7, "alpha_u": lambda v: 0.3, "radiance": lambda v: v * 1.7}
    for suffix, change in wanted.items():
        found = next(
            (p for p in scene.params if p.endswith(f".{suffix}") and not isinstance(scene[p], str)), None
        )
        if found is not None:
            values[found] = change(scene[found])
    pixels = np.random.default_rng(2).random((3, 5, 3)).astype(np.float32)
    reflectance = next(p for p in scene.params if p.endswith("reflectance") and p not in values)
    values[reflectance] = {"type": "bitmap", "data": pixels}
    scene.update(values)
    scene.save(tmp_path / "edited.xml")
    again = lajolla.load(tmp_path / "edited.xml")
    assert (again.width, again.height) == (24, 16)
    np.testing.assert_array_equal(again.render(spp=2, seed=1).array, scene.render(spp=2, seed=1).array)


def saved_text(scene: lajolla.Scene, target: Path) -> str:
    scene.save(target)
    again = lajolla.load(target)
    np.testing.assert_array_equal(again.render(spp=2, seed=1).array, scene.render(spp=2, seed=1).array)
    return target.read_text()


def test_what_was_not_changed_stays_as_it_was_written(path: Path) -> None:
    scene = lajolla.load(path)
    assert saved_text(scene, path.with_name("same.xml")) == SCENE
    scene["sky.radiance"] = (0.5, 0.25, 1.0)
    scene["sensor.fov"] = 30.5
    text = saved_text(scene, path.with_name("other.xml"))
    colour = '<rgb name="radiance" value="0.5, 0.25, 1"/>'
    new = f'<emitter type="constant" id="sky">\n        {colour}\n    </emitter>'
    fov = '</film>\n        <float name="fov" value="30.5"/>\n        '
    fov += '<string name="fov_axis" value="diagonal"/>\n    </sensor>'
    assert text == SCENE.replace('<emitter type="constant" id="sky"/>', new).replace(
        "</film>\n    </sensor>", fov, 1
    )


def test_another_folder(path: Path, tmp_path: Path) -> None:
    """Names of files are relative to the old one, which the saved scene names."""
    scene = lajolla.load(path)
    (tmp_path / "deep" / "er").mkdir(parents=True)
    text = saved_text(scene, tmp_path / "deep" / "er" / "scene.xml")
    assert '<path value="../.."/>' in text and 'filename="parts/ball.xml"' in text


def test_included_files_are_copied_when_they_change(path: Path) -> None:
    scene = lajolla.load(path)
    scene["ball.to_world"] = moved(np.eye(4), 0.5)
    scene["metal.alpha_u"] = scene["metal.alpha_v"] = 0.4
    text = saved_text(scene, path.with_name("other.xml"))
    (copy,) = path.with_name("other-files").iterdir()
    assert (
        f'filename="other-files/{copy.name}"' in text
        and (path.parent / "parts" / "ball.xml").read_text() == BALL
    )
    assert "Au" in copy.read_text(), "the metal keeps its name"


def test_values_without_a_property_replace_the_others(path: Path) -> None:
    ball = path.parent / "parts" / "ball.xml"
    ball.write_text(BALL.replace('"Au"/>', '"Au"/><float name="ext_eta" value="1.5"/>'))
    scene = lajolla.load(path)
    scene["metal.eta"] = (0.5, 0.25, 0.125)
    saved_text(scene, path.with_name("other.xml"))
    (copy,) = path.with_name("other-files").iterdir()
    assert "Au" not in copy.read_text() and 'name="k"' in copy.read_text()


def test_a_cylinder_and_a_coating(path: Path) -> None:
    """What the reader restates: the scale of a cylinder, and a coating that becomes dull."""
    tube = """<shape type="cylinder" id="tube"><point name="p1" value="0, 1, 2"/>
        <transform name="to_world"><rotate x="1" angle="20"/><scale value="0.7"/></transform>
        <bsdf type="coating" id="coat"><bsdf type="diffuse"/></bsdf></shape>"""
    path.write_text(SCENE.replace("    <include", f"    {tube}\n    <include"))
    scene = lajolla.load(path)
    scene["tube.to_world"] = moved(scene["tube.to_world"], 0.5)
    scene["tube.radius"] = 0.4
    scene["coat.alpha"] = 0.2
    scene["coat.base.reflectance"] = (0.1, 0.2, 0.3)
    assert 'type="roughcoating"' in saved_text(scene, path.with_name("other.xml"))


def test_arrays_become_files(path: Path) -> None:
    scene = lajolla.load(path)
    scene["floor.positions"] = scene["floor.positions"] * 1.5
    eight_bits = np.random.default_rng(3).integers(0, 255, (4, 2, 3), dtype=np.uint8)
    scene["floor.bsdf.reflectance.image"] = eight_bits
    scene["metal.alpha_u"] = {"type": "bitmap", "data": eight_bits[..., :1] / np.float32(300), "raw": True}
    saved_text(scene, path.with_name("other.xml"))
    endings = sorted(file.suffix for file in path.with_name("other-files").iterdir())
    assert endings == [".exr", ".ply", ".png", ".xml"]
    scene.save(path.with_name("other.xml"))
    assert sorted(file.suffix for file in path.with_name("other-files").iterdir()) == endings


def test_another_sensor_becomes_the_first(path: Path) -> None:
    scene = lajolla.load(path)
    scene["sensor.fov"] = 20.0
    side = scene.with_sensor("side")
    side["sensor.fov"] = 60.0
    target = path.with_name("other.xml")
    assert saved_text(side, target).index('id="side"') < target.read_text().index('id="front"')
    front = lajolla.load(target, sensor="front")
    np.testing.assert_array_equal(front.render(spp=2).array, scene.render(spp=2).array)


def test_options_and_parameters_of_load(path: Path) -> None:
    options: dict[str, Any] = {"spp": 3, "seed": 5, "integrator": "direct", "hide_emitters": True}
    path.write_text(
        SCENE.replace('id="sky"/>', 'id="$name"/>').replace(
            "<default", '<default name="name" value="sky"/><default'
        )
    )
    scene = lajolla.load(path, parameters={"size": 6, "name": "a$b"}, **options)
    assert '<default name="size" value="6"/>' in saved_text(scene, path.with_name("other.xml"))
    again = lajolla.load(path.with_name("other.xml"))
    assert (
        "a$b.radiance" in again.params
        and again.width == 6
        and again.core.seed == 5
        and again.core.sample_count == 3
    )
    sampled = lajolla.load(path, sampler="independent")
    with pytest.warns(lajolla.messages.LajollaWarning, match="sampler is no part of a scene file"):
        sampled.save(path.with_name("sampled.xml"))


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("said", ["", "true", "false"])
def test_the_option_robust_is_written(said: str, robust: bool, path: Path) -> None:
    element = f'<boolean name="embree_use_robust_intersections" value="{said}"/>'
    path.write_text(SCENE.replace("<emitter", f"{element if said else ''}<emitter"))
    scene = lajolla.load(path, robust=robust)
    target = path.with_name("other.xml")
    scene.save(target)
    assert bool(lajolla.load(target).description.core.get("robust")) == robust


def test_a_computed_sky_becomes_a_picture(path: Path) -> None:
    """Sun and sky are two lights of one element; and the integrator inside of another one is changed."""
    inside = (
        '<integrator type="aov"><string name="aovs" value="d:depth"/><integrator type="path"/></integrator>'
    )
    text = SCENE.replace('<emitter type="constant" id="sky"/>', '<emitter type="sunsky" id="day"/>')
    path.write_text(text.replace('<integrator type="path"/>', inside))
    scene = lajolla.load(path)
    scene["integrator.max_depth"] = 3
    scene["day.scale"] = 0.25
    saved = saved_text(scene, path.with_name("other.xml"))
    assert 'type="envmap" id="day"' in saved and 'type="distantdisk"' in saved
    assert [file.suffix for file in path.with_name("other-files").iterdir()] == [".exr"]


def test_what_cannot_be_written_is_named(path: Path, tmp_path: Path) -> None:
    scene = lajolla.load(path)
    scene["floor.normals"] = np.zeros_like(scene["floor.normals"])
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(lajolla.SceneError, match=r"ball.xml:4:5: error: floor\.normals cannot be saved: "):
        scene.save(tmp_path / "other.xml")
    assert sorted(tmp_path.rglob("*")) == before, "nothing is left"
    for unknown in (pickle.loads(pickle.dumps(scene)), lajolla.load_dict(DICT)):
        with pytest.raises(lajolla.SceneError, match="only scenes that were loaded from files can be saved"):
            unknown.save(tmp_path / "other.xml")


DICT = {
    "type": "scene",
    "integrator": {"type": "path"},
    "sensor": {"type": "perspective"},
    "sky": {"type": "constant"},
}


def test_texts_of_any_encoding_and_layout(path: Path) -> None:
    text = SCENE.replace('<?xml version="1.0"?>', '<?xml version="1.0" encoding="iso-8859-1"?>')
    text = text.replace("of one ball", "d'une boule isolée").replace("\n", "\r\n")
    path.write_bytes(text.replace('id="sky"/>', "id='sky' ><!-- > --></emitter>").encode("latin-1"))
    scene = lajolla.load(path)
    scene["sky.radiance"] = 0.5
    scene["sensor.near_clip"] = 0.25
    saved = saved_text(scene, path.with_name("other.xml"))
    assert 'encoding="utf-8"' in saved and "isolée" in saved and "<!-- > -->" in saved


def test_a_saved_scene_may_replace_its_file(path: Path) -> None:
    scene = lajolla.load(path)
    scene["sky.radiance"] = (0.5, 0.5, 0.5)
    saved_text(scene, path)
    scene["sky.radiance"] = (0.25, 0.5, 0.5)
    assert saved_text(scene, path).count("radiance") == 1


def test_materials_of_shapes(path: Path) -> None:
    """Equal bsdfs are written where each is, and new ones in the place of those before."""
    ball = '<shape type="sphere" id="{}"><float name="radius" value="{}"/>{}</shape>\n'
    thin = '<bsdf type="mask"><float name="opacity" value="0.5"/><bsdf type="diffuse"/></bsdf>'
    sided = '<bsdf type="twosided"><bsdf type="diffuse"/></bsdf>'
    bodies = ['<bsdf type="diffuse"/>'] * 3 + [thin, thin, sided, sided, ""]
    shapes = "".join(ball.format(f"s{i}", 0.1 + 0.05 * i, body) for i, body in enumerate(bodies))
    spare = '<bsdf type="plastic" id="spare"/>'
    path.write_text(SCENE.replace("</scene>", f"{spare}{shapes}</scene>"))
    scene = lajolla.load(path)
    scene.update(
        {
            "s1.bsdf.reflectance": (0.1, 0.2, 0.3),
            "s4.bsdf.child.reflectance": 0.25,
            "s6.bsdf.reflectance": 0.75,
            "s2.bsdf": {"type": "mask", "opacity": 0.25, "inside": {"type": "conductor", "material": "Au"}},
            "s5.bsdf": {"type": "twosided", "front": {"type": "plastic"}},
            "s7.bsdf": "spare",
        }
    )
    text = saved_text(scene, path.with_name("other.xml"))
    assert '<ref id="spare"' in text
    again = lajolla.load(path.with_name("other.xml"))
    assert again["s0.bsdf.reflectance"].tolist() == [0.5] * 3
    for name in ("s1.bsdf.reflectance", "s4.bsdf.child.reflectance", "s2.bsdf.child.eta", "s5.bsdf.int_ior"):
        assert np.allclose(again[name], scene[name]), name


@pytest.mark.parametrize("integrator", ["volpath", "direct"])
def test_the_integrator_that_was_asked_for(path: Path, integrator: str) -> None:
    scene = lajolla.load(path, integrator=integrator)
    assert f'<integrator type="{integrator}"' in saved_text(scene, path.with_name("other.xml"))


def test_what_was_changed_and_then_replaced(path: Path) -> None:
    texture = '<texture type="checkerboard" name="reflectance" id="board"/>'
    body = f'<shape type="sphere" id="s"><bsdf type="diffuse" id="d">{texture}</bsdf></shape>'
    path.write_text(SCENE.replace("</scene>", f'<bsdf type="plastic" id="spare"/>{body}</scene>'))
    scene = lajolla.load(path)
    scene["board.color0"] = (0.1, 0.2, 0.3)
    scene["d.reflectance"] = (0.2, 0.3, 0.4)
    assert "checkerboard" not in saved_text(scene, path.with_name("other.xml"))
    scene["s.bsdf"] = "spare"
    assert '"d"' not in saved_text(scene, path.with_name("other.xml"))


def test_computed_normals_without_length(path: Path) -> None:
    """Of a vertex without faces, and of two faces that lie upon each other."""
    floor = path.parent / "parts" / "floor.ply"
    text = floor.read_text().replace("vertex 4", "vertex 5").replace("face 2", "face 3")
    text = text.replace("3 0 2 1\n3 0 3 2\n", "5 5 5\n3 0 2 1\n3 0 1 2\n3 0 3 2\n")
    floor.write_text(text)
    scene = lajolla.load(path)
    scene["floor.positions"] = scene["floor.positions"] * 1.5
    assert not scene["floor.normals"][4].any()
    saved_text(scene, path.with_name("other.xml"))


@pytest.mark.parametrize("edited", [False, True])
def test_another_folder_with_files_of_the_same_names(path: Path, tmp_path: Path, edited: bool) -> None:
    """Also that of a texture in the included file, which is copied if it is edited."""
    lajolla.Image(np.ones((2, 2, 3), np.float32)).save(tmp_path / "tiles.png")
    other = tmp_path / "other"
    for folder in (other / "parts", other / "lib"):
        folder.mkdir(parents=True)
    for name in ("parts/ball.xml", "parts/floor.ply", "tiles.png"):
        (other / name).write_text("another")
    (tmp_path / "lib").mkdir()
    path.write_text(SCENE.replace("    <include", '    <path value="lib"/>\n    <include'))
    scene = lajolla.load(path)
    if edited:
        scene["ball.radius"] = 0.5
    text = saved_text(scene, other / "scene.xml")
    assert '"../lib"' in text and (edited or '"../parts/ball.xml"' in text)


def test_names_with_a_dollar_sign(path: Path) -> None:
    scene = lajolla.load(path)
    scene["ball.radius"] = 0.5
    assert 'filename="other\\$size-files/' in saved_text(scene, path.with_name("other$size.xml"))


@pytest.mark.parametrize("version", ["0.6.0", "3.0.0"])
def test_checkerboards_that_are_read_as_numbers(path: Path, version: str) -> None:
    """Files of today have their colours the other way round."""
    board = '<texture type="checkerboard" name="alpha" id="board"/>'
    body = f'<shape type="sphere" id="s"><bsdf type="roughconductor" id="d">{board}</bsdf></shape>'
    film = '<film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>'
    sensor = f'<sensor type="perspective">{film}</sensor>'
    path.write_text(f'<scene version="{version}">{sensor}{body}<emitter type="constant"/></scene>')
    scene = lajolla.load(path)
    scene["board.color0"] = 0.25
    name = "color1" if version == "3.0.0" else "color0"
    assert f'name="{name}" value="0.25' in saved_text(scene, path.with_name("other.xml"))
    scene["d.alpha_v"] = {"type": "checkerboard", "color0": 0.1, "color1": 0.3}
    saved_text(scene, path.with_name("other.xml"))


@pytest.mark.parametrize("count", [0, 1, 2])
@pytest.mark.parametrize("error", [OSError(28, "full"), KeyboardInterrupt()], ids=["full", "Ctrl-C"])
def test_failed_writes_leave_nothing(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, error: BaseException
) -> None:
    """At the mesh, at the included file, and at the scene itself."""
    scene = lajolla.load(path)
    scene["floor.positions"] = scene["floor.positions"] * 1.5
    before = sorted(tmp_path.rglob("*"))
    written: list[Path] = []
    write_bytes = Path.write_bytes

    def write(self: Path, data: bytes) -> int:
        if len(written) == count:
            write_bytes(self, data[:10])
            raise error
        written.append(self)
        return write_bytes(self, data)

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(lajolla.ImageError if isinstance(error, OSError) else KeyboardInterrupt):
        scene.save(tmp_path / "other.xml")
    assert sorted(tmp_path.rglob("*")) == before


def test_aovs_are_warned_about(path: Path) -> None:
    scene = lajolla.load(path, aovs=["depth"])
    with pytest.warns(lajolla.messages.LajollaWarning, match="aovs is no part of a scene file"):
        scene.save(path.with_name("other.xml"))


def test_links_to_scenes(path: Path, tmp_path: Path) -> None:
    """Names of files are relative to the file that the link leads to."""
    (tmp_path / "real").mkdir()
    real, link = tmp_path / "real" / "x.xml", tmp_path / "link.xml"
    link.symlink_to("real/x.xml")
    scene = lajolla.load(path)
    scene["ball.radius"] = 0.5
    text = saved_text(scene, real)
    real.unlink()
    scene.save(link)
    assert link.is_symlink() and real.read_text() == text and not (tmp_path / "link-files").exists()


@pytest.mark.parametrize("name", ["ball.xml", "floor.ply", "tiles.png"])
def test_files_of_the_scene_are_not_replaced(path: Path, name: str) -> None:
    file = path.parent / "parts" / name
    before = file.read_bytes()
    with pytest.raises(lajolla.SceneError, match=f'{name}" is a file of this scene'):
        lajolla.load(path).save(file)
    assert file.read_bytes() == before


def test_unusual_targets(path: Path, tmp_path: Path) -> None:
    scene = lajolla.load(path)
    scene["ball.radius"] = 0.5
    for name in ("back\\slash.xml", "line\n.xml", "bell\a.xml", "\udcff.xml"):
        saved_text(scene, tmp_path / name)
    with pytest.raises(lajolla.ImageError, match="is no name of a file"):
        scene.save(tmp_path / "a\0b.xml")
    (tmp_path / "other-files").write_text("a file")
    with pytest.raises(lajolla.ImageError, match=r"other-files/.*: cannot be written"):
        scene.save(tmp_path / "other.xml")
    assert (tmp_path / "other-files").read_text() == "a file" and not (tmp_path / "other.xml").exists()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(lajolla.SceneError, match="no ordinary file"):
        scene.save(pipe)
    assert not (tmp_path / "pipe-files").exists()
    (tmp_path / "a\\b").mkdir()
    path.rename(tmp_path / "a\\b" / "scene.xml")
    (tmp_path / "parts").rename(tmp_path / "a\\b" / "parts")
    with pytest.raises(lajolla.SceneError, match="no scene file can hold the name"):
        lajolla.load(tmp_path / "a\\b" / "scene.xml").save(tmp_path / "other.xml")


def test_damaged_files_are_written_anew(path: Path) -> None:
    scene = lajolla.load(path)
    scene["floor.positions"] = scene["floor.positions"] * 1.5
    scene["floor.bsdf.reflectance.image"] = np.full((2, 2, 3), 0.5, np.float32)
    target = path.with_name("other.xml")
    scene.save(target)
    for file in path.with_name("other-files").iterdir():
        file.write_bytes(b"damaged")
    saved_text(scene, target)
