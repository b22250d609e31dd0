"""Every light of the list, area lights on every shape: sampling, densities, hits, power."""

from __future__ import annotations

import numpy as np
import pytest
from emitter_tools import (
    COLOR,
    DELTA_TYPES,
    FINE,
    POINTS,
    STUDIED,
    Lit,
    Point,
    point_lights,
    random_pixels,
    seen_from,
)
from scene_tools import Settings, make_scene, scaling, translation, uv_sphere
from statistics_tools import (
    ROUNDING,
    TESTS,
    Study,
    Z,
    check_consistency,
    check_density,
    check_energy,
    check_finite,
    compare,
    generator,
    require,
    study,
    uniforms,
)

import lajolla
from lajolla import _core, _core_testing

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
VIEWS = [(lit, point) for lit in STUDIED for point in lit.points]
CURVED = {"sphere", "cylinder", "mesh"}
CONVEX: list[Settings] = [
    {"type": "mesh", "mesh": uv_sphere(40, 20, smooth=True)},
    {"type": "sphere"},
    {"type": "rectangle"},
    {"type": "disk"},
    {"type": "cylinder"},
]


def name_of(value: object) -> str:
    return value.name if isinstance(value, Lit) else str(np.round(value, 3).tolist())


def judge(s: Study) -> None:
    check_finite(s.draws, s.thing.name)
    check_consistency(s)
    check_density(s)
    check_energy(s, most=np.inf)


def test_every_light_and_shape_is_tested() -> None:
    schema = _core.schema()
    lights = STUDIED + FINE + POINTS
    assert {lit.emitter["type"] for lit in lights} == set(schema["emitter"])
    never = {"curves", "sdfgrid"}  # have no known area; tests of their own
    assert {lit.shape["type"] for lit in lights if lit.shape} == set(schema["shape"]) - never
    assert sum(len(lit.points) for lit in lights) * 8 + len(lights) < TESTS / 10


@pytest.mark.parametrize("lit, point", VIEWS, ids=name_of)
def test_samples_density_and_hits(lit: Lit, point: Point) -> None:
    """Visible samples follow the density of the hits that they find, and their mean is the integral."""
    s = study(lit.seen_from(point))
    judge(Study(**{**vars(s), "rounding": max(s.rounding, lit.rounding)}))


@pytest.mark.parametrize("lit, point", [(lit, p) for lit in FINE for p in lit.points], ids=name_of)
def test_fine_meshes(lit: Lit, point: Point) -> None:
    """The same with directions drawn from the whole sphere in place of a quadrature."""
    thing = lit.seen_from(point)
    rng = generator(thing.name)
    draws = thing.sample(uniforms(rng, 20_000, 3))
    check_finite(draws, thing.name)
    seen = draws.where(draws.valid)
    value, pdf = thing.evaluate(seen.points)
    compare(f"{thing.name}: densities", seen.pdf, pdf, 1e-3)
    compare(f"{thing.name}: radiance", seen.weight * seen.pdf[:, None], value, 1e-3)
    around = rng.normal(size=(200_000, 3))
    value, pdf = thing.evaluate(around / np.linalg.norm(around, axis=1, keepdims=True))
    weight = np.where(draws.valid[:, None], draws.weight, 0)
    for what, sampled, uniform in (
        ("the visible fraction", draws.valid.astype(float), 4 * np.pi * pdf),
        ("the radiance from everywhere", weight @ LUMINANCE, 4 * np.pi * value @ LUMINANCE),
    ):
        margin = Z * np.hypot(*(x.std() / np.sqrt(len(x)) for x in (sampled, uniform)))
        require(abs(sampled.mean() - uniform.mean()) < margin, f"{thing.name}: {what}")


@pytest.mark.parametrize("shape", CONVEX, ids=lambda s: s["type"])
def test_nothing_hides_a_distant_light(shape: Settings) -> None:
    """All of the solid angle that faces a point is seen from there."""
    scene = make_scene(shapes=[{**shape, "emitter": 0}], emitters=[{"type": "area"}])
    for distance in (10, 1e2, 1e3, 1e4):
        point = (distance * np.array([0.3, 0.2, 0.93])).astype(np.float32)
        s = _core.sample_emitters(scene, point, uniforms(generator("distant"), 20_000, 3), 0)
        facing = s["pdf"] > 0
        solid_angle = 1 / s["pdf"][facing].astype(float)
        hidden = solid_angle[~s["visible"][facing]].sum() / solid_angle.sum()
        assert hidden < ROUNDING, f"at distance {distance}"


