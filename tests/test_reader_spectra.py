"""Colours of scene files against Mitsuba's `rgb` mode, and against what can be said without it."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from reader_tools import read

from lajolla.scene.data.cie import ILLUMINANT_D65, OBSERVER_1931
from lajolla.scene.data.conductors import CONDUCTORS
from lajolla.scene.data.ior import INDICES

SPECTRA = (
    "400:0.343, 404:0.445, 408:0.551, 500:0.747, 600:0.74, 700:0.737",
    "400:0.04 500:0.058 550:0.061 580:0.09 600:0.287 620:0.513 700:0.642",
    "300:0.2, 900:0.9",
    "500:0.3,600:0.9",
)


@pytest.fixture(scope="module")
def mi() -> ModuleType:
    """Mitsuba in its plain RGB variant."""
    module = pytest.importorskip("mitsuba")
    module.set_variant("scalar_rgb")
    module.set_log_level(module.LogLevel.Error)
    return module


def mitsuba_value(mi: ModuleType, body: str, parameter: str) -> np.ndarray:
    """The RGB value that Mitsuba gives a parameter of the only shape of a scene."""
    scene = mi.load_string(f'<scene version="3.0.0"><shape type="sphere">{body}</shape></scene>')
    parameters = mi.traverse(scene)
    key = next(key for key in parameters.keys() if key.endswith(parameter))  # noqa: SIM118
    return np.broadcast_to(np.array(parameters[key]), 3)


def our_entry(folder: Path, kind: str, body: str) -> dict[str, Any]:
    """The first entry of a kind of a scene with one shape."""
    return read(folder, f'<shape type="sphere">{body}</shape>').core[kind][0]


@pytest.mark.parametrize("spectrum", SPECTRA)
def test_spectra(spectrum: str, tmp_path: Path, mi: ModuleType) -> None:
    cases = {
        ("bsdfs", "reflectance"): '<bsdf type="diffuse"><spectrum name="reflectance" value="{}"/></bsdf>',
        ("emitters", "radiance"): '<emitter type="area"><spectrum name="radiance" value="{}"/></emitter>',
        ("bsdfs", "eta"): '<bsdf type="conductor"><spectrum name="eta" value="{}"/>'
        '<spectrum name="k" value="1"/></bsdf>',
    }
    for (kind, name), form in cases.items():
        body = form.format(spectrum)
        expected = mitsuba_value(mi, body, f"{name}.value")
        assert np.allclose(our_entry(tmp_path, kind, body)[name], expected, rtol=1e-5, atol=1e-6), name


def test_bright_reflectances_are_clamped_as_in_mitsuba(tmp_path: Path, mi: ModuleType) -> None:
    body = '<bsdf type="diffuse"><spectrum name="reflectance" value="400:0, 500:0.8, 600:15, 700:18"/></bsdf>'
    expected = mitsuba_value(mi, body, "reflectance.value")
    assert np.allclose(our_entry(tmp_path, "bsdfs", body)["reflectance"], expected)


def test_conductors(mi: ModuleType) -> None:
    for name, (eta, k) in CONDUCTORS.items():
        parameters = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
        assert np.allclose(parameters["eta.value"], eta, rtol=1e-4, atol=1e-5), name
        assert np.allclose(parameters["k.value"], k, rtol=1e-4, atol=1e-5), name


def test_named_indices_of_refraction(mi: ModuleType) -> None:
    for name, value in INDICES.items():
        parameters = mi.traverse(mi.load_dict({"type": "dielectric", "int_ior": name, "ext_ior": "vacuum"}))
        assert parameters["eta"] == pytest.approx(value, rel=1e-6), name


def test_one_number_is_the_same_in_all_channels(tmp_path: Path) -> None:
    lamp = '<emitter type="area"><spectrum name="radiance" value="5000"/></emitter>'
    assert our_entry(tmp_path, "emitters", lamp)["radiance"] == (5000, 5000, 5000)
    paint = '<bsdf type="diffuse"><spectrum name="reflectance" value="0.3"/></bsdf>'
    assert our_entry(tmp_path, "bsdfs", paint)["reflectance"] == (0.3, 0.3, 0.3)


@pytest.mark.parametrize(
    ("element", "expected"),
    [
        ('<rgb name="reflectance" value=".1, .2 .3"/>', (0.1, 0.2, 0.3)),
        ('<rgb name="reflectance" value=".4"/>', (0.4, 0.4, 0.4)),
        ('<rgb name="reflectance" value="#ff8000"/>', (1, 128 / 255, 0)),
        ('<srgb name="reflectance" value="#ff8000"/>', (1, 0.2158605, 0)),
        ('<srgb name="reflectance" value="0.5"/>', (0.2140411,) * 3),
        ('<float name="reflectance" value="0.5"/>', (0.5,) * 3),
        ('<spectrum name="reflectance" value="0.1 0.2 0.3"/>', (0.1, 0.2, 0.3)),
        (
            '<spectrum name="reflectance" type="uniform"><float name="value" value=".6"/></spectrum>',
            (0.6,) * 3,
        ),
        ('<texture name="reflectance" type="d65"><float name="scale" value=".5"/></texture>', (0.5,) * 3),
    ],
)
def test_spellings_of_a_colour(element: str, expected: tuple[float, ...], tmp_path: Path) -> None:
    body = f'<bsdf type="diffuse">{element}</bsdf>'
    assert np.allclose(our_entry(tmp_path, "bsdfs", body)["reflectance"], expected, atol=1e-6)


def test_spectrum_files_and_objects_are_the_same_as_lists(tmp_path: Path) -> None:
    (tmp_path / "light.spd").write_text("# nm value\n400 1\n\n500 2 # peak\n600.0\t1.5\n")
    forms = [
        '<spectrum name="radiance" value="400:1, 500:2, 600:1.5"/>',
        '<spectrum name="radiance" filename="light.spd"/>',
        '<spectrum name="radiance" type="irregular"><string name="wavelengths" value="400, 500, 600"/>'
        '<string name="values" value="1, 2, 1.5"/></spectrum>',
        '<spectrum name="radiance" type="regular"><float name="wavelength_min" value="400"/>'
        '<float name="wavelength_max" value="600"/><string name="values" value="1, 2, 1.5"/></spectrum>',
    ]
    colours = [
        our_entry(tmp_path, "emitters", f'<emitter type="area">{f}</emitter>')["radiance"] for f in forms
    ]
    assert all(np.allclose(colour, colours[0]) for colour in colours)


def test_blackbody_has_the_luminance_of_plancks_law(tmp_path: Path) -> None:
    """Near 2856 K (illuminant A) the chromaticity is (0.4476, 0.4074)."""
    body = '<emitter type="area"><blackbody name="radiance" temperature="2856k" scale="2"/></emitter>'
    rgb = np.array(our_entry(tmp_path, "emitters", body)["radiance"])
    to_xyz = np.linalg.inv(
        [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]]
    )
    xyz = to_xyz @ rgb
    assert np.allclose(xyz[:2] / xyz.sum(), (0.4476, 0.4074), atol=5e-4)
    double = body.replace('scale="2"', 'scale="4"')
    assert np.allclose(our_entry(tmp_path, "emitters", double)["radiance"], 2 * rgb)


def test_tables_have_the_known_white_points() -> None:
    """Chromaticity of D65 is (0.3127, 0.3290); the observer's three curves have equal areas."""
    xyz = OBSERVER_1931.T @ ILLUMINANT_D65
    assert np.allclose(xyz[:2] / xyz.sum(), (0.3127, 0.3290), atol=1e-4)
    assert np.allclose(OBSERVER_1931.sum(axis=0) / OBSERVER_1931[:, 1].sum(), 1, atol=2e-3)
