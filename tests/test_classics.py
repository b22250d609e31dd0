"""The BSDFs of Mitsuba 0.6 against their formulas as that renderer has them, written down once more."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from reader_tools import error_of, messages, read
from scatter_tools import MODELS, direction, make_bsdf

SPHERE = '<shape type="sphere">{}</shape>'
WO = direction(0.6, 0.4)
WI = np.array([direction(c, a) for c in (0.95, 0.5, 0.1) for a in (0.2, 1.7, 3.4, 5.1)], np.float32)
COSINE = WI[:, 2].astype(float)


def value(description: dict, wo: np.ndarray = WO) -> np.ndarray:
    """The BSDF's first channel, without the cosine."""
    return make_bsdf(description).evaluate(wo, WI)[0][:, 0] / np.abs(COSINE)


def test_phong() -> None:
    mirrored = WO * (-1, -1, 1)
    lobe = np.maximum(WI @ mirrored, 0) ** 20
    expected = 0.3 / np.pi + 0.4 * 22 / (2 * np.pi) * lobe
    description = {"type": "phong", "exponent": 20, "diffuse_reflectance": 0.3, "specular_reflectance": 0.4}
    np.testing.assert_allclose(value(description), expected, rtol=1e-4)


def test_colours_of_phong_add_up_to_one_at_most() -> None:
    bright = {"type": "phong", "diffuse_reflectance": 1, "specular_reflectance": [0.6, 0, 1]}
    scaled = {"type": "phong", "diffuse_reflectance": 0.5, "specular_reflectance": [0.3, 0, 0.5]}
    np.testing.assert_allclose(value(bright), value(scaled), rtol=1e-5)


@pytest.mark.parametrize("variant", ["ward", "ward-duer", "balanced"])
def test_ward(variant: str) -> None:
    a, b = 0.4, 0.7
    h = WI + WO
    cosines = COSINE * WO[2]
    factor = {
        "ward": 1 / (4 * np.pi * a * b * np.sqrt(cosines)),
        "ward-duer": 1 / (4 * np.pi * a * b * cosines),
        "balanced": (h**2).sum(1) / (np.pi * a * b * h[:, 2] ** 4),
    }[variant]
    gauss = np.exp(-((h[:, 0] / a) ** 2 + (h[:, 1] / b) ** 2) / h[:, 2] ** 2)
    expected = 0.1 / np.pi + 0.6 * factor * gauss
    colours = {"diffuse_reflectance": 0.1, "specular_reflectance": 0.6}
    found = value({"type": "ward", "variant": variant, "alpha_u": a, "alpha_v": b, **colours})
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def oren_nayar(rho: float, alpha: float, fast: bool) -> np.ndarray:
    """Equations 27 to 30 of Oren and Nayar 1994, times pi / E_0; the short form is equation 30's."""
    s2 = alpha**2 / 2
    ti, to = np.arccos(COSINE), np.arccos(WO[2])
    big, small = np.maximum(ti, to), np.minimum(ti, to)
    phi = np.arctan2(WI[:, 1], WI[:, 0]) - np.arctan2(WO[1], WO[0])
    c1 = 1 - 0.5 * s2 / (s2 + 0.33)
    if fast:
        slope = 0.45 * s2 / (s2 + 0.09) * np.maximum(np.cos(phi), 0)
        return rho / np.pi * (c1 + slope * np.sin(big) * np.tan(small))
    near = np.cos(phi) >= 0
    c2 = 0.45 * s2 / (s2 + 0.09) * (np.sin(big) - np.where(near, 0, (2 * small / np.pi) ** 3))
    c3 = 0.125 * s2 / (s2 + 0.09) * (4 * big * small / np.pi**2) ** 2
    one = c1 + np.cos(phi) * c2 * np.tan(small) + (1 - np.abs(np.cos(phi))) * c3 * np.tan((big + small) / 2)
    two = 0.17 * s2 / (s2 + 0.13) * (1 - np.cos(phi) * (2 * small / np.pi) ** 2)
    return rho / np.pi * (one + rho * two)


@pytest.mark.parametrize("alpha", [0.05, 0.2, 0.9])
@pytest.mark.parametrize("variant", ["full", "fast"])
def test_rough_diffuse(variant: str, alpha: float) -> None:
    found = value({"type": "roughdiffuse", "variant": variant, "alpha": alpha, "reflectance": 0.7})
    np.testing.assert_allclose(found, oren_nayar(0.7, alpha, variant == "fast"), rtol=1e-4)


