"""Every BSDF of the list, with settings made from its fields, against its contract."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scatter_tools import (
    MODELS,
    Bsdf,
    Settings,
    check_reciprocity,
    direction,
    in_turn,
    is_accepted,
    known_directions,
    label,
    make_bsdf,
    seen_from,
    settings_of,
    typical,
    values_of,
)
from statistics_tools import (
    ONE_MINUS_ULP,
    TESTS,
    Z,
    check_consistency,
    check_density,
    check_energy,
    check_finite,
    generator,
    require,
    study,
    uniforms,
)

SETTINGS = [settings for name in MODELS for settings in settings_of(name)]
each_setting = pytest.mark.parametrize("settings", SETTINGS, ids=label)

# Models, switches and choices that may return a little more light than they receive, and why.
ENERGY_GAIN: dict[str, tuple[float, str]] = {
    "plastic": (2e-3, "the mean Fresnel reflectance from within is a polynomial fit"),
    "roughplastic": (2e-3, "the same fit"),
    "fast": (2e-2, "Oren and Nayar's short form exceeds one for white facets seen from near the rim"),
    "multiscatter": (2e-3, "what is lost is looked up in a table that is linear between its nodes"),
    "disneydiffuse": (0.03, "retro-reflection is a fit to measured materials, not a balance of energy"),
    "disneybsdf": (0.2, "that, and the diffuse part does not give up what the surface and the coat reflect"),
    "principled": (0.45, "the same; worst where all light is reflected at eta < 1"),
    "principledthin": (0.03, "the diffuse part is that of disneydiffuse"),
}

# With `multiscatter` and an index below one, up to 0.4 % too much or too little returns just outside the
# critical angle. Twice as many nodes in the table do not change it.
INVERTED_GAIN = 5e-3

# Models with values that differ when light goes the other way, the field that makes them so, and why.
NOT_RECIPROCAL: dict[str, tuple[str, str]] = {
    "hair": ("", "where a fibre is hit follows from wo alone; its scales point one way (Chiang et al. 2016)"),
    "measured": ("", "each direction has a table of its own, of what was measured there"),
    "principledthin": (
        "spec_trans",
        "light that leaves behind its facet is left out, which depends on wo alone",
    ),
}

# Models that reflect or transmit everything when nothing is tinted, the settings for that, and the precision.
LOSSLESS: dict[str, tuple[Settings, float, str]] = {
    "diffuse": ({"reflectance": 1}, 1e-5, "a Lambertian surface of albedo one"),
    "null": ({}, 1e-6, "nothing is there"),
    "roughdiffuse": (
        {"variant": "energy-preserving", "reflectance": 1, "alpha": 0.7},
        1e-4,
        "all bounces between white facets",
    ),
    "hair": ({"sigma_a": 0}, 1e-4, "a clear fibre: what enters leaves after any number of passages"),
    "difftrans": ({"transmittance": 1}, 1e-5, "all light goes through"),
    "dielectric": ({}, 1e-5, "Fresnel's reflected and refracted fractions add up to one"),
    "thindielectric": ({}, 1e-5, "the same, summed over the reflections within the slab"),
    "conductor": ({}, 1e-5, "the default is a perfect mirror"),
    "plastic": (
        {"diffuse_reflectance": 1},
        5e-3,
        "what enters leaves after any number of internal reflections; their mean Fresnel term is a fit",
    ),
    "roughconductor": ({"alpha_u": 0.01, "alpha_v": 0.01}, 2e-3, "the loss to masking vanishes with alpha"),
    "roughdielectric": ({"alpha_u": 0.01, "alpha_v": 0.01}, 2e-3, "the loss to masking vanishes with alpha"),
    "disneymetal": ({"base_color": 1, "roughness": 0.03}, 2e-3, "the same"),
    "disneyglass": ({"base_color": 1, "roughness": 0.03}, 2e-3, "the same"),
    "disneybsdf": (
        {"base_color": 1, "roughness": 0.03, "specular_transmission": 1, "metallic": 0},
        2e-3,
        "glass alone",
    ),
    "principled": ({"base_color": 1, "roughness": 0.03, "spec_trans": 1}, 2e-3, "glass alone"),
    "principledthin": ({"base_color": 1, "roughness": 0.03, "spec_trans": 1}, 2e-3, "glass alone"),
}


def directions_for(bsdf: Bsdf, settings: Settings) -> list[np.ndarray]:
    """All directions for a model's defaults, two of them in turn for every other setting."""
    directions = known_directions(bsdf)
    if len(settings) == 1:
        return directions
    turn = SETTINGS.index(settings)
    return [directions[(3 * turn) % len(directions)], directions[(3 * turn + 5) % len(directions)]]


