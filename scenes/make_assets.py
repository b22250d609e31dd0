"""Makes the textures, the environment and the meshes of the scenes in this folder.

Run it as ``python scenes/make_assets.py``; the files it writes are committed, so scenes render without it.
"""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

FOLDER = Path(__file__).resolve().parent
sys.path.append(str(FOLDER.parent / "tests"))
from ptex_files import DIFFERENCES, Face, Ptx, neighbours_of  # noqa: E402


def write_image(name: str, pixels: np.ndarray, quality: int = 82) -> None:
    """Writes (H, W, 3) pixels: 8-bit sRGB for JPEG and PNG, linear half for EXR."""
    path = str(FOLDER / "textures" / name)
    kind = oiio.HALF if name.endswith(".exr") else oiio.UINT8
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, kind)
    spec.attribute("Compression", "zip" if name.endswith(".exr") else f"jpeg:{quality}")
    spec.attribute("DateTime", "2026:01:01 00:00:00")  # the same bytes every time
    output = oiio.ImageOutput.create(path)
    if not output or not output.open(path, spec) or not output.write_image(pixels.astype(np.float32)):
        raise OSError(f"cannot write {path}: {oiio.geterror()}")
    output.close()


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int], cells: tuple[int, int]) -> np.ndarray:
    """Periodic value noise in [0, 1] with `cells` lattice cells along each axis."""
    lattice = rng.random(cells)
    y, x = (np.arange(n) * c / n for n, c in zip(shape, cells, strict=True))
    y0, x0 = y.astype(int), x.astype(int)
    fy, fx = (3 * f**2 - 2 * f**3 for f in ((y - y0)[:, None], (x - x0)[None, :]))
    y1, x1 = (y0 + 1) % cells[0], (x0 + 1) % cells[1]
    top = lattice[np.ix_(y0, x0)] * (1 - fx) + lattice[np.ix_(y0, x1)] * fx
    bottom = lattice[np.ix_(y1, x0)] * (1 - fx) + lattice[np.ix_(y1, x1)] * fx
    return top * (1 - fy) + bottom * fy