def shines_inwards(lit: Lit) -> bool:
    return lit.shape is not None and "flip_normals" in lit.shape and lit.shape["type"] in CURVED


@pytest.mark.parametrize(
    "lit", [lit for lit in STUDIED + FINE + POINTS if not shines_inwards(lit)], ids=name_of
)
def test_power_is_the_integral_of_emission(lit: Lit) -> None:
    """The flux through a sphere around a light; that of light from all around goes in where it comes out."""
    radius, per_point = 6.0, 16
    rng = generator("power", lit.name)
    outward = rng.normal(size=(1500, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    flux = np.array([irradiance(lit, radius * n, -n, rng, per_point) for n in outward])
    power = float(_core_testing.emitter_powers(lit.scene, radius)[0])
    margin = Z * flux.std() / np.sqrt(len(flux)) * 4 * np.pi * radius**2 + lit.power_slack * power
    total = flux.mean() * 4 * np.pi * radius**2
    require(abs(total - power) < margin, f"{lit.name}: power {power}, flux {total} (margin {margin:.1e})")


def irradiance(
    lit: Lit, point: np.ndarray, normal: np.ndarray, rng: np.random.Generator, count: int
) -> float:
    """An estimate of the luminous irradiance of a light at a point."""
    s = _core.sample_emitters(lit.scene, point.astype(np.float32), uniforms(rng, count, 3), 0)
    weight = np.where(s["visible"][:, None], s["radiance"] / np.maximum(s["pdf"], 1e-30)[:, None], 0)
    return float(np.mean(weight @ LUMINANCE * np.maximum(s["wi"] @ normal, 0)))


@pytest.mark.parametrize("lit", POINTS, ids=name_of)
def test_point_like_lights(lit: Lit) -> None:
    """Inverse squares, the spot's linear fall-off between its two angles, parallel light, pictures."""
    rng = generator(lit.name)
    seen = 0
    for point in rng.normal(size=(400, 3)) * 2:
        s = _core.sample_emitters(lit.scene, point.astype(np.float32), uniforms(rng, 2, 3), 0)
        wi, distance, expected = arriving(lit, point)
        if not np.any(expected):
            assert not s["visible"].any()
            continue
        seen += 1
        assert s["delta"].all() and s["visible"].all() and (s["pdf"] == 1).all()
        np.testing.assert_allclose(s["wi"], np.tile(wi, (2, 1)), atol=1e-5)
        np.testing.assert_allclose(s["distance"], distance, rtol=1e-5)
        np.testing.assert_allclose(s["radiance"], np.tile(expected, (2, 1)), rtol=1e-3)
        value, pdf = _core.eval_emitters(lit.scene, point.astype(np.float32), s["wi"], 0)
        assert not value.any() and not pdf.any(), "no ray hits a point"
    assert seen > 5


def arriving(lit: Lit, point: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Direction, distance and what arrives."""
    emitter, color = lit.emitter, np.array(COLOR)
    if emitter["type"] == "directional":
        return -np.array(emitter["direction"]) / np.linalg.norm(emitter["direction"]), np.inf, color
    matrix = np.array(emitter.get("to_world", np.eye(4)))
    origin = np.array(emitter["position"]) if emitter["type"] == "point" else matrix[:3, 3]
    distance = float(np.linalg.norm(origin - point))
    wi = (origin - point) / distance
    if emitter["type"] == "point":
        return wi, distance, color / distance**2
    local = -wi @ matrix[:3, :3]
    shine = projected(emitter, local) if emitter["type"] == "projector" else thrown(emitter, local)
    return wi, distance, shine / distance**2


def thrown(emitter: Settings, local: np.ndarray) -> np.ndarray:
    """Radiant intensity of a spot."""
    cutoff = emitter.get("cutoff_angle", 20)
    beam = emitter.get("beam_width", 0.75 * cutoff)
    angle = np.degrees(np.arccos(np.clip(local[2], -1, 1)))
    shine = np.clip((cutoff - angle) / (cutoff - beam), 0, 1) if cutoff > beam else float(angle < cutoff)
    if shine and "texture" in emitter:
        return (
            np.array(COLOR)
            * shine
            * pictured(0.5 + 0.5 * local[:2] / (local[2] * np.tan(np.radians(cutoff))))
        )
    return np.array(COLOR) * shine


def projected(emitter: Settings, local: np.ndarray) -> np.ndarray:
    """Radiant intensity of a projector: pi times the picture over cos^3."""
    half = np.tan(np.radians(emitter["fov"] / 2)) * np.array([1, 1 / emitter.get("aspect", 1)])
    uv = 0.5 - 0.5 * local[:2] / (half * local[2])
    if local[2] <= 0 or np.any(uv < 0) or np.any(uv > 1):
        return np.zeros(3)
    color = pictured(uv) if isinstance(emitter["irradiance"], dict) else np.array(COLOR)
    return np.pi * emitter.get("scale", 1) * color / local[2] ** 3


def pictured(uv: np.ndarray) -> np.ndarray:
    """The test's picture, linear between its pixels."""
    pixels = random_pixels(5, 4)
    x, y = np.clip(uv * [5, 4] - 0.5, 0, [4, 3])
    i, j = min(int(x), 3), min(int(y), 2)
    rows = pixels[j : j + 2, i] * (1 - x + i) + pixels[j : j + 2, i + 1] * (x - i)
    return rows[0] * (1 - y + j) + rows[1] * (y - j)


def many_lights() -> _core.Scene:
    """Lights of every kind around the origin, and a shape that hides some of them."""
    shapes = [
        {"type": "rectangle", "to_world": translation(0, 0, -3), "emitter": 0},
        {"type": "sphere", "center": [3, 1, 0], "radius": 0.5, "emitter": 1},
        {"type": "disk", "to_world": translation(0.2, 0, -2) @ scaling(0.3), "material": 0},
    ]
    area = {"type": "area", "radiance": COLOR}
    others = [lit.emitter for lit in point_lights()[:3]]
    return make_scene(shapes=shapes, emitters=[area, area, {"type": "constant", "radiance": 0.1}, *others])


def test_lights_picked_by_power() -> None:
    scene, origin = many_lights(), np.zeros(3, np.float32)
    s = study(seen_from("many lights", scene, (0, 0, 0), None))
    judge(s)
    u = uniforms(generator("pick"), 200_000, 3)
    picked = _core.sample_emitters(scene, origin, u)
    found = np.where((picked["delta"] & picked["visible"])[:, None], picked["radiance"], 0)
    kinds = [_core.sample_emitters(scene, origin, u[:1], i) for i in range(6)]
    expected = sum(k["radiance"][0] for k in kinds if k["delta"][0] and k["visible"][0])
    margin = Z * found.std(0) / np.sqrt(len(found))
    require(np.all(np.abs(found.mean(0) - expected) < margin), "point-like lights picked by power")


def test_densities_contain_the_probability_of_a_light() -> None:
    scene = make_scene(
        shapes=[
            {"type": "sphere", "center": [0, 0, z], "radius": 0.2 * i + 0.3, "emitter": i}
            for i, z in enumerate((3, -3))
        ],
        emitters=[{"type": "area", "radiance": r} for r in (2, COLOR)],
    )
    power = _core_testing.emitter_powers(scene, 1)
    np.testing.assert_allclose(
        power, [4 * np.pi**2 * r**2 * e for r, e in ((0.3, 2), (0.5, LUMINANCE @ COLOR))], rtol=1e-5
    )
    origin = np.zeros(3, np.float32)
    for i, z in enumerate((1, -1)):
        wi = np.array([[0, 0, z]], np.float32)
        together = _core.eval_emitters(scene, origin, wi)[1]
        alone = _core.eval_emitters(scene, origin, wi, i)[1]
        np.testing.assert_allclose(together / alone, 0.5 * power[i] / power.sum() + 0.25, rtol=1e-5)


def test_delta_types_are_all_that_no_ray_hits() -> None:
    assert {lit.emitter["type"] for lit in POINTS} == DELTA_TYPES


@pytest.mark.parametrize(("sampling", "ratio"), [("radiance", 9), ("uniform", 1), ("compensated", 16)])
def test_densities_of_environment_maps(sampling: str, ratio: float) -> None:
    """Half of the map has radiance 1, half 9. Compensated, they weigh 1 / 4 and 9 minus the mean."""
    pixels = np.ones((32, 64, 3), np.float32)
    pixels[:, 32:] = 9
    light = lajolla.Light({"type": "envmap", "data": pixels, "sampling": sampling})
    turn = np.radians([80.0, 90.0, 100.0])
    wi = np.stack([np.sin(turn), np.zeros(3), np.cos(turn)], axis=1)
    one, other = light.pdf([0, 0, 0], wi), light.pdf([0, 0, 0], -wi)
    assert np.maximum(one, other) / np.minimum(one, other) == pytest.approx(ratio, rel=0.01)
    brighter = light.eval([0, 0, 0], wi)[:, 0] > light.eval([0, 0, 0], -wi)[:, 0]
    assert ratio == 1 or ((one > other) == brighter).all()
