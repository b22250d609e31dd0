"""Meshes from files as Mitsuba shades them: made normals, parts by material, material libraries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_tools import error_of, messages, read

from lajolla import _core, _core_testing
from lajolla.scene import Description

SQUARES = """mtllib {library}
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl Red One
f 1/1 2/2 3/3 4/4
g second
f 1/1 2/2 6/3
usemtl glass
f 1/1 6/2 5/3
"""
MTL = """# made by hand
newmtl Red One
Kd 1 0 0
illum 1
newmtl glass
illum 4
d 0.25
"""


def write(folder: Path, mtl: str | None = MTL, obj: str = SQUARES) -> None:
    (folder / "m.obj").write_text(obj.format(library="m.mtl"))
    if mtl is not None:
        (folder / "m.mtl").write_text(mtl)


def shape(inside: str = "") -> str:
    return f'<shape type="obj"><string name="filename" value="m.obj"/>{inside}</shape>'


def fronts(description: Description) -> list[dict]:
    """The bsdf of each shape, with the opacity of a mask around it."""
    core = description.core
    found = []
    for made in core["shapes"]:
        part, around = core["materials"][made["material"]]["front"], {}
        while isinstance(part, dict):
            around = core["adapters"][part["adapter"]]
            part = around["child"]
        found.append(core["bsdfs"][part] | {"opacity": around.get("opacity", 1)})
    return found


def test_libraries_are_used_in_old_files(tmp_path: Path) -> None:
    write(tmp_path)
    description = read(tmp_path, shape(), "0.6.0")
    assert not messages(description, tmp_path)
    red, glass = fronts(description)
    assert red["type"] == "diffuse" and list(red["reflectance"]) == [1, 0, 0]
    assert glass["type"] == "dielectric"
    assert red["opacity"] == 1 and glass["opacity"] == 0.25
    assert [len(s["mesh"].faces) for s in description.core["shapes"]] == [3, 1]
    assert len(description.core["shapes"][1]["mesh"].vertices) == 3
    _core.Scene(description.core)


def test_libraries_are_asked_for_in_new_files(tmp_path: Path) -> None:
    write(tmp_path)
    assert len(read(tmp_path, shape()).core["shapes"]) == 1
    assert len(read(tmp_path, shape('<boolean name="load_materials" value="true"/>')).core["shapes"]) == 2
    collapsed = shape('<boolean name="collapse" value="true"/>')
    assert len(read(tmp_path, collapsed, "0.6.0").core["shapes"]) == 1


def test_a_bsdf_of_the_shape_wins(tmp_path: Path) -> None:
    write(tmp_path)
    plain = read(tmp_path, shape('<bsdf type="conductor"/>'), "0.6.0")
    assert [bsdf["type"] for bsdf in fronts(plain)] == ["conductor"]
    named = read(tmp_path, shape('<bsdf type="plastic" name="glass"/>'), "0.6.0")
    assert [bsdf["type"] for bsdf in fronts(named)] == ["diffuse", "plastic"]
    alone = read(tmp_path, shape('<bsdf type="plastic" id="glass"/>'), "0.6.0")
    assert [bsdf["type"] for bsdf in fronts(alone)] == ["plastic"]
    both = shape('<bsdf type="conductor"/><bsdf type="plastic" id="glass"/>')
    assert [bsdf["type"] for bsdf in fronts(read(tmp_path, both))] == ["conductor", "plastic"]


def test_parts_shine_alike(tmp_path: Path) -> None:
    write(tmp_path)
    core = read(tmp_path, shape('<emitter type="area"/>'), "0.6.0").core
    assert [s["emitter"] for s in core["shapes"]] == [0, 1]
    _core.Scene(core)


def test_one_run_of_faces(tmp_path: Path) -> None:
    write(tmp_path)
    for index, faces in ((0, 2), (1, 1), (2, 1)):
        inside = f'<integer name="shapeIndex" value="{index}"/><boolean name="collapse" value="true"/>'
        (made,) = read(tmp_path, shape(inside), "0.6.0").core["shapes"]
        assert len(made["mesh"].faces) == faces
    message = error_of(tmp_path, shape('<integer name="shapeIndex" value="3"/>'), "0.6.0")
    assert "there is no shape 3; the file has 3" in message


def test_shiny_textured_materials(tmp_path: Path) -> None:
    import OpenImageIO as oiio

    buffer = oiio.ImageBuf(oiio.ImageSpec(2, 2, 3, "uint8"))
    buffer.write(str(tmp_path / "wood.png"))
    mtl = """newmtl Red One
