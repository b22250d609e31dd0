"""What the mesh readers read, and what they say about files with an error."""

import struct
import time
from pathlib import Path

import numpy as np
import pytest
from mesh_files import (
    FACES,
    PLY_FORMATS,
    PLY_TYPES,
    SQUARE,
    TRIANGLE,
    Loader,
    check,
    loader,
    ply,
    serialized,
    serialized_payload,
    vertex_element,
)

from lajolla import _core


@pytest.fixture
def load(tmp_path: Path) -> Loader:
    return loader(tmp_path)


def area(mesh: _core.Mesh) -> float:
    """Total surface area, in float64."""
    a, b, c = mesh.vertices.astype(np.float64)[mesh.faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


# OBJ


def test_obj_shares_equal_corners_and_splits_others(load: Loader) -> None:
    mesh = load("obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt .5 1\nf 1/1 2/1 3/1\nf 1/1 3/2 4/1\n")
    check(mesh)
    assert len(mesh.vertices) == 5
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 3, 4]])
    np.testing.assert_array_equal(mesh.vertices[3], mesh.vertices[2])
    np.testing.assert_array_equal(mesh.uvs[[2, 3]], [[0, 0], [0.5, 1]])
    assert mesh.normals is None and mesh.groups == [] and mesh.attributes == {}


def test_obj_indices_may_count_backwards_and_polygons_become_fans(load: Loader) -> None:
    mesh = load("obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4 -3 -2 -1\nf 1 2\n")
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], SQUARE[[[0, 1, 2], [0, 2, 3]]])


def test_obj_corners_are_shared_in_whatever_order_they_return(load: Loader) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 1\n" + "f 1/1 2/1 3/1\nf 1/2 2/2 3/1\n" * 3
    mesh = load("obj", text)
    assert len(mesh.vertices) == 5
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [3, 4, 2]] * 3)


@pytest.mark.parametrize("corner", ["{}", "{}/", "{}//", "{}/1", "{}/1/", "{}//1", "{}/1/1"])
def test_obj_corner_notations(load: Loader, corner: str) -> None:
    face = " ".join(corner.format(i) for i in (1, 2, 3))
    mesh = load("obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt .25 .75\nvn 0 0 -2\nf {face}\n")
    check(mesh)
    np.testing.assert_array_equal(mesh.vertices, TRIANGLE)
    assert (mesh.uvs is not None) == ("/1" in corner.replace("//1", ""))
    assert (mesh.normals is not None) == (corner.count("/") == 2 and corner.endswith("1"))
    if mesh.uvs is not None:
        np.testing.assert_array_equal(mesh.uvs, [[0.25, 0.75]] * 3)
    if mesh.normals is not None:
        np.testing.assert_array_equal(mesh.normals, [[0, 0, -1]] * 3)


def test_obj_notation_of_other_programs(load: Loader) -> None:
    text = (
        "\ufeff# a comment that ends with a backslash \\\r\n"
        "  v 0 0 9.42e-010\r\n\tv\t+1.0 \\\r\n  0 1e-400 # comment\r\nv 0 1. -0\r\n"
        "s off\r\ng a b\r\no thing\r\nl 1 2\r\n"
        "f 1 \\\n 2 \\\r\n 3"
    )
    mesh = load("obj", text)
    check(mesh)
    np.testing.assert_allclose(mesh.vertices, TRIANGLE, atol=1e-9)
    assert mesh.vertices[0, 2] == np.float32(9.42e-10)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2]])