def given(settings: Settings) -> list[str]:
    """The switches that are on, and the choices."""
    return [
        name if value is True else value
        for name, value in settings.items()
        if value in (True,) or isinstance(value, str)
    ]


def at_end_of_indices(settings: Settings) -> bool:
    indices = [settings.get(name) for name in ("eta", "int_ior", "ext_ior")]
    return any(isinstance(index, float) and not 1 / 500 < index < 500 for index in indices)


def test_level_covers_the_number_of_tests() -> None:
    per_study = 2 + 3 + 3  # chi-square, total; energy per channel; branch frequencies
    assert len(SETTINGS) * 8 * per_study < TESTS


@each_setting
def test_samples_density_and_energy(settings: Settings) -> None:
    bsdf = make_bsdf(settings)
    gain = max(ENERGY_GAIN.get(cause, (0, ""))[0] for cause in (settings["type"], *given(settings)))
    if at_end_of_indices(settings):
        gain = max(gain, EXTREME_GAIN.get(str(settings["type"]), (0, ""))[0])
    if settings.get("multiscatter") and isinstance(ior := settings.get("int_ior"), float) and ior < 1:
        gain = max(gain, INVERTED_GAIN)
    for wo in directions_for(bsdf, settings):
        s = study(seen_from(bsdf, wo))
        check_finite(s.draws, s.thing.name)
        check_consistency(s)
        check_density(s)
        check_energy(s, most=1 + gain)


@each_setting
def test_reciprocity(settings: Settings) -> None:
    if at_end_of_indices(settings):
        pytest.skip("refracted light is within 0.001 of the normal, where cosines have no digits of it")
    if settings["type"] in NOT_RECIPROCAL:
        field, reason = NOT_RECIPROCAL[settings["type"]]
        if not field or settings.get(field):
            pytest.skip(reason)
    bsdf = make_bsdf(settings)
    for wo in directions_for(bsdf, settings):
        check_reciprocity(bsdf, wo)


@each_setting
def test_corners_are_finite(settings: Settings) -> None:
    bsdf = make_bsdf(settings)
    edge = (0, 2**-24, 0.5, ONE_MINUS_ULP)
    u = np.concatenate([list(itertools.product(edge, repeat=3)), uniforms(generator("corners"), 500, 3)])
    for wo in known_directions(bsdf, (1, 1 - 1e-7, 0.5, 1e-2, 1e-4, 1e-7)):
        draws = bsdf.sample(wo, u)
        name = f"{bsdf.name} from {wo}"
        check_finite(draws, name)
        others = np.concatenate(
            [draws.points[draws.valid], [direction(c, a) for c in (1e-7, -1e-7, 1e-4) for a in (0, 3)]]
        )
        value, pdf = bsdf.evaluate(wo, others)
        require(
            np.isfinite(value).all() and (value >= 0).all(), f"{name}: a value is not finite and positive"
        )
        require(np.isfinite(pdf).all() and (pdf >= 0).all(), f"{name}: a density is not finite and positive")