map_Kd -s 1 1 1 C:\\textures\\WOOD.png
Ks 0.5 0.5 0.5
Ns 100
illum 2
map_d wood.png
newmtl glass
illum 5
"""
    write(tmp_path, mtl)
    description = read(tmp_path, shape(), "0.6.0")
    shiny, metal = fronts(description)
    assert shiny["type"] in ("phong", "roughplastic") and metal["type"] == "conductor"
    assert "texture" in shiny["diffuse_reflectance"]
    assert "texture" in shiny["opacity"]
    _core.Scene(description.core)


@pytest.mark.parametrize(
    ("mtl", "message"),
    [
        (None, "cannot be read"),
        ("newmtl glass\nKd 1 x 0\n", "line 2"),
        ("newmtl glass\nKd 1\n", "line 2"),
        ("newmtl glass\nillum two\n", "line 2"),
        ("newmtl glass\nd\n", "line 2"),
        ("newmtl glass\nNs inf\n", "line 2"),
        ("newmtl glass\nmap_Kd nowhere.png\n", "nowhere.png"),
    ],
)
def test_broken_libraries_are_told(tmp_path: Path, mtl: str | None, message: str) -> None:
    write(tmp_path, mtl)
    description = read(tmp_path, shape(), "0.6.0")
    assert any(message in text for text in messages(description, tmp_path))
    _core.Scene(description.core)


def test_hostile_libraries(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        data = bytearray(MTL.encode())
        for _ in range(8):
            data[rng.integers(len(data))] = rng.integers(256)
        write(tmp_path)
        (tmp_path / "m.mtl").write_bytes(bytes(data))
        _core.Scene(read(tmp_path, shape(), "0.6.0").core)


# Normals that files do not have

ROOF = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\nf 1 2 3\nf 2 4 3\n"
PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
1 1 0.5
3 0 1 2
3 1 3 2
"""
PLACES = {
    "none": "",
    "even": '<transform name="to_world"><scale value="2"/><rotate x="1" angle="20"/></transform>',
    "mirrored": '<transform name="to_world"><scale x="-1"/></transform>',
    "uneven": '<transform name="to_world"><scale x="3" z="2"/></transform>',
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("flip", ["false", "true"])
@pytest.mark.parametrize("plugin", ["obj", "ply"])
def test_made_normals_are_those_of_mitsuba(plugin: str, flip: str, place: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    (tmp_path / "roof.obj").write_text(ROOF)
    (tmp_path / "roof.ply").write_text(PLY)
    for flat in ("false", "true"):
        body = f"""<shape type="{plugin}"><string name="filename" value="{tmp_path}/roof.{plugin}"/>
          <boolean name="flip_normals" value="{flip}"/><boolean name="face_normals" value="{flat}"/>
          {PLACES[place]}</shape>"""
        core = read(tmp_path, body).core
        matrix = np.asarray(core["shapes"][0].get("to_world", np.eye(4)))
        targets = np.array([[0.2, 0.2, 0], [0.45, 0.5, 0], [0.8, 0.8, 0.3]]) @ matrix[:3, :3].T
        origins = np.add(targets, [0, 0, 9]).astype(np.float32)
        down = np.tile(np.array([[0, 0, -1]], np.float32), (3, 1))
        hits = _core_testing.hit_many(_core.Scene(core), origins, down)
        scene = mi.load_string(f'<scene version="3.0.0"><integrator type="path"/>{body}</scene>')
        for i, origin in enumerate(origins):
            si = scene.ray_intersect(mi.Ray3f(mi.Point3f(*map(float, origin)), mi.Vector3f(0, 0, -1)))
            np.testing.assert_allclose(hits["shading_normal"][i], np.array(si.sh_frame.n), atol=2e-6)


def test_merged_shapes_are_the_shapes_inside(tmp_path: Path) -> None:
    inside = '<shape type="sphere"/><shape type="merge"><shape type="cube"/></shape>'
    merged = f'<shape type="merge">{inside}</shape>'
    core = read(tmp_path, merged).core
    assert [s["type"] for s in core["shapes"]] == ["sphere", "mesh"]
    group = f'<shape type="shapegroup" id="g">{merged}</shape><shape type="instance"><ref id="g"/></shape>'
    core = read(tmp_path, group).core
    assert core["groups"] == [{"shapes": [0, 1]}]


@pytest.mark.parametrize("plugin", ["ellipsoids", "deformable"])
def test_shapes_that_are_not_there_are_told(plugin: str, tmp_path: Path) -> None:
    description = read(tmp_path, f'<shape type="{plugin}"><string name="filename" value="x.ply"/></shape>')
    assert any(f'"{plugin}"' in text and "ignored" in text for text in messages(description, tmp_path))


@pytest.mark.parametrize(("version", "side"), [("0.6.0", 1), ("3.0.0", -1)])
def test_mirrored_spheres_are_inside_out_since_version_2(version: str, side: int, tmp_path: Path) -> None:
    place = "toWorld" if version < "2" else "to_world"
    body = f'<shape type="sphere"><transform name="{place}"><scale z="-1"/></transform></shape>'
    scene = _core.Scene(read(tmp_path, body, version).core)
    hits = _core_testing.hit_many(
        scene, np.array([[0, 0, 5]], np.float32), np.array([[0, 0, -1]], np.float32)
    )
    assert hits["normal"][0, 2] == side


@pytest.mark.parametrize(
    "version, given, expected", [("0.6.0", "", 0.2159), ("0.6.0", "false", 0.502), ("3.0.0", "", 0.502)]
)
def test_colours_of_vertices_in_old_files_are_encoded(
    version: str, given: str, expected: float, tmp_path: Path
) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += "property uchar r\nproperty uchar g\nproperty uchar b\nelement face 1\n"
    corners = "0 0 0 128 128 128\n1 0 0 128 128 128\n0 1 0 128 128 128\n3 0 1 2\n"
    text = header + "property list uchar int vertex_indices\nend_header\n" + corners
    (tmp_path / "a.ply").write_text(text)
    option = f'<boolean name="srgb" value="{given}"/>' if given else ""
    body = f'<shape type="ply"><string name="filename" value="a.ply"/>{option}</shape>'
    mesh = read(tmp_path, body, version).core["shapes"][0]["mesh"]
    assert np.allclose(mesh.attributes["vertex_color"], expected, atol=1e-4)