def test_obj_missing_normals_and_coordinates_are_filled_in(load: Loader) -> None:
    vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    mesh = load("obj", vertices + "vt .5 .5\nvn 1 0 0\nvn 1.#QNAN -nan(ind) inf\nf 1/1/1 2//2 3\n")
    check(mesh)
    np.testing.assert_array_equal(mesh.normals, [[1, 0, 0], [0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(mesh.uvs, [[0.5, 0.5], [0, 0], [0, 0]])


def test_obj_vertex_colors(load: Loader) -> None:
    mesh = load("obj", "v 0 0 0\nv 1 0 0 .25 .5 .75\nv 0 1 0 1\nf 1 2 3\n")
    np.testing.assert_array_equal(mesh.attributes["vertex_color"], [[1, 1, 1], [0.25, 0.5, 0.75], [1, 1, 1]])


def test_obj_triangles_are_grouped_by_material(load: Loader) -> None:
    vertices = "".join(f"v {i} 0 0\nv {i} 1 0\nv {i} 0 1\n" for i in range(4))
    faces = "f 1 2 3\nusemtl red paint\nf 4 5 6\nusemtl blue#2\nf 7 8 9\nusemtl red paint\nf 10 11 12\n"
    faces += "usemtl unused\n"
    mesh = load("obj", "mtllib my scene.mtl  other.mtl\nmtllib third\n" + vertices + faces)
    check(mesh)
    assert [tuple(group) for group in mesh.groups] == [("", 0, 1), ("red paint", 1, 2), ("blue#2", 3, 1)]
    assert mesh.material_libraries == ["my scene.mtl", "other.mtl", "third"]
    np.testing.assert_array_equal(mesh.vertices[mesh.faces[:, 0], 0], [0, 1, 3, 2])


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_obj_names_may_be_latin_1(load: Loader, encoding: str) -> None:
    mesh = load("obj", "mtllib möbel.mtl\nv 0 0 0\nusemtl grün\nf 1 1 1\n".encode(encoding))
    assert [tuple(group) for group in mesh.groups] == [("grün", 0, 1)]
    assert mesh.material_libraries == ["möbel.mtl"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 nan 0\nf 1 1 2\n", "line 3: face: vertex 2 is not finite"),
        ("v 0 0 1e39\nf 1 1 1\n", "line 2: face: vertex 1 is not finite"),
        ("v 0 0\n", "line 1: vertex position: expected 3 numbers, found 2"),
        ("v 0 0 x1\n", "line 1: vertex position: expected a number, found 'x1'"),
        ("v 0 0 0\n\nf 1 1 2\n", r"line 3: face: there is no vertex 2 \(1 so far\)"),
        ("v 0 0 0\nf 1 1 0\n", "line 2: face: there is no vertex 0"),
        ("v 0 0 0\nf 1 1 -2\n", "line 2: face: there is no vertex -2"),
        ("v 0 0 0\nf 1/1 1 1\n", "line 2: face: there is no texture coordinate 1"),
        ("v 0 0 0\nf 1//1 1 1\n", "line 2: face: there is no normal 1"),
        ("v 0 0 0\nf 1 1 1.5\n", "line 2: face: expected v, v/vt, v//vn or v/vt/vn, found '.5'"),
        ("v 0 0 0\nf 1 1 99999999999999999999\n", "line 2: face: expected the index of a vertex"),
        ("", "this is no OBJ file: it has no vertices"),
        ("\x89PNG\r\n\x1a\n\0\0\0", "this is no OBJ file: it has no vertices"),
    ],
)
def test_obj_errors_say_where(load: Loader, text: str, message: str) -> None:
    with pytest.raises(_core.MeshError, match=message):
        load("obj", text)


# PLY


@pytest.mark.parametrize("file_format", PLY_FORMATS)
@pytest.mark.parametrize("kind", PLY_TYPES)
def test_ply_types(load: Loader, file_format: str, kind: str) -> None:
    corners = np.array([[0, 1, 2], [3, 127, 5], [2, 0, 9]])
    vertices = ("vertex", [f"{kind} x", f"{kind} y", f"{kind} z"], corners.tolist())
    mesh = load("ply", ply(file_format, vertices, ("face", [f"list int {kind} vertex_index"], [[[2, 0, 1]]])))
    check(mesh)
    np.testing.assert_array_equal(mesh.vertices, corners)
    np.testing.assert_array_equal(mesh.faces, [[2, 0, 1]])


@pytest.mark.parametrize("kind", [k for k, code in PLY_TYPES.items() if code[0] != "f"])
@pytest.mark.parametrize("file_format", PLY_FORMATS)
def test_ply_list_length_types(load: Loader, file_format: str, kind: str) -> None:
    mesh = load(
        "ply",
        ply(file_format, vertex_element([]), ("face", [f"list {kind} int vertex_indices"], [[[0, 1, 2, 3]]])),
    )
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("file_format", PLY_FORMATS)
def test_ply_half_precision_values(load: Loader, file_format: str) -> None:
    values = [0.333251953125, -65504.0, 5.960464477539063e-08]
    vertices = ("vertex", ["half x", "half y", "half z"], [values])
    np.testing.assert_array_equal(
        load("ply", ply(file_format, vertices, (*FACES[:2], []))).vertices, [values]
    )


@pytest.mark.parametrize("file_format", PLY_FORMATS)
@pytest.mark.parametrize("names", [("u", "v"), ("s", "t"), ("texture_u", "texture_v")])
def test_ply_normals_and_coordinates(load: Loader, file_format: str, names: tuple[str, str]) -> None:
    columns = ["float nx", "double ny", "float nz", *(f"float {name}" for name in names)]
    extra = np.array([[0, 0, 3, 0.25, 0.5]] * 4)
    mesh = load("ply", ply(file_format, vertex_element(columns, extra), FACES))
    check(mesh)
    np.testing.assert_array_equal(mesh.vertices, SQUARE)
    np.testing.assert_array_equal(mesh.normals, [[0, 0, 1]] * 4)
    np.testing.assert_array_equal(mesh.uvs, [[0.25, 0.5]] * 4)
    assert mesh.attributes == {}


@pytest.mark.parametrize("file_format", PLY_FORMATS)
@pytest.mark.parametrize(
    ("columns", "values", "expected"),
    [
        (["uchar red", "uchar green", "uchar blue"], [255, 51, 0], {"vertex_color": [1, 0.2, 0]}),
        (
            ["uchar red", "uchar green", "uchar blue", "uchar alpha"],
            [255, 51, 0, 9],
            {"vertex_color": [1, 0.2, 0]},
        ),
        (["ushort r", "ushort g", "ushort b"], [65535, 13107, 0], {"vertex_color": [1, 0.2, 0]}),
        (["float r", "float g", "float b"], [2, 0.5, 0], {"vertex_color": [2, 0.5, 0]}),
        (["float tint_r", "float tint_g", "float tint_b"], [2, 0.5, 0], {"vertex_tint_color": [2, 0.5, 0]}),
        (["float a_0", "float a_1", "float a_2"], [2, 0.5, 0], {"vertex_a": [2, 0.5, 0]}),
        (["float a_1", "float a_2", "float a_3"], [2, 0.5, 0], {"vertex_a": [2, 0.5, 0]}),
        (["float a_b_x", "float a_b_y", "float a_b_z"], [2, 0.5, 0], {"vertex_a_b": [2, 0.5, 0]}),
        (["uchar w_0", "float v_x"], [200, 3], {"vertex_w": [200], "vertex_v": [3]}),
        (["float a_0", "float b_0", "float a_1"], [2, 3, 4], {"vertex_a": [2], "vertex_b": [3]}),
        (["float a_x", "float a_y"], [1, 2], {}),
        (["float confidence", "float _x", "float w_long"], [1, 2, 3], {}),
    ],
)
def test_ply_attributes(
    load: Loader,
    file_format: str,
    columns: list[str],
    values: list[float],
    expected: dict[str, list[float]],
) -> None:
    mesh = load("ply", ply(file_format, vertex_element(columns, np.array([values] * 4)), FACES))
    check(mesh)
    assert set(mesh.attributes) == set(expected)
    for name, value in expected.items():
        np.testing.assert_allclose(np.reshape(mesh.attributes[name], (4, -1)), [value] * 4, rtol=1e-6)


@pytest.mark.parametrize("kind, value, expected", [("uchar", 128, 0.2158605), ("float", 0.5, 0.5)])
def test_ply_integer_colours_may_be_encoded(load: Loader, kind: str, value: float, expected: float) -> None:
    properties = [*(f"float {axis}" for axis in "xyz"), *(f"{kind} {c}" for c in ("red", "green", "blue"))]
    rows = [[*p, value, value, value] for p in TRIANGLE.tolist()]
    face = ("face", ["list uchar int vertex_indices"], [[[0, 1, 2]]])
    content = ply("ascii", ("vertex", properties, rows), face)
    encoded = load("ply", content, False, True).attributes["vertex_color"]
    assert np.allclose(encoded, expected, atol=1e-6)
    plain = load("ply", content).attributes["vertex_color"]
    assert np.allclose(plain, value / 255 if kind == "uchar" else value)


@pytest.mark.parametrize("file_format", PLY_FORMATS)
def test_ply_faces_of_any_size_with_attributes(load: Loader, file_format: str) -> None:
    columns = [
        "float w_0",
        "list int short vertex_indices",
        "list uchar float ignored",
        "uchar r",
        "uchar g",
        "uchar b",
    ]
    rows = [[1, [0, 1, 2, 3], [], 255, 0, 0], [2, [0, 1], [7], 0, 255, 0], [3, [3, 2, 1], [7, 8], 0, 0, 255]]
    mesh = load("ply", ply(file_format, ("face", columns, rows), vertex_element([])))
    check(mesh)
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [0, 2, 3], [3, 2, 1]])
    np.testing.assert_array_equal(np.ravel(mesh.attributes["face_w"]), [1, 1, 3])
    np.testing.assert_array_equal(mesh.attributes["face_color"], [[1, 0, 0], [1, 0, 0], [0, 0, 1]])