def test_energy_preserving_rough_diffuse_is_close_to_the_other() -> None:
    """Where few bounces count, both models of the same surface agree within a few percent."""
    found = value({"type": "roughdiffuse", "variant": "energy-preserving", "alpha": 0.3, "reflectance": 0.3})
    np.testing.assert_allclose(found[:8], oren_nayar(0.3, 0.3, False)[:8], rtol=0.05)


def test_names_of_mitsuba_0_6(tmp_path: Path) -> None:
    """Parameters, second names and defaults; textures stand wherever 0.6 takes them."""
    checker = '<texture type="checkerboard" name="{}"/>'
    body = "".join(
        SPHERE.format(bsdf)
        for bsdf in (
            '<bsdf type="ward"><float name="alpha" value="0.4"/>'
            '<spectrum name="diffuseReflectance" value="0"/></bsdf>',
            '<bsdf type="ward"><string name="variant" value="ward-duer"/>'
            '<float name="alphaU" value="0.2"/></bsdf>',
            f'<bsdf type="phong">{checker.format("exponent")}{checker.format("specularReflectance")}</bsdf>',
            '<bsdf type="roughdiffuse"><rgb name="diffuseReflectance" value="0.2"/>'
            f'<boolean name="useFastApprox" value="true"/>{checker.format("alpha")}</bsdf>',
            f'<bsdf type="difftrans">{checker.format("diffuseTransmittance")}</bsdf>',
        )
    )
    description = read(tmp_path, body, "0.6.0")
    assert not [m for m in messages(description, tmp_path) if "does not support" in m or "unknown" in m]
    ward, duer, phong, rough, through = description.core["bsdfs"]
    assert (ward["alpha_u"], ward["alpha_v"], ward["diffuse_reflectance"]) == (0.4, 0.4, (0, 0, 0))
    assert (duer["variant"], duer["alpha_u"], "alpha_v" in duer) == ("ward-duer", 0.2, False)
    assert phong["exponent"].keys() == phong["specular_reflectance"].keys() == {"texture"}
    assert (rough["variant"], rough["reflectance"]) == ("fast", (0.2, 0.2, 0.2))
    assert "texture" in rough["alpha"] and "texture" in through["transmittance"]


def test_ggx_of_other_authors_is_ggx(tmp_path: Path) -> None:
    description = read(tmp_path, SPHERE.format('<bsdf type="roughconductorGGX"/>'), "0.6.0")
    assert description.core["bsdfs"][0]["distribution"] == "ggx"


@pytest.mark.parametrize(
    "body",
    [
        SPHERE.format('<bsdf type="RoughConductor"/>'),
        SPHERE.format('<bsdf type="RoughConductorGGX"/>'),
        SPHERE.format('<bsdf type="Diffuse"><rgb name="diffuseReflectance" value="1, 0, 0"/></bsdf>'),
        SPHERE.format('<medium name="interior" type="Homogeneous"/>'),
        '<emitter type="Sun"/>',
        '<integrator type="ErrCtrl"><integrator type="volpath"/></integrator>',
    ],
)
def test_plugins_of_old_files_have_names_in_any_case(body: str, tmp_path: Path) -> None:
    body += '<emitter type="constant"/>'  # or else a sky is added, an image in memory
    lower = re.sub(r'type="\w+"', lambda found: found[0].lower(), body)
    given, plain = (read(tmp_path, text, "0.6.0") for text in (body, lower))
    assert repr(given.core) == repr(plain.core)
    assert len(given.warnings) == len(plain.warnings)


def hair_of_mitsuba(parameters: dict, wo: np.ndarray, wi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and densities of Mitsuba's hair, where it calls our wo `wi`."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    colour = {"type": "rgb", "value": parameters["sigma_a"]}
    bsdf = mi.load_dict({"type": "hair", **parameters, "sigma_a": colour})
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*map(float, wo))
    pairs = [bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(*map(float, w))) for w in wi]
    return np.array([np.array(value) for value, _ in pairs]), np.array([float(pdf) for _, pdf in pairs])


