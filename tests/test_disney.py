"""Disney's models against Mitsuba 3's values, the equations of lajolla's course, and renders made with it.

The equations are those of the first homework of CSE 272 (Li, UC San Diego), written out in NumPy and double
precision here. The renders were made with an implementation of that homework that is not ours.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from oracle import Estimate, Setup, render_with_lajolla, restate
from reader_tools import error_of, messages, read, write_scene
from scatter_tools import JOINT_SETTINGS, MODELS, Settings, direction, make_bsdf, random_value, settings_of
from scipy import stats
from statistics_tools import generator, uniforms

import lajolla
from lajolla import _core

SHARED = Path(__file__).resolve().parents[2] / "shared" / "scenes"
SCENES = SHARED / "lajolla" / "disney_bsdf_test"
RENDERS = SHARED / "lajolla-refs"
RELATIVE, ABSOLUTE = 1e-4, 2e-6  # of values: float32, and where a half vector is a difference of long vectors


def random_directions(rng: np.random.Generator, count: int) -> np.ndarray:
    directions = rng.normal(size=(count, 3))
    return (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)


def random_settings(name: str, rng: np.random.Generator) -> Settings:
    """All fields at random; half of the fractions are zero, and no highlight is narrower than float32."""
    settings: Settings = {"type": name}
    for field in MODELS[name]["fields"]:
        if field["name"] == "multiscatter":
            continue
        value = random_value(field, rng)
        if field["name"] == "roughness":
            value = rng.uniform(0.2, 1)
        elif field["name"] == "eta":
            value = (
                rng.uniform(0.6, 0.9) if rng.random() < 0.3 and name != "disneybsdf" else rng.uniform(1.1, 2)
            )
        elif field["type"] == "texture_float" and rng.random() < 0.5:
            value = 0.0
        settings[field["name"]] = value
    return settings


# --- Mitsuba ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["principled", "principledthin"])
def test_values_are_those_of_mitsuba(name: str) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    rng = generator("mitsuba", name)
    hit, context = mi.SurfaceInteraction3f(), mi.BSDFContext(mi.TransportMode.Importance)  # without 1 / eta^2
    for _ in range(40):
        settings = random_settings(name, rng)
        theirs = mi.load_dict({**settings, "base_color": {"type": "rgb", "value": settings["base_color"]}})
        ours = _core.Bsdf(settings)
        for wo, wi in zip(random_directions(rng, 40), random_directions(rng, 40), strict=True):
            hit.wi = mi.Vector3f(*map(float, wo))
            expected = np.array(theirs.eval(context, hit, mi.Vector3f(*map(float, wi))))
            value = ours.eval_many(wo[None], wi[None])[0][0]
            np.testing.assert_allclose(value, expected, RELATIVE, ABSOLUTE, err_msg=f"{settings} {wo} {wi}")


# --- The equations of the course --------------------------------------------------------------------

Directions = np.ndarray  # (N, 3)


def dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(-1)[:, None]


def halfway(wo: Directions, wi: Directions) -> Directions:
    return (wo + wi) / np.linalg.norm(wo + wi, axis=1, keepdims=True)


def masking(w: Directions, ax: float, ay: float) -> np.ndarray:
    x, y, z = w.T[:, :, None]
    return 2 / (1 + np.sqrt(1 + ((x * ax) ** 2 + (y * ay) ** 2) / z**2))


def ggx(s: Settings, wo: Directions, wi: Directions, h: Directions) -> np.ndarray:
    """D_m G_m."""
    aspect = np.sqrt(1 - 0.9 * s["anisotropic"])
    ax, ay = max(1e-4, s["roughness"] ** 2 / aspect), max(1e-4, s["roughness"] ** 2 * aspect)
    x, y, z = h.T[:, :, None]
    d = 1 / (np.pi * ax * ay * ((x / ax) ** 2 + (y / ay) ** 2 + z**2) ** 2)
    return d * masking(wo, ax, ay) * masking(wi, ax, ay)


def schlick(f0: np.ndarray | float, cosine: np.ndarray) -> np.ndarray:
    return f0 + (1 - f0) * (1 - cosine) ** 5


def tint(base: np.ndarray, amount: float) -> np.ndarray:
    y = base @ (0.212671, 0.715160, 0.072169)
    return 1 - amount + amount * (base / y if y > 0 else 1)


def diffuse(s: Settings, wo: Directions, wi: Directions) -> np.ndarray:
    o, i, d = wo[:, 2:], wi[:, 2:], dots(halfway(wo, wi), wi)
    f90, ss90 = 0.5 + 2 * s["roughness"] * d**2, s["roughness"] * d**2

    def f(grazing: np.ndarray, cosine: np.ndarray) -> np.ndarray:
        return 1 + (grazing - 1) * (1 - cosine) ** 5

    base = np.asarray(s["base_color"])
    subsurface = 1.25 * (f(ss90, o) * f(ss90, i) * (1 / (o + i) - 0.5) + 0.5)
    mixed = (1 - s["subsurface"]) * f(f90, o) * f(f90, i) + s["subsurface"] * subsurface
    return base / np.pi * mixed * i


def sheen(s: Settings, wo: Directions, wi: Directions) -> np.ndarray:
    colour = tint(np.asarray(s["base_color"]), s["sheen_tint"])
    return colour * (1 - dots(halfway(wo, wi), wi)) ** 5 * wi[:, 2:]


def metal(s: Settings, wo: Directions, wi: Directions) -> np.ndarray:
    """Early handouts print the angle of wi with the surface in Schlick's term. What is reflected then depends
    on which of the two directions is called wi; the angle with the facet is the same for both."""
    h = halfway(wo, wi)
    f = schlick(np.asarray(s.get("c0", s["base_color"])), dots(h, wi))
    return f * ggx(s, wo, wi, h) / (4 * wo[:, 2:])


def clearcoat(s: Settings, wo: Directions, wi: Directions) -> np.ndarray:
    h = halfway(wo, wi)
    alpha2 = (0.1 + s["clearcoat_gloss"] * (0.001 - 0.1)) ** 2
    d = (alpha2 - 1) / (np.pi * np.log(alpha2) * (1 + (alpha2 - 1) * h[:, 2:] ** 2))
    g = masking(wo, 0.25, 0.25) * masking(wi, 0.25, 0.25)
    return schlick(0.04, dots(h, wi)) * d * g / (4 * wo[:, 2:]) * np.ones(3)


def glass(s: Settings, wo: Directions, wi: Directions) -> np.ndarray:
    """Without the 1 / eta^2 of radiance; from below with the inverse index."""
    result = np.zeros((len(wo), 3))
    for reflected in (False, True):
        for above in (False, True):
            rows = ((wo[:, 2] * wi[:, 2] > 0) == reflected) & ((wo[:, 2] > 0) == above)
            result[rows] = _glass(s, wo[rows], wi[rows], reflected, s["eta"] if above else 1 / s["eta"])
    return result


def _glass(s: Settings, wo: Directions, wi: Directions, reflected: bool, eta: float) -> np.ndarray:
    h = wo + wi * (1 if reflected else eta)
    h *= np.sign(h[:, 2:]) / np.linalg.norm(h, axis=1, keepdims=True)
    o, i = dots(h, wo), dots(h, wi)
    cos_o = np.abs(o)
    cos_t = np.sqrt(np.maximum(1 - (1 - o**2) / eta**2, 0))
    r_s, r_p = (cos_o - eta * cos_t) / (cos_o + eta * cos_t), (eta * cos_o - cos_t) / (eta * cos_o + cos_t)
    f = (r_s**2 + r_p**2) / 2
    shape, base = ggx(s, wo, wi, h) / np.abs(wo[:, 2:]), np.asarray(s["base_color"])
    same_side = (o * wo[:, 2:] > 0) & (i * wi[:, 2:] > 0)
    if reflected:
        return same_side * base * f * shape / 4
    return same_side * np.sqrt(base) * (1 - f) * shape * np.abs(o * i) * eta**2 / (o + eta * i) ** 2


def everything(s: Settings, wo: Directions, wi: Directions) -> np.ndarray:
    m, t, base = s["metallic"], s["specular_transmission"], np.asarray(s["base_color"])
    r0 = ((s["eta"] - 1) / (s["eta"] + 1)) ** 2
    c0 = s["specular"] * r0 * (1 - m) * tint(base, s["specular_tint"]) + m * base
    above = (wo[:, 2:] > 0) & (wi[:, 2:] > 0)
    wo_up, wi_up = (np.column_stack([w[:, :2], np.abs(w[:, 2])]) for w in (wo, wi))
    opaque = (
        (1 - t) * (1 - m) * diffuse(s, wo_up, wi_up)
        + (1 - m) * s["sheen"] * sheen(s, wo_up, wi_up)
        + (1 - t * (1 - m)) * metal({**s, "c0": c0}, wo_up, wi_up)
        + 0.25 * s["clearcoat"] * clearcoat(s, wo_up, wi_up)
    )
    return above * opaque + (1 - m) * t * glass(s, wo, wi)


EQUATIONS: dict[str, Callable[[Settings, Directions, Directions], np.ndarray]] = {
    "disneydiffuse": diffuse,
    "disneysheen": sheen,
    "disneymetal": metal,
    "disneyclearcoat": clearcoat,
    "disneyglass": glass,
    "disneybsdf": everything,
}


@pytest.mark.parametrize("name", EQUATIONS)
def test_values_are_those_of_the_equations(name: str) -> None:
    rng = generator("equations", name)
    for _ in range(30):
        settings = random_settings(name, rng)
        bsdf = make_bsdf(settings)
        wo, wi = random_directions(rng, 400), random_directions(rng, 400)
        if not bsdf.transmissive and name != "disneybsdf":
            wo[:, 2], wi[:, 2] = np.abs(wo[:, 2]), np.abs(wi[:, 2])
        if not bsdf.transmissive:
            wo[:, 2] = np.abs(wo[:, 2])
        expected = EQUATIONS[name](settings, wo.astype(float), wi.astype(float))
        value = np.concatenate([bsdf.evaluate(o, i)[0] for o, i in zip(wo, wi, strict=True)])
        np.testing.assert_allclose(value, expected, RELATIVE, ABSOLUTE, err_msg=str(settings))


# --- Sampling ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*EQUATIONS, "principled", "principledthin"])
def test_weights_are_bounded(name: str) -> None:
    """Parts are chosen by what they scatter: no sample weighs much more than all of them together."""
    # Sheen is not sampled but with the diffuse part: at its rim it weighs pi times its hue.
    heaviest = 6
    for settings in [settings_of(name)[0], *settings_of(name)[-JOINT_SETTINGS:]]:
        bsdf = make_bsdf(settings)
        for cosine in (1, 0.7, 0.3, 0.1):
            for side in (1, -1) if bsdf.transmissive else (1,):
                draws = bsdf.sample(
                    direction(cosine, 0.7) * (1, 1, side), uniforms(generator("weights"), 20000, 3)
                )
                assert not draws.valid.any() or draws.weight[draws.valid].max() < heaviest


# --- Scenes -----------------------------------------------------------------------------------------

ALLOWANCE = 0.01  # the environment of these scenes is 0.4 % brighter than there, wherever one looks
# Sizes of blocks in pixels: small ones tell where, large ones see less noise. Rims of the ball that light
# passes through are 5 to 10 % brighter here than there.
BLOCKS = {"diffuse": (16, 64), "metal": (16, 64), "clearcoat": (16, 64), "sheen": (16, 64), "bsdf": (16,)}
SAMPLES, REFERENCE_SAMPLES = 8, 256  # per pixel, for means and their errors
DARK = 0.05  # of the mean of the picture
DEVIATIONS, FAMILY_WISE_ERROR = 4, 1e-3


@pytest.mark.parametrize("name", BLOCKS)
def test_scenes_look_as_others_render_them(name: str) -> None:
    """Channel means, and means of blocks of pixels: no more of them differ than chance allows.

    A block that is nearly black in the other picture is lit by few paths, and where these are missing so is
    the noise that would tell: means of a thousand samples are still far from normal there. Such blocks are
    joined into one, as cells that expect few counts are. The others differ as normal numbers do.
    Of other completions of the homework, some differ from this metal by 7 %. Ours agrees with it.
    """
    scene, render = SCENES / f"disney_{name}.xml", RENDERS / f"disney_{name}.exr"
    if not (scene.is_file() and render.is_file()):
        pytest.fail(f"no {scene}") if os.environ.get("CI") else pytest.skip(f"no {scene}")
    import OpenImageIO as oiio

    theirs = np.asarray(oiio.ImageBuf(str(render)).get_pixels(oiio.FLOAT), dtype=np.float64)[..., :3]
    ours = render_with_lajolla(scene, spp=SAMPLES, batches=SAMPLES, setup=Setup(max_depth=None))
    squares = ours.batches.var(axis=0, ddof=1) / SAMPLES  # estimates the variance of a pixel's mean
    for size in BLOCKS[name]:
        images = [Estimate(image[None]).blocks(size)[0] for image in (ours.mean, theirs, squares)]
        dark = (images[1] < DARK * theirs.mean()).any(-1)
        count = max(int(dark.sum()), 1)
        a, b = (np.vstack([image[~dark], image[dark].sum(0)[None] / count]) for image in images[:2])
        variance = np.vstack([images[2][~dark], images[2][dark].sum(0)[None] / count**2]) / size**2
        error = np.sqrt(variance * (1 + SAMPLES / REFERENCE_SAMPLES))
        differ = (np.abs(a - b) - ALLOWANCE * b > DEVIATIONS * error).any(-1)
        chance = 3 * 2 * stats.norm.sf(DEVIATIONS)  # in any channel
        at_most = stats.binom.isf(FAMILY_WISE_ERROR, len(differ), chance)
        assert differ.sum() <= at_most, (
            f"{differ.sum()} of {len(differ)} blocks of {size} x {size} pixels differ, "
            f"by chance {at_most:.0f}"
        )
    ratio = ours.mean.mean((0, 1)) / theirs.mean((0, 1))
    noise = np.sqrt(squares.sum((0, 1))) / squares[..., 0].size / theirs.mean((0, 1))
    assert (np.abs(ratio - 1) < ALLOWANCE + 3 * noise).all(), f"means differ: {ratio}, noise {noise}"


@pytest.mark.parametrize("name", ["disney_glass", "disney_bsdf_array", "simple_sphere"])
def test_other_scenes_render(name: str, tmp_path: Path) -> None:
    scene = SCENES / f"{name}.xml"
    if not scene.is_file():
        pytest.fail(f"no {scene}") if os.environ.get("CI") else pytest.skip(f"no {scene}")
    loaded = lajolla.load(restate(scene, tmp_path / "scene.xml", Setup(width=32, height=24)))
    assert not [w for w in loaded.warnings if "bsdf" in str(w)]
    image = loaded.render(spp=4, threads=os.cpu_count()).array
    assert np.isfinite(image).all() and image.max() > 0


# --- The reader -------------------------------------------------------------------------------------

SPHERE = '<shape type="sphere">{}</shape>'
DISNEY = """<bsdf type="disneybsdf"><rgb name="{}" value="0.1 0.2 0.3"/><float name="{}" value="0.25"/>
    <float name="{}" value="0.75"/></bsdf>"""


@pytest.mark.parametrize("version", ["0.5.0", "3.0.0"])
@pytest.mark.parametrize(
    "names",
    [
        ("baseColor", "specularTransmission", "clearcoatGloss"),
        ("base_color", "specular_transmission", "clearcoat_gloss"),
        ("base_color", "spec_trans", "clearcoat_gloss"),
        ("baseColor", "specTrans", "clearcoatGloss"),
    ],
)
def test_both_spellings(tmp_path: Path, version: str, names: tuple[str, ...]) -> None:
    description = read(tmp_path, SPHERE.format(DISNEY.format(*names)), version)
    assert not messages(description, tmp_path)
    (bsdf,) = description.core["bsdfs"]
    assert bsdf == {
        "type": "disneybsdf",
        "base_color": (0.1, 0.2, 0.3),
        "specular_transmission": 0.25,
        "clearcoat_gloss": 0.75,
    }


@pytest.mark.parametrize(
    "bsdf, eta",
    [
        ('<bsdf type="principled"><float name="specular" value="0.5"/></bsdf>', 1.5),
        ('<bsdf type="principled"><float name="eta" value="1.33"/></bsdf>', 1.33),
        ('<bsdf type="principled"><float name="specular" value="0"/></bsdf>', 1.0),
        ('<bsdf type="disneyglass"><float name="eta" value="1.4"/></bsdf>', 1.4),
        ('<bsdf type="disneyglass"><string name="intIOR" value="water"/></bsdf>', 1.333),
        ("""<bsdf type="disneybsdf"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1.2"/>
         </bsdf>""", 1.25),
    ],
)  # fmt: skip
def test_index_of_refraction(tmp_path: Path, bsdf: str, eta: float) -> None:
    description = read(tmp_path, SPHERE.format(bsdf))
    assert not messages(description, tmp_path)
    assert description.core["bsdfs"][0]["eta"] == pytest.approx(eta)


def test_eta_and_specular_exclude_each_other(tmp_path: Path) -> None:
    both = '<float name="eta" value="1.5"/><float name="specular" value="0.5"/>'
    message = error_of(tmp_path, SPHERE.format(f'<bsdf type="principled">{both}</bsdf>'))
    assert 'either "eta" or "specular"' in message


@pytest.mark.parametrize("eta", [0, -1, 1e9])
def test_impossible_indices_are_refused(tmp_path: Path, eta: float) -> None:
    body = SPHERE.format(f'<bsdf type="disneyglass"><float name="eta" value="{eta}"/></bsdf>')
    with pytest.raises(lajolla.SceneError, match="eta"):
        lajolla.load(write_scene(tmp_path, body))


@pytest.mark.parametrize(
    "name, field", [("principled", "spec_trans"), ("disneybsdf", "specular_transmission")]
)
def test_opaque_without_transmission(tmp_path: Path, name: str, field: str) -> None:
    """Such a BSDF has a back of its own, or none."""
    assert not _core.transmissive({"type": name})
    assert _core.transmissive({"type": name, field: 0.5})
    assert _core.transmissive({"type": name, field: {"texture": 0}})
    for value, told in ((0, 0), (0.5, 1)):
        inner = f'<bsdf type="{name}"><float name="{field}" value="{value}"/></bsdf>'
        description = read(tmp_path, SPHERE.format(f'<bsdf type="twosided">{inner}</bsdf>'))
        assert (
            len([m for m in messages(description, tmp_path) if "cannot contain a transmissive bsdf" in m])
            == told
        )
    wo = np.float32([[0, 0, -1]])
    value, pdf = _core.Bsdf({"type": name}).eval_many(wo, wo)
    assert not value.any() and not pdf.any()