def star(corners: int, seed: int) -> np.ndarray:
    """A polygon around its middle with random radii, in a random plane: concave, but not crossing itself."""
    random = np.random.default_rng(seed)
    angle, radius = 2 * np.pi * np.arange(corners) / corners, random.uniform(0.4, 1, corners)
    radius[1] = 0.1
    flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1) * radius[:, None]
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    return (flat @ turn.T + random.normal(size=3)).astype(np.float32)


@pytest.mark.parametrize("kind", ["obj", *PLY_FORMATS])
@pytest.mark.parametrize("corners", [5, 6, 30, 200])
def test_concave_polygons_are_cut_within_their_outline(load: Loader, kind: str, corners: int) -> None:
    """All triangles face the same way and cover the polygon once; fans would not."""
    points, found = star(corners, corners), range(corners)
    if kind == "obj":
        lines = [f"v {' '.join(map(str, p))}" for p in points.tolist()]
        text = "\n".join([*lines, "f " + " ".join(str(i + 1) for i in found), ""])
        mesh = load("obj", text)
    else:
        face = ("face", ["list int int vertex_indices"], [[list(found)]])
        rows = ("vertex", ["float x", "float y", "float z"], points.tolist())
        mesh = load("ply", ply(kind, rows, face))
    assert len(mesh.faces) == corners - 2 and mesh.mended
    outline = points.astype(float)
    whole = np.cross(outline, np.roll(outline, -1, 0)).sum(0) / 2
    p = mesh.vertices[mesh.faces].astype(float)
    areas = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) @ whole / np.linalg.norm(whole) / 2
    assert np.all(areas > -1e-6) and np.isclose(areas.sum(), np.linalg.norm(whole), rtol=1e-5)


