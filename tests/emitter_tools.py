"""Lights as things under test: every model of the core's list, area lights on every shape."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from quadrature_tools import Domain, sphere
from scene_tools import (
    Settings,
    box_mesh,
    make_scene,
    rotation,
    scaling,
    torus,
    translation,
    uv_sphere,
)
from statistics_tools import Draws, Sampled

from lajolla import _core

Point = tuple[float, float, float]
Color = list[float]

COLOR: Color = [3.0, 1.0, 0.25]
DELTA_TYPES = {"point", "directional", "spot", "projector"}  # lights that no ray can hit


@dataclass(frozen=True)
class Lit:
    """A light, the shape it needs and the points from which it is looked at."""

    name: str
    emitter: Settings
    shape: Settings | None
    points: tuple[Point, ...]
    textures: tuple[Settings, ...] = ()
    domain: Domain | None = None
    power_slack: float = 1e-4  # what power() may be off by; it only steers the choice among lights
    rounding: float = 0  # of densities, where a grazing ray's hit depends on the last place of its direction
    scene: _core.Scene = field(init=False)

    def __post_init__(self) -> None:
        shapes = [] if self.shape is None else [{**self.shape, "emitter": 0}]
        scene = make_scene(shapes=shapes, emitters=[self.emitter], textures=self.textures)
        object.__setattr__(self, "scene", scene)

    def seen_from(self, point: Point) -> Sampled:
        return seen_from(self.name, self.scene, point, 0, self.domain)

    @property
    def delta(self) -> bool:
        return self.emitter["type"] in DELTA_TYPES


def seen_from(
    name: str, scene: _core.Scene, point: Point, emitter: int | None, domain: Domain | None = None
) -> Sampled:
    """The directions in which a light, or all lights picked by power, are sampled from a point.

    Only samples that are seen count, and no points: the densities are those of rays that leave the point.
    """
    place = np.array(point, np.float32)

    def sample(u: np.ndarray) -> Draws:
        s = _core.sample_emitters(scene, place, np.ascontiguousarray(u, np.float32), emitter)
        weight = s["radiance"] / np.where(s["pdf"] > 0, s["pdf"], 1)[:, None]
        return Draws(s["wi"], weight, s["pdf"], s["visible"] & ~s["delta"], s["delta"], s["pdf"])

    def evaluate(wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _core.eval_emitters(scene, place, np.ascontiguousarray(wi, np.float32), emitter)

    if domain is None:
        pilot = sample(np.random.default_rng(1).random((256, 3)))
        domain = facing(pilot.points[pilot.valid].sum(0))
    return Sampled(f"{name} from {list(point)}", domain, 3, sample, evaluate)


def facing(direction: np.ndarray) -> Domain:
    """The sphere in coordinates that are finest around a direction."""
    s, t, n = axes_around(direction)
    return turned(sphere(), np.stack([s, t, n]))


def axes_around(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n = direction / np.linalg.norm(direction) if np.linalg.norm(direction) > 0.1 else np.array([0, 0, 1.0])
    s = np.cross((0, 1, 0) if abs(n[1]) < 0.9 else (1, 0, 0), n)
    s /= np.linalg.norm(s)
    return s, np.cross(n, s), n


def cone_towards(direction: np.ndarray, cosine: float) -> Domain:
    """The sphere cut along the rim of a cone."""
    s, t, n = axes_around(direction)
    return turned(sphere(), np.stack([s, n, -t]), ((cosine,), (-np.pi / 2, np.pi / 2)))


def turned(domain: Domain, rows: np.ndarray, cuts: tuple[tuple[float, ...], ...] | None = None) -> Domain:
    """A domain of the sphere whose axes are the rows of an orthogonal matrix."""
    return Domain(
        domain.lower,
        domain.upper,
        domain.cuts if cuts is None else cuts,
        lambda coordinates: domain.to_points(coordinates) @ rows,
        lambda points: domain.to_coordinates(points.astype(float) @ rows.T),
    )


def area_lights() -> list[Lit]:
    tilted = translation(0.5, -0.3, 2) @ rotation((1, 2, 0.5), 140) @ scaling(0.8, 1.5, 1)
    even = translation(0.5, -0.3, 2) @ rotation((1, 2, 0.5), 140) @ scaling(0.7)
    tube = {"p0": [0, 0, -1], "p1": [1, 0, 0.5], "radius": 0.4, "to_world": even}
    return [
        *on_shape("rectangle", {"to_world": tilted}),
        *on_shape("disk", {"to_world": tilted}),
        *on_shape("sphere", {"center": [0, 0, 1], "radius": 0.5, "to_world": even}),
        *on_shape("cylinder", tube, rounding=1e-3),
        *on_shape("mesh", {"mesh": box_mesh(), "to_world": tilted}),
    ]


def on_shape(name: str, settings: Settings, rounding: float = 0) -> list[Lit]:
    """An area light on a shape, on the same shape turned inside out, and with a texture."""
    emitter, points = {"type": "area", "radiance": COLOR}, ((0.2, 0.1, -1), (1.5, 1, 1.2))
    textured = {"type": "area", "radiance": {"texture": 0}}
    shape = {"type": name, **settings}
    flipped = {**shape, "flip_normals": True}
    bitmap = (random_bitmap(5, 4),)
    return [
        Lit(f"area on {name}", emitter, shape, points, rounding=rounding),
        Lit(f"area on flipped {name}", emitter, flipped, points, rounding=rounding),
        Lit(f"textured {name}", textured, shape, points[:1], bitmap, power_slack=0.2, rounding=rounding),
    ]


def spheres_at_distances() -> list[Lit]:
    emitter = {"type": "area", "radiance": COLOR}
    ball = {"type": "sphere", "center": [1, 0, 0], "radius": 2}
    towards = np.array([0.6, -0.48, 0.64])
    distances = {"on": 2.0, "close": 2.001, "near": 2.02, "a little off": 2.2, "far": 400, "distant": 2e4}
    lights = []
    for name, d in distances.items():
        point = tuple(np.array(ball["center"]) + d * towards)
        domain = cone_towards(-towards, np.sqrt(1 - (2 / d) ** 2)) if d < 3 else None
        lights.append(Lit(f"sphere {name}", emitter, ball, (point,), domain=domain))
    inside_out = {**ball, "flip_normals": True}
    return [*lights, Lit("sphere from within", emitter, inside_out, ((1, 0, 0), (1.7, 1.1, -1.2)))]


def fine_meshes() -> list[Lit]:
    """Lights whose many edges are too much for a quadrature."""
    emitter = {"type": "area", "radiance": COLOR}
    smooth = {"type": "mesh", "mesh": uv_sphere(48, 24, smooth=True)}
    return [
        Lit("area on smooth mesh", emitter, smooth, ((0, 0.5, 3), (1.2, 0, 0))),
        Lit("area on smooth mesh from within", emitter, {**smooth, "flip_normals": True}, ((0.2, 0.5, 0),)),
        Lit("area on torus", emitter, {"type": "mesh", "mesh": torus(40, 20)}, ((0, 0, 0.1), (2, 0, 1))),
    ]


def random_pixels(width: int, height: int) -> np.ndarray:
    return np.random.default_rng(3).random((height, width, 3), np.float32) * 4


def random_bitmap(width: int, height: int) -> Settings:
    pixels = random_pixels(width, height)
    return {"type": "bitmap", "image": _core.Image(pixels), "wrap_mode": "clamp"}


RANDOM = (random_bitmap(5, 4),)


def environment_maps() -> list[Lit]:
    rng = np.random.default_rng(4)
    spot, hole = np.zeros((6, 12, 3), np.float32), np.ones((5, 9, 3), np.float32)
    spot[2, 7] = 5, 1, 2
    hole[0:3] = 0
    polar = np.zeros((4, 8, 3), np.float32)
    polar[0] = 1, 2, 3
    images = {
        "random": rng.random((6, 10, 3), np.float32) ** 4 * 10,
        "constant": np.full((3, 6, 3), 2, np.float32),
        "one bright pixel": spot,
        "half black": hole,
        "bright pole": polar,
        "one pixel high": rng.random((1, 8, 3), np.float32),
        "one pixel wide": rng.random((5, 1, 3), np.float32),
        "one pixel": np.full((1, 1, 3), 0.5, np.float32),
        "two pixels": rng.random((1, 2, 3), np.float32),
    }
    placements = {
        "rotated": rotation((1, 0.3, 0.2), 70),
        "mirrored": scaling(-1, 1, 1),
        "scaled": scaling(2.5) @ rotation((0, 0, 1), 40),
    }
    plain = [environment(name, pixels, np.eye(4)) for name, pixels in images.items()]
    placed = [environment(name, images["random"], m, 0.3) for name, m in placements.items()]
    turn = placements["rotated"]
    partial = [environment(f"to {end}", images["random"], turn, theta_max=end) for end in (40, 90, 135)]
    ways = [
        environment(f"{name} sampled by {way}", images[name], turn, sampling=way)
        for name in ("random", "one bright pixel")
        for way in ("radiance", "uniform")
    ]
    return plain + placed + partial + ways


def environment(
    name: str,
    pixels: np.ndarray,
    to_world: np.ndarray,
    scale: float = 1,
    theta_max: float = 180,
    **more: object,
) -> Lit:
    # power() takes the mean of a cell's corners for its mean: rough where there are but a few rows
    emitter = {
        "type": "envmap",
        "image": _core.Image(pixels),
        "theta_max": theta_max,
        "to_world": to_world,
        "scale": scale,
        **more,
    }
    domain = cells_of_map(pixels.shape[1], pixels.shape[0], to_world, theta_max)
    return Lit(f"envmap {name}", emitter, None, ((0, 0, 0),), domain=domain, power_slack=0.5)


def cells_of_map(width: int, height: int, to_world: np.ndarray, theta_max: float = 180) -> Domain:
    """The sphere cut along the texel centres of a map, between which its density is smooth."""
    rows = to_world[:3, :3].T / np.cbrt(abs(np.linalg.det(to_world[:3, :3])))
    last = max(height, 2) - (1 if theta_max == 180 else 0)
    heights = np.cos(np.radians(theta_max) * np.arange(1, last) / (max(height, 2) - 1))
    turns = (np.pi - 2 * np.pi * (np.arange(width) + 0.5) / width + np.pi) % (2 * np.pi) - np.pi
    inner = turns[np.abs(turns) < np.pi - 1e-9]
    return turned(sphere(), rows, (tuple(np.sort(heights)), tuple(np.sort(inner))))


def point_lights() -> list[Lit]:
    """Lights that no ray can hit."""
    place = translation(0.3, 0.2, 0.5) @ rotation((1, 1, 0), 50)
    here: tuple[Point, ...] = ((1, 2, 2.5), (0.3, -0.4, 1.5))
    spot = {"type": "spot", "intensity": COLOR, "to_world": place}
    projector = {"type": "projector", "fov": 70, "to_world": place}
    return [
        Lit("point", {"type": "point", "position": [0.2, 0.5, 0.1], "intensity": COLOR}, None, here),
        Lit("directional", {"type": "directional", "direction": [1, 2, -3], "irradiance": COLOR}, None, here),
        Lit("spot", {**spot, "cutoff_angle": 60, "beam_width": 20}, None, here),
        Lit("spot without beam", {**spot, "cutoff_angle": 90, "beam_width": 0}, None, here),
        Lit("spot with a sharp edge", {**spot, "cutoff_angle": 40, "beam_width": 40}, None, here),
        Lit("spot by default", spot, None, here),
        Lit("spot with a texture", {**spot, "cutoff_angle": 50, **picture("texture")}, None, here, RANDOM),
        Lit("projector", {**projector, "irradiance": COLOR}, None, here, power_slack=5e-3),
        Lit(
            "projector of a picture",
            {**projector, **picture("irradiance"), "aspect": 1.25, "scale": 0.5},
            None,
            here,
            RANDOM,
            power_slack=1e-2,
        ),
    ]


def picture(field: str) -> Settings:
    return {field: {"texture": 0}}


def constant_light() -> Lit:
    return Lit("constant", {"type": "constant", "radiance": COLOR}, None, ((0, 0, 0),))


def distant_disks() -> list[Lit]:
    """As large as the sun, and larger."""
    towards = np.array([0.6, -0.48, 0.64])
    lights = []
    for angle in (0.5358, 8, 90, 180):
        emitter = {
            "type": "distantdisk",
            "direction": list(-2 * towards),
            "irradiance": COLOR,
            "angle": angle,
        }
        domain = cone_towards(towards, np.cos(np.radians(angle / 2)))
        lights.append(Lit(f"disk of {angle} degrees", emitter, None, ((0, 0, 0),), domain=domain))
    return lights


STUDIED: list[Lit] = [
    *area_lights(),
    *spheres_at_distances(),
    *environment_maps(),
    constant_light(),
    *distant_disks(),
]
FINE: list[Lit] = fine_meshes()
POINTS: list[Lit] = point_lights()