@each_setting
def test_sides(settings: Settings) -> None:
    """Opaque lobes stay above; delta flags hold; what crosses the surface refracts by its own eta."""
    bsdf = make_bsdf(settings)
    around = np.random.default_rng(1).normal(size=(2000, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    for wo in known_directions(bsdf):
        value, pdf = bsdf.evaluate(wo, around)
        draws = bsdf.sample(wo, uniforms(generator("sides"), 2000, 3))
        draws = draws.where(draws.valid)
        crossed = draws.points[:, 2] * wo[2] < 0
        if not bsdf.transmissive:
            assert not crossed.any()
            assert (value[around[:, 2] < 0] == 0).all() and (pdf[around[:, 2] < 0] == 0).all()
        if bsdf.delta:
            assert draws.delta.all() and (value == 0).all() and (pdf == 0).all()
        assert (draws.eta[~crossed] == 1).all()
        straight = draws.where(crossed & draws.delta)
        np.testing.assert_allclose(
            straight.points[:, :2] * straight.eta[:, None],
            -np.tile(wo[:2], (len(straight.eta), 1)),
            atol=1e-5,
        )


@pytest.mark.parametrize("name", [name for name in LOSSLESS if name in MODELS])
def test_white_furnace(name: str) -> None:
    settings, precision, reason = LOSSLESS[name]
    bsdf = make_bsdf({"type": name, **settings})
    for wo in known_directions(bsdf):
        s = study(seen_from(bsdf, wo))
        total = s.value + sum((b.weight * b.probability for b in s.branches), np.zeros(3))
        assert np.abs(total - 1).max() < precision + s.error, f"{name} from {wo} returns {total}: {reason}"


# ---- every number at the ends of its range

# Indices of refraction within their range: as near to one as float32 comes, and where 1 - F vanishes.
INDICES = (1 + 2**-23, 1 - 2**-24, 1.0001, 0.9999, 1e-2, 30, 500)

# Models that return more light there than ENERGY_GAIN says, and why.
EXTREME_GAIN: dict[str, tuple[float, str]] = {
    "ward": (20, "its lobe has no masking: near the rim more is scattered than arrives (Duer 2006)"),
    "principled": (
        1,
        "where the boundary reflects everything, the diffuse part still reflects the base colour",
    ),
    "disneybsdf": (0.3, "the same, seen from near the rim"),
}


def ends(field: dict) -> list[float]:
    """The ends of a range, a thousand times what is typical for an open one, and what is beside zero."""
    low, high = field["minimum"], field["maximum"]
    if field["type"] not in ("float", "texture_float", "spectrum", "texture_spectrum"):
        return []
    far = 1000 * typical(field)
    result = [-far if low is None else low, far if high is None else high]
    if low == 0:
        result.append(1e-6)
    if field["name"] in ("eta", "int_ior", "ext_ior") and field["type"] in ("float", "texture_float"):
        result += INDICES
    return result


def extreme_settings(name: str) -> list[Settings]:
    """One field at an end, under the model's choices in turn. Indices may be refused: their ratio counts."""
    fields = MODELS[name]["fields"]
    choices = [f for f in fields if f["type"] in ("choice", "boolean")]
    combinations = [
        {"type": name} | dict(zip((f["name"] for f in choices), values, strict=True))
        for values in itertools.product(*(values_of(f) for f in choices))
    ]
    settings = in_turn(combinations, [{f["name"]: end} for f in fields for end in ends(f)])
    accepted = [s for s in settings if is_accepted(s)]
    assert all(s in accepted or not {"int_ior", "ext_ior"}.isdisjoint(s) for s in settings)
    return accepted


@pytest.mark.parametrize("name", MODELS)
def test_numbers_at_the_ends_of_their_range(name: str) -> None:
    gain = max(ENERGY_GAIN.get(name, (0, ""))[0], EXTREME_GAIN.get(name, (0, ""))[0])
    for settings in extreme_settings(name):
        bsdf = make_bsdf(settings)
        for wo in known_directions(bsdf, (1, 0.6, 0.05)):
            rng = generator("ends", bsdf.name, wo.tolist())
            draws = bsdf.sample(wo, uniforms(rng, 1000, 3))
            check_finite(draws, bsdf.name)
            weights = np.where(draws.valid[:, None], draws.weight, 0).astype(float)
            error = Z * weights.std(0) / np.sqrt(len(weights)) + 2e-2
            require(
                bool((weights.mean(0) <= 1 + gain + error).all()),
                f"{bsdf.name} from {wo} returns {weights.mean(0)}",
            )
            scattered = draws.where(draws.valid & ~draws.delta)
            value, pdf = bsdf.evaluate(wo, np.concatenate([scattered.points, around(rng, 100)]))
            require(bool(np.isfinite(value).all() and np.isfinite(pdf).all()), f"{bsdf.name}: not finite")
            if len(scattered.points) > 100:
                count = len(scattered.points)
                off = np.abs(pdf[:count] / scattered.pdf - 1)
                lit = scattered.weight.max(1) > 0
                carried = scattered.weight[lit] * scattered.pdf[lit, None]
                off_value = np.abs(value[:count][lit] / np.maximum(carried, 1e-30) - 1).min(1)
                require(np.median(off) < 0.1, f"{bsdf.name} from {wo}: densities differ by {np.median(off)}")
                if len(off_value) > 100:
                    require(np.median(off_value) < 0.1, f"{bsdf.name} from {wo}: values differ")


def around(rng: np.random.Generator, count: int) -> np.ndarray:
    directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


@pytest.mark.parametrize("eta", [1e-3, 0.1, 0.4, 1 - 1e-3, 1 + 1e-3, 3, 8, 30, 1e2, 999])
@pytest.mark.parametrize("nonlinear", [False, True])
@pytest.mark.parametrize("name", ["plastic", "roughplastic"])
def test_white_plastic_of_any_index_loses_nothing(name: str, nonlinear: bool, eta: float) -> None:
    settings = {"int_ior": eta, "ext_ior": 1, "diffuse_reflectance": 1, "nonlinear": nonlinear}
    rough = {"alpha": 0.1, "multiscatter": True, "distribution": "ggx"}
    bsdf = make_bsdf({"type": name, **settings, **(rough if name == "roughplastic" else {})})
    for wo in known_directions(bsdf, (0.9, 0.4)):
        draws = bsdf.sample(wo, uniforms(generator("plastic", bsdf.name), 20_000, 3))
        weights = np.where(draws.valid, draws.weight[:, 0], 0).astype(float)
        error = Z * weights.std() / np.sqrt(len(weights)) + 6e-3  # of the fit of the mean transmittance
        assert abs(weights.mean() - 1) < error


ROUGH = [
    {"type": name, "distribution": distribution, **alphas}
    for distribution in ("beckmann", "ggx")
    for name, alphas in (
        ("roughconductor", {"alpha_u": 1, "alpha_v": 1}),
        ("roughconductor", {"alpha_u": 1, "alpha_v": 0.1}),
        ("roughconductor", {"alpha_u": 0.05, "alpha_v": 0.05}),
        ("roughdielectric", {"alpha_u": 1, "alpha_v": 1}),
        ("roughdielectric", {"alpha_u": 0.2, "alpha_v": 0.2, "int_ior": 2.5}),
        ("roughdielectric", {"alpha_u": 0.5, "alpha_v": 0.5, "int_ior": 1, "ext_ior": 1.33}),
        ("roughdielectric", {"alpha_u": 0.5, "alpha_v": 0.5, "specular_reflectance": 0}),
        ("roughplastic", {"alpha": 1, "diffuse_reflectance": 1}),
        ("roughplastic", {"alpha": 0.2, "diffuse_reflectance": 1, "nonlinear": True}),
    )
]
ROUGH += [
    {"type": name, "base_color": 1, **settings}
    for name, settings in (
        ("principled", {"metallic": 1, "roughness": 1}),
        ("principled", {"metallic": 1, "roughness": 0.6, "anisotropic": 0.8}),
        ("disneybsdf", {"metallic": 1, "roughness": 1}),
        ("disneymetal", {"roughness": 1}),
        ("disneymetal", {"roughness": 0.6, "anisotropic": 0.8}),
        ("disneyglass", {"roughness": 0.8}),
        ("principledthin", {"spec_trans": 1, "roughness": 1}),
        ("principledthin", {"spec_trans": 1, "roughness": 0.5, "eta": 2.5}),
    )
]


@pytest.mark.parametrize("settings", ROUGH, ids=label)
def test_multiple_scattering_loses_nothing(settings: Settings) -> None:
    bsdf = make_bsdf({**settings, "multiscatter": True})
    for wo in known_directions(bsdf, (1, 0.8, 0.4, 0.1, 0.02)):
        s = study(seen_from(bsdf, wo))
        check_consistency(s)
        check_density(s)
        check_energy(s, most=1 + ENERGY_GAIN["multiscatter"][0])
        if settings["type"] not in NOT_RECIPROCAL:
            check_reciprocity(bsdf, wo)
        if "specular_reflectance" not in settings:
            assert s.value.min() > 0.99, f"{bsdf.name} from {wo} returns {s.value}"


def test_lossless_models_exist() -> None:
    assert set(LOSSLESS) <= set(MODELS)