def test_odd_polygons_become_fans(load: Loader) -> None:
    """Convex ones, those without an area, and the rest of one that crosses itself all over."""
    square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 0 0\n"
    for face in ("1 2 3 4", "1 5 2 3 4", "1 2 1 2", "1 1 1 1"):
        mesh = load("obj", f"{square}f {face}\n")
        fan = [[0, i - 1, i] for i in range(2, len(face.split()))]
        assert not mesh.mended and len(mesh.faces) == len(fan)
    random = np.random.default_rng(1)
    count = 3000
    lines = [f"v {x} {y} 0" for x, y in random.random((count, 2)).round(4)]
    start = time.perf_counter()
    mesh = load("obj", "\n".join([*lines, "f " + " ".join(str(i + 1) for i in range(count)), ""]))
    assert len(mesh.faces) == count - 2 and time.perf_counter() - start < 2


WEDGES = ["list uchar int vertex_indices", "list uchar float texcoord", "int texnumber"]


@pytest.mark.parametrize("file_format", PLY_FORMATS)
@pytest.mark.parametrize("faces_first", [False, True])
def test_ply_coordinates_of_corners_split_vertices(load: Loader, file_format: str, faces_first: bool) -> None:
    """As MeshLab writes them. Copies have what their vertex has; a face without has those of its vertices."""
    position = ["float x", "float y", "float z", "float s", "float t", "float heat_0"]
    vertices = [[*p, 0.25, 0.75, i] for i, p in enumerate(SQUARE.tolist())]
    square = [0, 0, 1, 0, 1, 1, 0, 1]
    seam = [0, 0, 0.5, 0.5, 1, 1]
    faces = [[[0, 1, 2, 3], square, 0], [[0, 2, 3], seam, 0], [[0, 1, 3], [], 0]]
    elements = [("vertex", position, vertices), ("face", WEDGES, faces)]
    mesh = load("ply", ply(file_format, *(elements[::-1] if faces_first else elements)))
    rest = [[0.0, 0.0]] * 3 if faces_first else [[0.25, 0.75]] * 3
    expected = [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1], [0, 0], [0.5, 0.5], [1, 1]]
    assert mesh.uvs[mesh.faces].reshape(-1, 2).tolist() == [*expected, *rest]
    corners = [0, 1, 2, 0, 2, 3, 0, 2, 3, 0, 1, 3]
    assert np.array_equal(mesh.vertices[mesh.faces].reshape(-1, 3), SQUARE[corners])
    assert mesh.attributes["vertex_heat"][mesh.faces].ravel().tolist() == corners
    assert len(mesh.vertices) == len(mesh.uvs) == (8 if faces_first else 9)