@pytest.mark.parametrize(
    "parameters",
    [
        {"sigma_a": [0.1, 0.5, 1.2]},
        {"sigma_a": [0.0, 0.02, 3], "longitudinal_roughness": 0.15, "azimuthal_roughness": 0.6},
        {"sigma_a": [0.3, 0.3, 0.1], "longitudinal_roughness": 0.8, "scale_tilt": 10, "int_ior": 1.3},
    ],
    ids=["default", "sharp", "wide"],
)
def test_hair_is_mitsubas(parameters: dict) -> None:
    """Mitsuba's log I_0(x) has 1 / (16 x) where the series has 1 / (8 x): up to 0.6 % from x = 12 on."""
    rng = np.random.default_rng(3)
    wi = rng.normal(size=(300, 3))
    wi = (wi / np.linalg.norm(wi, axis=1, keepdims=True)).astype(np.float32)
    bsdf = make_bsdf({"type": "hair", **parameters})
    for wo in (direction(0.9, 1.0), direction(0.3, 4.0), direction(0.2, 1.5)):
        values, densities = hair_of_mitsuba(parameters, wo, wi)
        found, pdf = bsdf.evaluate(wo, wi)
        np.testing.assert_allclose(found, values, rtol=6e-3, atol=1e-5)
        np.testing.assert_allclose(pdf, densities, rtol=6e-3, atol=1e-5)


def test_colours_of_hair(tmp_path: Path) -> None:
    """Pigments, an absorption or a colour; a lock of that colour has nearly that albedo."""
    body = "".join(
        SPHERE.format(f'<bsdf type="hair">{inside}</bsdf>')
        for inside in (
            '<float name="eumelanin" value="1.3"/>',
            '<rgb name="sigma_a" value="1 2 3"/><float name="scale" value="2"/>',
            '<rgb name="color" value="0.8 0.5 0.2"/>',
        )
    )
    pigments, absorbing, coloured = read(tmp_path, body).core["bsdfs"]
    np.testing.assert_allclose(pigments["sigma_a"], MODELS["hair"]["fields"][0]["default"], rtol=1e-3)
    assert (absorbing["sigma_a"], absorbing["scale"]) == ((1, 2, 3), 2)
    assert 0 < coloured["sigma_a"][0] < coloured["sigma_a"][1] < coloured["sigma_a"][2]
    both = '<bsdf type="hair"><float name="eumelanin" value="1"/><rgb name="color" value="1 0 0"/></bsdf>'
    assert "takes one of" in error_of(tmp_path, SPHERE.format(both))


def test_hair_on_curves_looks_as_in_mitsuba(tmp_path: Path) -> None:
    pytest.importorskip("mitsuba")
    from oracle import Setup, differences, render_with_lajolla, render_with_mitsuba

    rng = np.random.default_rng(5)
    strands = np.cumsum(
        np.concatenate([rng.normal(size=(40, 1, 3)), 0.5 * rng.normal(size=(40, 5, 3))], 1), 1
    )
    lines = [f"{x} {y} {z} 0.06" for strand in strands for x, y, z in strand]
    blocks = ["\n".join(lines[i : i + 6]) for i in range(0, len(lines), 6)]
    (tmp_path / "hair.txt").write_text("\n\n".join(blocks) + "\n")
    path = tmp_path / "scene.xml"
    path.write_text("""<scene version="3.0.0"><integrator type="path"/>
        <sensor type="perspective"><float name="fov" value="40"/>
            <transform name="to_world"><lookat origin="0, 0, 7" target="0, 0, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="32"/><integer name="height" value="32"/></film>
        </sensor>
        <shape type="bsplinecurve"><string name="filename" value="hair.txt"/>
            <bsdf type="hair"><float name="eumelanin" value="0.3"/></bsdf></shape>
        <emitter type="constant"><rgb name="radiance" value="0.4 0.5 0.7"/></emitter>
        <emitter type="directional"><vector name="direction" x="0.5" y="-1" z="-0.3"/>
            <rgb name="irradiance" value="3 3 2"/></emitter></scene>""")
    setup = Setup(max_depth=6)
    theirs = render_with_mitsuba(path, spp=1024, seed=1000, setup=setup, variant="scalar_rgb")
    found = differences(render_with_lajolla(path, spp=1024, seed=1, setup=setup), theirs)
    assert not found, "\n".join(found)