def planks(rng: np.random.Generator, size: int = 512, rows: int = 8) -> np.ndarray:
    """Oak planks along u: each with its own tone, grain and two joints."""
    image = np.zeros((size, size, 3))
    height = size // rows
    for row in range(rows):
        for half in range(2):
            grain = smooth_noise(rng, (height, size // 2), (16, 3)) + smooth_noise(
                rng, (height, size // 2), (32, 6)
            )
            rings = 0.5 + 0.5 * np.sin(14 * smooth_noise(rng, (height, size // 2), (3, 2)) + 2 * grain)
            tone = rng.uniform(0.8, 1.1) * (0.82 + 0.1 * grain + 0.08 * rings)
            plank = tone[..., None] * np.array([0.66, 0.47, 0.31])
            plank[:2] *= 0.45
            plank[:, :2] *= 0.45
            start = (half * size // 2 + row * 181) % size
            columns = (start + np.arange(size // 2)) % size
            image[row * height : (row + 1) * height, columns] = plank
    return np.clip(image, 0, 1)


def rug(rng: np.random.Generator, width: int = 384, height: int = 256) -> np.ndarray:
    """A woven rug: nested borders around rows of diamonds."""
    y, x = np.mgrid[0:height, 0:width]
    edge = np.minimum.reduce([x, y, width - 1 - x, height - 1 - y])
    red, cream, blue = np.array([[0.52, 0.13, 0.12], [0.88, 0.80, 0.64], [0.12, 0.20, 0.36]])
    diamond = (np.abs((x - 16) % 44 - 22) + np.abs((y - 18) % 44 - 22)) // 7
    image = np.where((diamond % 2 == 0)[..., None], red, np.where((diamond == 1)[..., None], cream, blue))
    for outer, inner, colour in ((0, 10, red), (10, 14, cream), (14, 26, blue), (26, 29, cream)):
        image[(edge >= outer) & (edge < inner)] = colour
    weave = 0.9 + 0.1 * ((x + y) % 2) - 0.08 * rng.random((height, width))
    return np.clip(image * weave[..., None], 0, 1)


def painting(width: int = 320, height: int = 224) -> np.ndarray:
    """Hills in the evening: a sun and four ridges, each paler with distance."""
    y, x = np.mgrid[0:height, 0:width] / np.array([height, width])[:, None, None]
    image = np.array([0.96, 0.72, 0.45]) * (1 - y[..., None]) + np.array([0.98, 0.52, 0.38]) * y[..., None]
    image[np.hypot((x - 0.66) * width / height, y - 0.36) < 0.12] = (1.0, 0.90, 0.62)
    for layer in range(4):
        ridge = 0.45 + 0.13 * layer + 0.05 * np.sin(5 * x + 2.1 * layer) + 0.03 * np.sin(13 * x - 1.7 * layer)
        colour = np.array([0.72, 0.40, 0.42]) * (1 - layer / 4) + np.array([0.10, 0.16, 0.24]) * layer / 4
        image[y > ridge] = colour
    return image


def checkerboard(size: int = 128) -> np.ndarray:
    """Two by two squares."""
    i, j = np.indices((size, size)) * 2 // size
    return np.where(((i + j) % 2 == 0)[..., None], (0.85, 0.83, 0.8), (0.05, 0.09, 0.2))


def bricks(size: int = 256, rows: int = 8) -> np.ndarray:
    """The height of bricks with round edges in mortar, periodic, in widths of the picture."""
    y, x = (np.mgrid[0:size, 0:size] + 0.5) / size
    row = np.floor(y * rows)
    across = np.minimum(y * rows % 1, 1 - y * rows % 1) / rows
    place = (x * rows / 2 + row % 2 / 2) % 1
    along = np.minimum(place, 1 - place) * 2 / rows
    edge = np.clip((np.minimum(across, along) - 0.006) / 0.014, 0, 1)
    grain = smooth_noise(np.random.default_rng(5), (size, size), (64, 64))
    return 0.012 * np.sqrt(1 - (1 - edge) ** 2) + 0.0012 * grain


def normals_of(height: np.ndarray) -> np.ndarray:
    """The colours (H, W, 3) of the normals of a periodic height field, in widths of the picture: x along its
    rows, y down its columns, as u and v, and z off the surface, all from [-1, 1] to [0, 1]."""
    slope_x = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) / 2 * height.shape[1]
    slope_y = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) / 2 * height.shape[1]
    normal = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True) / 2 + 0.5


def studio(width: int = 256, height: int = 128) -> np.ndarray:
    """An environment: a grey studio with two soft boxes, a strip light and a warm floor."""
    v, u = np.mgrid[0:height, 0:width] / np.array([height, width])[:, None, None]
    up = np.cos(np.pi * v)
    image = np.where((up > 0)[..., None], 0.10 + 0.25 * up[..., None], 0.06) * np.array([0.85, 0.95, 1.1])
    image[up <= 0] = (0.09, 0.08, 0.07)

    def lamp(
        centre: tuple[float, float], size: tuple[float, float], radiance: tuple[float, float, float]
    ) -> None:
        across = np.abs((u - centre[0] + 0.5) % 1 - 0.5) / size[0]
        along = np.abs(v - centre[1]) / size[1]
        fall = np.clip(6 * (1 - np.maximum(across, along)), 0, 1)
        image[:] = np.maximum(image, fall[..., None] * np.array(radiance))

    lamp((0.12, 0.30), (0.07, 0.12), (9.0, 8.2, 7.0))
    lamp((0.80, 0.34), (0.05, 0.10), (4.0, 4.6, 5.6))
    lamp((0.47, 0.28), (0.02, 0.16), (5.0, 5.0, 5.0))
    return image


def write_ply(
    name: str,
    columns: dict[str, np.ndarray],
    faces: np.ndarray,
    face_columns: dict[str, np.ndarray] | None = None,
) -> None:
    """Writes a binary PLY file with the named float columns of vertices and of triangles (N, 3)."""
    count, named = len(next(iter(columns.values()))), face_columns or {}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {column}" for column in columns]
    header += [f"element face {len(faces)}", "property list uchar ushort vertex_indices"]
    header += [*(f"property float {column}" for column in named), "end_header\n"]
    fields = [(column, "<f4") for column in named]
    rows = np.zeros(len(faces), dtype=[("count", "u1"), ("index", "<u2", 3), *fields])
    rows["count"], rows["index"] = 3, faces
    for column, values in named.items():
        rows[column] = values
    vertices = np.stack(list(columns.values()), axis=1).astype("<f4")
    (FOLDER / "meshes" / name).write_bytes("\n".join(header).encode() + vertices.tobytes() + rows.tobytes())


def revolve(profile: np.ndarray, segments: int = 40) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The surface that the (radius, height) polyline `profile` sweeps about y, with smooth normals."""
    tangent = np.gradient(profile, axis=0)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    angle = np.linspace(0, 2 * np.pi, segments + 1)
    cosine, sine = np.cos(angle), np.sin(angle)
    columns = {
        "x": np.outer(profile[:, 0], cosine),
        "y": np.outer(profile[:, 1], np.ones_like(angle)),
        "z": -np.outer(profile[:, 0], sine),
        "nx": np.outer(normal[:, 0], cosine),
        "ny": np.outer(normal[:, 1], np.ones_like(angle)),
        "nz": -np.outer(normal[:, 0], sine),
    }
    row, column = np.mgrid[0 : len(profile) - 1, 0:segments]
    a = row * (segments + 1) + column
    b = a + segments + 1
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, a + 1, b), (a + 1, b + 1, b))])
    return {key: value.ravel() for key, value in columns.items()}, faces


def vase_profile(samples: int = 40) -> np.ndarray:
    """A vase of height 1: a swelling body, a neck and a flared lip."""
    t = np.linspace(0, 1, samples)
    radius = (
        0.12
        + 0.22 * np.sin(np.pi * np.minimum(t / 0.8, 1)) ** 1.2
        + 0.12 * np.clip((t - 0.78) / 0.22, 0, 1) ** 2
    )
    return np.stack([radius, t], axis=1)


def shade_profile(samples: int = 12) -> np.ndarray:
    """A lamp shade of height 1: a slightly curved cone."""
    t = np.linspace(0, 1, samples)
    return np.stack([0.75 - 0.32 * t + 0.06 * np.sin(np.pi * t), t], axis=1)


def coarse_sphere(segments: int = 16) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """A unit sphere of few faces, with the normals of a true one."""
    down = np.linspace(np.pi, 0, segments // 2 + 1)
    columns, faces = revolve(np.stack([np.abs(np.sin(down)), np.cos(down)], axis=1), segments)
    place = np.stack([columns[axis] for axis in "xyz"], axis=1)
    edge, other = (place[faces[:, i]] - place[faces[:, 0]] for i in (1, 2))
    has_area = np.linalg.norm(np.cross(edge, other), axis=1) > 1e-6
    return {**columns, **{f"n{axis}": columns[axis] for axis in "xyz"}}, faces[has_area]


def noise3(rng: np.random.Generator, points: np.ndarray, cells: int) -> np.ndarray:
    """Smooth value noise in [-1, 1] at points (..., 3), with a lattice of `cells` per unit, periodic."""
    lattice = rng.uniform(-1, 1, (cells, cells, cells))
    scaled = points * cells
    low = np.floor(scaled).astype(int)
    f = scaled - low
    f = f * f * (3 - 2 * f)
    total = np.zeros(points.shape[:-1])
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, f, 1 - f), axis=-1)
        total += weight * lattice[tuple(np.moveaxis((low + corner) % cells, -1, 0))]
    return total


def plume(rng: np.random.Generator, width: int = 44, height: int = 64) -> np.ndarray:
    """The density of rising smoke in [0, 1], (height along y is the second axis; z, y, x)."""
    axes = [(np.arange(n) + 0.5) / n for n in (width, height, width)]
    z, y, x = np.meshgrid(*axes, indexing="ij")
    points = np.stack([x, y * height / width, z], axis=-1)
    bend = np.stack([sum(noise3(rng, points, c) / c for c in (3, 6, 12)) for _ in range(3)], axis=-1)
    x, z = (axis - 0.5 + 0.32 * y**0.7 * bend[..., i] for i, axis in ((0, x), (2, z)))
    x, z = x - 0.1 * np.sin(5 * y), z - 0.06 * np.cos(4 * y)
    radius = 0.07 + 0.24 * y**1.2
    column = 1 - np.hypot(x, z) / radius
    wisps = sum(noise3(rng, points + bend / 9, c) * 2.2 / c**0.6 for c in (6, 12, 24))
    fade = np.clip(12 * y, 0, 1) * np.clip(4.5 * (1 - y), 0, 1)
    return np.clip(1.6 * column + 0.55 * wisps * (0.4 + y), 0, 1) * fade * (1 - 0.45 * y)


def write_volume(name: str, values: np.ndarray) -> None:
    """Writes values (depth, height, width) as a .vol file of 32-bit numbers in the unit cube."""
    depth, height, width = values.shape
    head = struct.pack("<3sB5i6f", b"VOL", 3, 1, width, height, depth, 1, 0, 0, 0, 1, 1, 1)
    (FOLDER / "volumes" / name).write_bytes(head + values.astype("<f4").tobytes())


def knob() -> tuple[np.ndarray, np.ndarray, list[tuple[int, int]]]:
    """A cube of three by three faces a side, whose middle ones are pulled out: vertices, faces and the edges
    of the middle faces."""
    numbers: dict[tuple[int, int, int], int] = {}
    faces, middles = [], []
    for axis, side in np.ndindex(3, 2):
        for i, j in np.ndindex(3, 3):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            face = []
            for a, b in corners if side else corners[::-1]:
                place = np.roll([3 * side, a, b], axis)
                face.append(numbers.setdefault(tuple(int(x) for x in place), len(numbers)))
            faces.append(face)
            if i == j == 1:
                middles.append(face)
    vertices = np.array(list(numbers), float) / 1.5 - 1
    for face in middles:
        centre = vertices[face].mean(0)
        vertices[face] = centre * 1.5 + (vertices[face] - centre) * 1.25
    return vertices, np.array(faces), [(f[k - 1], f[k]) for f in middles for k in range(4)]


def write_surface(name: str, vertices: np.ndarray, faces: np.ndarray, creases: list[tuple[int, int]]) -> None:
    """Writes an OBJ file of polygons, with creases of sharpness 2.5 as tags."""
    lines = [f"v {x:g} {y:g} {z:g}" for x, y, z in vertices.round(6)]
    lines += [f"f {' '.join(str(v + 1) for v in face)}" for face in faces]
    lines += [f"t crease 2/1/0 {a} {b} 2.5" for a, b in creases]
    (FOLDER / "meshes" / name).write_text("\n".join(lines) + "\n")


def rings(vertices: np.ndarray, faces: np.ndarray, size: int = 32) -> np.ndarray:
    """How deep a place is in grooves around the middles of the sides, in [0, 1]: (faces, size, size)."""
    t, s = np.meshgrid(*2 * [(np.arange(size) + 0.5) / size], indexing="ij")
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t])
    places = np.einsum("cyx,fck->fyxk", weights, vertices[faces])
    places /= np.linalg.norm(places, axis=-1, keepdims=True)
    from_axis = np.arccos(np.clip(np.abs(places).max(-1), 0, 1))
    return np.clip(0.5 + 1.1 * np.cos(from_axis * 34), 0, 1)


def write_ptex(name: str, pictures: np.ndarray, faces: np.ndarray) -> None:
    """Writes 8-bit pictures (faces, height, width, channels) of values in [0, 1] as a Ptex file."""
    texels = np.round(255 * pictures)
    around = neighbours_of(faces.tolist())
    content = Ptx([Face(t, *a, encoding=DIFFERENCES) for t, a in zip(texels, around, strict=True)]).content()
    (FOLDER / "textures" / name).write_bytes(content)


def planet(directions: np.ndarray) -> np.ndarray:
    """The colours of a planet, sRGB, in unit directions (..., 3): seas, land and ice with sharp coasts."""
    rng = np.random.default_rng(11)
    height = sum(
        noise3(rng, directions / 2 + 0.5, c) * w for c, w in ((3, 1), (6, 0.6), (12, 0.4), (24, 0.25))
    )
    deep, shallow = np.array([0.05, 0.15, 0.38]), np.array([0.16, 0.44, 0.62])
    low, high = np.array([0.28, 0.46, 0.18]), np.array([0.62, 0.50, 0.32])
    up = height[..., None]
    sea = shallow + (deep - shallow) * np.clip(-2 * up, 0, 1)
    land = low + (high - low) * np.clip(1.6 * up, 0, 1)
    colours = np.where(up > 0, land, sea)
    ice = np.abs(directions[..., 1]) + 0.18 * height > 0.86
    return np.where(ice[..., None], np.array([0.92, 0.94, 0.96]), colours)


def planet_picture(width: int = 1024) -> np.ndarray:
    """The planet in latitude and longitude, for the texture coordinates of `planet_mesh`."""
    v, u = (np.mgrid[0 : width // 2, 0:width] + 0.5) / np.array([width // 2, width])[:, None, None]
    return planet(on_sphere(u, 1 - v))


def on_sphere(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Unit directions (..., 3) of longitude u and latitude v, both in [0, 1]; v = 1 is +y."""
    around, down = 2 * np.pi * u, np.pi * (1 - v)
    ring = np.sin(down)
    return np.stack([ring * np.cos(around), np.cos(down), -ring * np.sin(around)], axis=-1)


def planet_mesh(columns: int) -> tuple[dict[str, np.ndarray], np.ndarray, dict[str, np.ndarray]]:
    """A sphere of 2 x columns x (columns / 2 - 1) triangles, with colours at its vertices and its faces."""
    rows = columns // 2
    v, u = (
        axis.ravel()
        for axis in np.mgrid[0 : rows + 1, 0 : columns + 1] / np.array([rows, columns])[:, None, None]
    )
    place = on_sphere(u, v)
    row, column = (axis.ravel() for axis in np.mgrid[0:rows, 0:columns])
    a = row * (columns + 1) + column
    b = a + columns + 1
    lower, upper = (
        np.stack([a, a + 1, b + 1], axis=-1)[row > 0],
        np.stack([a, b + 1, b], axis=-1)[row < rows - 1],
    )
    faces = np.concatenate([lower, upper])
    middle = place[faces].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    names = ("x", "y", "z", "nx", "ny", "nz", "u", "v", "r", "g", "b")
    vertices = np.concatenate([place, place, np.stack([u, v], axis=1), linear(planet(place))], axis=1)
    colours = dict(zip(("r", "g", "b"), linear(planet(middle)).T, strict=True))
    return dict(zip(names, vertices.T, strict=True)), faces, colours


def linear(srgb: np.ndarray) -> np.ndarray:
    """Linear values of sRGB ones."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def main() -> None:
    """Writes every file."""
    rng = np.random.default_rng(2026)
    for folder in ("textures", "meshes", "volumes"):
        (FOLDER / folder).mkdir(exist_ok=True)
    write_image("planks.jpg", planks(rng))
    write_image("rug.jpg", rug(rng))
    write_image("painting.jpg", painting(), 90)
    write_image("checkerboard.png", checkerboard())
    write_image("brick-normals.png", normals_of(bricks()))
    write_image("studio.exr", studio())
    write_ply("vase.ply", *revolve(vase_profile()))
    write_ply("shade.ply", *revolve(shade_profile(), 32))
    write_ply("coarse-sphere.ply", *coarse_sphere())
    vertices, faces, creases = knob()
    write_surface("knob.obj", vertices, faces, creases)
    depth = rings(vertices, faces)[..., None]
    write_ptex("knob-relief.ptx", 1 - depth, faces)
    glaze, clay = np.array([0.93, 0.90, 0.82]), np.array([0.16, 0.36, 0.55])
    write_ptex("knob.ptx", glaze * (1 - depth) + clay * depth, faces)
    write_image("planet.jpg", planet_picture(), 85)
    for columns in (16, 64):
        write_ply(f"planet-{columns}.ply", *planet_mesh(columns))
    write_volume("smoke.vol", plume(np.random.default_rng(7)))


if __name__ == "__main__":
    main()