def test_ply_vertex_with_many_coordinates(load: Loader) -> None:
    """A fan around one vertex, whose corners there all differ, takes no longer than any other."""
    count = 200_000
    faces = np.zeros(count, [("n", "u1"), ("at", "<i4", 3), ("m", "u1"), ("uv", "<f4", 6), ("number", "<i4")])
    faces["n"], faces["m"], faces["at"] = 3, 6, (0, 1, 2)
    faces["uv"][:, 0] = np.arange(count)
    header = ply("binary_little_endian", ("vertex", ["float x", "float y", "float z"], TRIANGLE.tolist()))
    text, body = header.split(b"end_header\n")
    lines = "".join(f"property {p}\n" for p in WEDGES).encode()
    content = text + b"element face %d\n" % count + lines + b"end_header\n" + body + faces.tobytes()
    start = time.perf_counter()
    assert len(load("ply", content).vertices) == count + 2
    assert time.perf_counter() - start < 5


@pytest.mark.parametrize("file_format", PLY_FORMATS)
def test_ply_skips_unknown_elements_and_reads_strips(load: Loader, file_format: str) -> None:
    junk = ("junk", ["list uchar double a", "char b"], [[[1, 2], 3], [[], 4]])
    strips = ("tristrips", ["list int int vertex_indices"], [[[0, 1, 2, 3, -1, 3, 2, 1]]])
    empty = ("nothing", [], [[]] * 5)
    mesh = load("ply", ply(file_format, junk, vertex_element([]), empty, strips))
    np.testing.assert_array_equal(mesh.faces, [[0, 1, 2], [2, 1, 3], [3, 2, 1]])


def test_ply_header_may_have_windows_line_ends(load: Loader) -> None:
    header, body = ply("binary_little_endian", vertex_element([]), FACES).split(b"end_header\n", 1)
    mesh = load("ply", header.replace(b"\n", b"\r\n") + b"obj_info x\r\nend_header\r\n" + body)
    np.testing.assert_array_equal(mesh.vertices, SQUARE)


HEADER = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
FACE_HEADER = "element face {}\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "this is no PLY file"),
        ("ply\nformat ascii 1.0\n", "the file ends before 'end_header'"),
        ("ply\nend_header\n", "line 2: PLY header: there is no 'format' line"),
        ("ply\nformat ascii 2.0\n", "line 2: PLY header: unknown version '2.0'"),
        ("ply\nformat utf 1.0\n", "line 2: PLY header: unknown format 'utf'"),
        ("ply\nelement vertex -1\n", "line 2: PLY header: expected a count, found '-1'"),
        ("ply\nelement vertex 99999999999\n", "line 2: PLY header: more than"),
        ("ply\nproperty float x\n", "line 2: PLY header: a property stands before the first element"),
        ("ply\nelement vertex 1\nproperty quad x\n", "line 3: PLY header: unknown type 'quad'"),
        ("ply\nelement a 1\nproperty list float int x\n", "the length of a list must have an integer type"),
        ("ply\nelement vertex 1\nproperty float\n", "line 3: PLY header: expected the name of a property"),
        ("ply\nformat ascii 1.0\nfoo\n", "line 3: PLY header: unknown keyword 'foo'"),
        (HEADER.format("ascii", 1) + "end_header\n0 0 0\n", "there is no element 'face'"),
        (
            HEADER.format("ascii", 4000000000) + FACE_HEADER.format(1),
            "too short for 4000000000 of element 'vertex'",
        ),
        (
            HEADER.format("binary_little_endian", 4000000000) + FACE_HEADER.format(1),
            "byte [0-9]+: the file is too short",
        ),
        (HEADER.format("ascii", 1) + FACE_HEADER.format(1) + "0 0 nan\n3 0 0 0\n", "vertex 0 is not finite"),
        (
            HEADER.format("ascii", 1) + FACE_HEADER.format(1) + "0 0 0\n3 0 0 1\n",
            "line 11: a face refers to a vertex",
        ),
        (
            HEADER.format("ascii", 1) + FACE_HEADER.format(1) + "0 0 0\n3 0 0 .5\n",
            "line 11: a face refers to a vertex",
        ),
        (
            HEADER.format("ascii", 1) + FACE_HEADER.format(1) + "0 0 0\n-3 0 0 0\n",
            "line 11: the list 'vertex_indices'",
        ),
        (HEADER.format("ascii", 1) + FACE_HEADER.format(1) + "0 0 0\n3 0 0\n", "the file ends too early"),
        (
            HEADER.format("ascii", 1) + FACE_HEADER.format(1) + "0 0 0\n3 0 0 x\n",
            "expected a number, found 'x'",
        ),
        (
            "ply\nformat ascii 1.0\nelement vertex 0\nelement face 0\nend_header\n",
            "the vertices have no x, y and z",
        ),
    ],
)
def test_ply_errors_say_where(load: Loader, text: str, message: str) -> None:
    with pytest.raises(_core.MeshError, match=message):
        load("ply", text)


