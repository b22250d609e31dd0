"""Small scenes from descriptions, shapes for them, and t-tests of what they look like."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats
from statistics_tools import LEVEL, ROUNDING, SEED, require

from lajolla import _core

Settings = dict[str, object]

PINHOLE: Settings = {"type": "box", "radius": 1e-3}  # a pixel sees what its centre sees
BATCHES = 32  # independent renders of a scene that a mean is made of


def translation(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def scaling(x: float, y: float | None = None, z: float | None = None) -> np.ndarray:
    return np.diag([x, x if y is None else y, x if z is None else z, 1])


def rotation(axis: Sequence[float], degrees: float) -> np.ndarray:
    """Rodrigues' formula."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    matrix = np.eye(4)
    matrix[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def look_at(origin: Sequence[float], target: Sequence[float]) -> np.ndarray:
    """Camera to world; the camera looks along +z."""
    forward = np.subtract(target, origin).astype(float)
    forward /= np.linalg.norm(forward)
    side = np.cross((0, 1, 0) if abs(forward[1]) < 0.9 else (1, 0, 0), forward)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :] = np.stack([side, np.cross(forward, side), forward, np.asarray(origin, float)], axis=1)
    return matrix


def front_view(distance: float, width: float) -> Settings:
    """Parallel rays down onto the plane z = 0."""
    return {
        "type": "orthographic",
        "to_world": look_at((0, 0, distance), (0, 0, 0)) @ scaling(width / 2, width / 2, 1),
    }


def area(radiance: object = 1) -> Settings:
    """A light for a shape."""
    return {"type": "area", "radiance": radiance}


def uv_sphere(columns: int, rows: int, *, smooth: bool) -> _core.Mesh:
    """The unit sphere in triangles; smooth ones have its normals at their vertices."""
    return surface_mesh(
        lambda u, v: np.stack(
            [np.sin(np.pi * v) * np.cos(u), np.sin(np.pi * v) * np.sin(u), np.cos(np.pi * v)], axis=-1
        ),
        columns,
        rows,
        (lambda p: p) if smooth else None,
    )


def torus(columns: int, rows: int) -> _core.Mesh:
    """A faceted torus around z with radii 1 and 0.4: parts of it hide others."""

    def point(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        ring = 1 - 0.4 * np.cos(2 * np.pi * v)
        return np.stack([ring * np.cos(u), ring * np.sin(u), 0.4 * np.sin(2 * np.pi * v)], axis=-1)

    return surface_mesh(point, columns, rows, None)


def surface_mesh(
    point: Callable[[np.ndarray, np.ndarray], np.ndarray],
    columns: int,
    rows: int,
    normal: Callable[[np.ndarray], np.ndarray] | None,
) -> _core.Mesh:
    """A grid of point(angle in [0, 2 pi], v in [0, 1]) without the triangles that have no area."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, columns + 1), np.linspace(0, 1, rows + 1))
    vertices = point(u, v).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(columns), np.arange(rows))
    a = (j * (columns + 1) + i).ravel()
    b, c, d = a + 1, a + columns + 1, a + columns + 2
    faces = np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)])
    p = vertices[faces]
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    faces = faces[area > 1e-9 * area.max()]
    return _core.Mesh(
        vertices.astype(np.float32),
        faces.astype(np.uint32),
        None if normal is None else normal(vertices).astype(np.float32),
        np.stack([u / (2 * np.pi), v], -1).reshape(-1, 2).astype(np.float32),
    )


def box_mesh() -> _core.Mesh:
    """The cube from -1 to 1 with faces that look outwards and share vertices."""
    vertices = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float32)
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return _core.Mesh(vertices, np.array(faces, np.uint32))


def make_scene(
    *,
    shapes: Sequence[Settings] = (),
    groups: Sequence[Settings] = (),
    instances: Sequence[Settings] = (),
    emitters: Sequence[Settings] = (),
    bsdfs: Sequence[Settings] = ({"type": "diffuse", "reflectance": 1},),
    adapters: Sequence[Settings] = (),
    materials: Sequence[Settings] = ({"front": 0, "back": 0},),
    textures: Sequence[Settings] = (),
    sensor: Settings | None = None,
    size: tuple[int, int] = (8, 8),
    film: Settings | None = None,
    rfilter: Settings | None = None,
    sampler: str = "independent",
    robust: bool | None = None,
    **integrator: object,
) -> _core.Scene:
    """A scene; `integrator` holds the fields of the path tracer, or of another `type`."""
    return _core.Scene(
        {
            "textures": list(textures),
            "bsdfs": list(bsdfs),
            "adapters": list(adapters),
            "materials": list(materials),
            "emitters": list(emitters),
            "shapes": list(shapes),
            "groups": list(groups),
            "instances": list(instances),
            "sensor": sensor or {"type": "perspective"},
            "film": {"width": size[0], "height": size[1], **(film or {})},
            "rfilter": rfilter or {"type": "box"},
            "sampler": {"type": sampler},
            "integrator": {"type": "path", **integrator},
            **({} if robust is None else {"robust": robust}),
        }
    )


def point_view(origin: tuple[float, float, float] = (3, -4, 5)) -> Settings:
    """Parallel rays to a neighbourhood of (0, 0, 0) so small that it is a point."""
    return {"type": "orthographic", "to_world": look_at(origin, (0, 0, 0)) @ scaling(1e-4, 1e-4, 1)}


def picture(scene: _core.Scene, samples: int, seed: int = SEED, threads: int = 0) -> np.ndarray:
    render = _core.Render(scene, seed)
    assert render.advance(samples, threads)
    assert render.nonfinite == 0, render.nonfinite_list
    return render.image().astype(float)


def batch_means(scene: _core.Scene, samples: int) -> np.ndarray:
    """Means over the picture and its channels of BATCHES independent renders."""
    return np.array([picture(scene, samples, SEED + i).mean() for i in range(BATCHES)])


def check_mean(name: str, batches: np.ndarray, expected: float, slack: float = ROUNDING) -> None:
    """A t-test of independent means against a number, which rounding may blur by the fraction `slack`."""
    margin = t_margin(batches.std(ddof=1), len(batches) - 1, 1 / len(batches)) + slack * abs(expected)
    require(
        abs(batches.mean() - expected) <= margin,
        f"{name}: the mean is {batches.mean():.6f}, expected {expected:.6f} (margin {margin:.1e})",
    )


def check_same_mean(name: str, a: np.ndarray, b: np.ndarray, slack: float = ROUNDING) -> None:
    """Welch's t-test of two lists of independent means."""
    variance_a, variance_b = a.var(ddof=1) / len(a), b.var(ddof=1) / len(b)
    total = variance_a + variance_b
    freedom = total**2 / max(variance_a**2 / (len(a) - 1) + variance_b**2 / (len(b) - 1), 1e-300)
    margin = t_margin(np.sqrt(total), max(freedom, 1), 1) + slack * abs(a.mean())
    require(
        abs(a.mean() - b.mean()) <= margin,
        f"{name}: the means are {a.mean():.6f} and {b.mean():.6f} (margin {margin:.1e})",
    )


def t_margin(deviation: float, freedom: float, share: float) -> float:
    return float(stats.t.isf(LEVEL / 2, freedom) * deviation * np.sqrt(share))