# Serialized

RIGHT = np.array([[0, 1, 2]])


@pytest.mark.parametrize("version", [3, 4])
@pytest.mark.parametrize("dtype", ["<f4", "<f8"])
def test_serialized_round_trip(load: Loader, version: int, dtype: str) -> None:
    name = "näme" if version == 4 else None
    arrays = {"normals": TRIANGLE + 1, "uvs": TRIANGLE[:, :2] / 4, "colors": TRIANGLE / 2}
    payloads = [
        serialized_payload(TRIANGLE, RIGHT, name, dtype=dtype),
        serialized_payload(SQUARE, np.array([[0, 1, 2], [0, 2, 3]]), name, dtype=dtype),
        serialized_payload(TRIANGLE, RIGHT, name, dtype=dtype, **arrays),
        serialized_payload(TRIANGLE, RIGHT, name, dtype=dtype, face_normals=True, **arrays),
    ]
    meshes = [load("serialized", serialized(payloads, version), index) for index in range(len(payloads))]
    for mesh in meshes:
        check(mesh)
    assert meshes[0].normals is None and meshes[0].uvs is None and meshes[0].attributes == {}
    np.testing.assert_array_equal(meshes[1].vertices, SQUARE)
    np.testing.assert_array_equal(meshes[1].faces, [[0, 1, 2], [0, 2, 3]])
    unit = (TRIANGLE + 1) / np.linalg.norm(TRIANGLE + 1, axis=1, keepdims=True)
    np.testing.assert_allclose(meshes[2].normals, unit, rtol=1e-6)
    assert meshes[3].normals is None
    for mesh in meshes[2:]:
        np.testing.assert_array_equal(mesh.uvs, arrays["uvs"])
        np.testing.assert_array_equal(mesh.attributes["vertex_color"], arrays["colors"])


def test_serialized_mesh_larger_than_the_reading_buffer(load: Loader) -> None:
    vertices = np.random.default_rng(1).standard_normal((100_000, 3)).astype(np.float32)
    faces = np.arange(99_999).reshape(-1, 3)
    mesh = load("serialized", serialized([serialized_payload(vertices, faces)], 3), 0)
    np.testing.assert_array_equal(mesh.vertices, vertices)
    np.testing.assert_array_equal(mesh.faces, faces)


def test_serialized_errors_say_what_is_wrong(load: Loader) -> None:
    good = serialized_payload(TRIANGLE, RIGHT, "a")
    file = serialized([good, good], 4)
    corrupt = file[:8] + bytes([file[8] ^ 0xFF]) + file[9:]
    claims = struct.pack("<I", 0x1000) + b"a\0" + struct.pack("<QQ", 4_000_000_000, 4_000_000_000)
    cases = [
        (b"", 0, "byte 0: the file ends too early"),
        (b"nonsense", 0, "byte 0: no serialized mesh starts here"),
        (serialized([good], 5), 0, "version 5 of the serialized format is not supported"),
        (file, 2, "there is no mesh 2, the file holds 2"),
        (file, -1, "there is no mesh -1, the file holds 2"),
        (
            file[:-20] + struct.pack("<QQI", 0, 1 << 60, 2),
            1,
            "the offset of mesh 1 lies behind the end of the file",
        ),
        (file[:-4] + struct.pack("<I", 0xFFFFFFFF), 1, "too short for a dictionary of 4294967295 meshes"),
        (file[:20], 0, "mesh at byte 4: the file ends too early"),
        (corrupt, 0, "mesh at byte 4: the compressed data is damaged"),
        (serialized([good[:-1]], 4), 0, "the compressed data holds less than the mesh needs"),
        (serialized([claims], 4), 0, "the compressed data holds less than the mesh needs"),
        (serialized([good[:6] + b"\xff" * 16], 4), 0, "claims more than"),
        (
            serialized([serialized_payload(TRIANGLE, RIGHT + 1, "a")], 4),
            0,
            "a triangle refers to vertex 3 of 3",
        ),
        (serialized([serialized_payload(np.full_like(TRIANGLE, np.inf), RIGHT, "a")], 4), 0, "is not finite"),
    ]
    for data, index, message in cases:
        with pytest.raises(_core.MeshError, match=message):
            load("serialized", data, index)


# All


@pytest.mark.parametrize("kind", ["obj", "ply", "serialized"])
def test_v_may_run_the_other_way(tmp_path: Path, kind: str) -> None:
    uvs = TRIANGLE[:, :2] / 4
    path = tmp_path / f"mesh.{kind}"
    path.write_bytes(
        {
            "obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt .25 0\nvt 0 .25\nf 1/1 2/2 3/3\n",
            "ply": ply(
                "ascii",
                ("vertex", [f"float {name}" for name in "xyzuv"], np.hstack([TRIANGLE, uvs]).tolist()),
                ("face", ["list uchar int vertex_indices"], [[[0, 1, 2]]]),
            ),
            "serialized": serialized([serialized_payload(TRIANGLE, RIGHT, uvs=uvs)], 3),
        }[kind]
    )
    read = getattr(_core, f"load_{kind}")
    np.testing.assert_array_equal(read(path).uvs, uvs)
    np.testing.assert_array_equal(read(path, flip_uvs=True).uvs, uvs * [1, -1] + [0, 1])


# Real files


def test_shared_scenes_agree_with_an_independent_reader(shared_scenes: Path) -> None:
    mi = pytest.importorskip("mitsuba", reason="the independent reader is the mitsuba package")
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    compared = 0
    for path in sorted(p for p in shared_scenes.rglob("*") if p.suffix in (".obj", ".ply", ".serialized")):
        kind = path.suffix[1:]
        for index in range(1000) if kind == "serialized" else [None]:
            extra = () if index is None else (index,)
            try:
                mesh = getattr(_core, f"load_{kind}")(path, *extra)
            except _core.MeshError as error:
                assert index and "there is no mesh" in str(error), path
                break
            check(mesh)
            expected = mi.load_dict(
                {"type": kind, "filename": str(path), **({"shape_index": index} if index else {})}
            )
            box = expected.bbox()
            assert (len(mesh.vertices), len(mesh.faces)) == (
                expected.vertex_count(),
                expected.face_count(),
            ), path
            np.testing.assert_allclose(mesh.vertices.min(axis=0), box.min, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(mesh.vertices.max(axis=0), box.max, rtol=1e-6, atol=1e-6)
            assert area(mesh) == pytest.approx(expected.surface_area(), rel=1e-3), path
            assert (mesh.uvs is not None) == expected.has_vertex_texcoords(), path
            compared += 1
    assert compared > 0


@pytest.mark.parametrize("kind", ["obj", "ply", "serialized"])
def test_vertices_that_nothing_uses_may_be_no_numbers(load: Loader, kind: str) -> None:
    """They change neither the surface nor its bounds."""
    points = np.append(TRIANGLE + np.float32(5), np.full((1, 3), np.nan, np.float32), axis=0)
    lines = "".join(f"{x} {y} {z}\n" for x, y, z in points)
    content: str | bytes
    if kind == "obj":
        content = "".join(f"v {line}\n" for line in lines.splitlines()) + "f 1 2 3\n"
    elif kind == "ply":
        content = HEADER.format("ascii", 4) + FACE_HEADER.format(1) + lines + "3 0 1 2\n"
    else:
        content = serialized([serialized_payload(points, RIGHT, "a")], 4)
    mesh = load(kind, content)
    check(mesh)
    np.testing.assert_allclose(mesh.vertices.min(axis=0), TRIANGLE.min(axis=0) + 5)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), TRIANGLE.max(axis=0) + 5)
