"""Measured materials: files, hostile ones included, and the values that Mitsuba 3 finds in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_tools import MEASUREMENTS, Tensors, synthetic, tensor_bytes, write_tensors
from reader_tools import error_of, read
from scatter_tools import direction, known_directions, make_bsdf, seen_from
from statistics_tools import check_consistency, check_density, check_energy, study

from lajolla import _core
from lajolla.scene.data.spectra import integrate
from lajolla.scene.description.plugins.measured import measurement
from lajolla.scene.formats.tensors import TensorError, read_tensors

BODY = '<shape type="sphere"><bsdf type="measured"><string name="filename" value="a.bsdf"/></bsdf></shape>'
KINDS = {"isotropic": (0, True), "all round": (1, True), "half": (2, False), "quarter": (4, True)}


def around(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of directions above the surface."""
    pairs = np.random.default_rng(5).normal(size=(2, count, 3))
    pairs[..., 2] = np.abs(pairs[..., 2]) + 0.02
    wo, wi = pairs / np.linalg.norm(pairs, axis=-1, keepdims=True)
    return wo, wi


def values_of(tensors: Tensors, pairs: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    model = {"type": "measured", "measurement": _core.Measurement(**measurement(tensors))}
    return np.column_stack(make_bsdf(model).evaluate(*pairs))


@pytest.mark.parametrize("kind", KINDS)
def test_values_and_densities_are_mitsubas(kind: str, tmp_path: Path) -> None:
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    path = write_tensors(tmp_path / "a.bsdf", synthetic(*KINDS[kind]))
    theirs = mi.load_dict({"type": "measured", "filename": str(path)})
    si, context = mi.SurfaceInteraction3f(), mi.BSDFContext()
    expected = []
    for wo, wi in zip(*around(), strict=True):
        si.wi = wo.tolist()
        expected.append([*theirs.eval(context, si, wi.tolist()), theirs.pdf(context, si, wi.tolist())])
    ours = np.column_stack(
        make_bsdf({"type": "measured", "measurement": MEASUREMENTS[kind]}).evaluate(*around())
    )
    assert np.count_nonzero(ours.min(1) > 0.001) > 200
    np.testing.assert_allclose(ours, expected, rtol=5e-4, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_every_direction_is_sampled(kind: str) -> None:
    bsdf = make_bsdf({"type": "measured", "measurement": MEASUREMENTS[kind]})
    for wo in known_directions(bsdf, (1, 0.95, 0.8, 0.6, 0.4, 0.2, 0.1, 0.03)):
        s = study(seen_from(bsdf, wo))
        check_consistency(s)
        check_density(s)
        check_energy(s, most=1)


def test_symmetry_folds_azimuths() -> None:
    """Half of the azimuths measured: turned by 180 degrees, all is the same; a quarter: mirrored too."""
    wo, wi = around()
    for kind, signs in (("half", (-1, -1, 1)), ("quarter", (-1, 1, 1)), ("quarter", (1, -1, 1))):
        bsdf = make_bsdf({"type": "measured", "measurement": MEASUREMENTS[kind]})
        for there, mirrored in zip(bsdf.evaluate(wo, wi), bsdf.evaluate(wo * signs, wi * signs), strict=True):
            np.testing.assert_allclose(mirrored, there, rtol=1e-3, atol=1e-6)


def test_roughness_is_that_of_the_normals() -> None:
    assert _core.Bsdf({"type": "measured", "measurement": MEASUREMENTS["isotropic"]}).roughness == (
        pytest.approx(0.3, rel=0.05)
    )
    x = np.linspace(0, 1, 24)
    grazing = changed(ndf=np.tile(np.where(x > 0.97, 1, 0).astype(np.float32), (24, 1)))
    assert _core.Measurement(**measurement(grazing)).roughness == 1


def test_spectra_become_colours() -> None:
    """A spectral file whose spectra are all alike is grey times the colour of that spectrum under D65."""
    tensors = dict(synthetic(channels=12))
    wavelengths = tensors["wavelengths"]
    shape = 0.3 + 0.2 * np.cos(wavelengths / 60)
    grey = tensors["spectra"][:, :, :1]
    tensors["spectra"] = np.float32(grey * shape[:, None, None])
    seen = values_of(tensors, around())
    tensors["rgb"] = np.repeat(grey, 3, axis=2)
    del tensors["wavelengths"]
    expected = values_of(tensors, around()) * [*integrate(wavelengths, shape, d65=True), 1]
    np.testing.assert_allclose(seen, expected, rtol=3e-3, atol=1e-6)


def test_a_flat_spectrum_is_grey_wherever_it_was_measured() -> None:
    tensors = dict(synthetic(channels=5))
    tensors["wavelengths"] = np.linspace(450, 650, 5, dtype=np.float32)
    tensors["spectra"] = np.full_like(tensors["spectra"], 0.4)
    colour = measurement(tensors)["colour"]
    np.testing.assert_allclose(colour, 0.4, rtol=2e-3)


@pytest.mark.parametrize("tensors", [synthetic(), synthetic(2), synthetic(channels=7)])
def test_files_open(tensors: Tensors, tmp_path: Path) -> None:
    back = read_tensors(write_tensors(tmp_path / "a.bsdf", tensors))
    assert all(np.array_equal(back[name], value) for name, value in tensors.items())
    description = read(tmp_path, BODY + BODY)
    _core.Scene(description.core)  # it is accepted
    measured = [entry for entry in description.core["bsdfs"] if entry["type"] == "measured"]
    assert len(measured) == 1  # of both shapes: the file is read once


def changed(**tensors: np.ndarray | None) -> Tensors:
    return {name: value for name, value in (synthetic() | tensors).items() if value is not None}


NAN = np.full((24, 24), np.nan, np.float32)
WHOLE = tensor_bytes(synthetic())
HOSTILE = {
    "nothing": (b"", "not a tensor file"),
    "text": (b"<scene/>" * 10, "not a tensor file"),
    "version": (WHOLE.replace(b"\0\1\0", b"\0\7\0", 1), "version"),
    "a head only": (WHOLE[:14], "cut short"),
    "half": (WHOLE[: len(WHOLE) // 2], "cut short"),
    "many fields": (WHOLE[:14] + b"\xff" * 4 + WHOLE[18:], "4294967295 fields"),
    "many dimensions": (WHOLE.replace(b"theta_i\1\0", b"theta_i\xff\xff", 1), "65535 dimensions"),
    "type": (WHOLE.replace(b"theta_i\1\0\x0a", b"theta_i\1\0\x63", 1), "unknown type 99"),
    "a huge shape": (WHOLE.replace(b"\5" + bytes(7), b"\5" + bytes(6) + b"\x7f", 1), "cut short"),
    "missing": (tensor_bytes(changed(vndf=None)), 'no "vndf"'),
    "no colours": (tensor_bytes(changed(rgb=None)), 'no "rgb"'),
    "not finite": (tensor_bytes(changed(ndf=NAN)), '"ndf" has values that are not finite'),
    "doubles": (tensor_bytes(changed(ndf=np.ones((24, 24)))), '"ndf" must be 32-bit numbers'),
    "flat": (tensor_bytes(changed(ndf=NAN[0])), '"ndf" must be 32-bit numbers over y x'),
    "one row": (tensor_bytes(changed(sigma=np.ones((1, 24), np.float32))), '"sigma" has an unexpected shape'),
    "directions": (tensor_bytes(changed(theta_i=np.arange(4, dtype=np.float32))), "as many directions"),
    "falling": (tensor_bytes(changed(theta_i=-np.arange(5, dtype=np.float32))), "do not rise"),
    "channels": (tensor_bytes(changed(rgb=synthetic()["rgb"][:, :, :2])), "three channels"),
    "jacobian": (tensor_bytes(changed(jacobian=None)), '"jacobian" is missing'),
    "many wavelengths": (
        tensor_bytes(
            changed(
                spectra=np.zeros((1, 5, 5000, 2, 2), np.float32),
                wavelengths=np.arange(5000, dtype=np.float32),
            )
        ),
        "5000 wavelengths",
    ),
    "wavelengths": (
        tensor_bytes(synthetic(channels=7) | {"wavelengths": np.zeros(7, np.float32)}),
        '"wavelengths" do not rise',
    ),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_files_are_refused_with_the_place(case: str, tmp_path: Path) -> None:
    data, message = HOSTILE[case]
    (tmp_path / "a.bsdf").write_bytes(data)
    text = error_of(tmp_path, BODY)
    assert text.startswith("scene.xml:3:") and message in text


def test_any_cut_or_changed_byte_is_answered(tmp_path: Path) -> None:
    """A file is read, or refused with a TensorError."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        data = bytearray(WHOLE[: rng.integers(len(WHOLE))] if rng.random() < 0.5 else WHOLE)
        for at in rng.integers(min(len(data), 400) or 1, size=3):
            data[at : at + 1] = bytes([rng.integers(256)])
        (tmp_path / "a.bsdf").write_bytes(data)
        try:
            _core.Measurement(**measurement(read_tensors(tmp_path / "a.bsdf")))
        except (TensorError, ValueError) as problem:
            assert str(problem)


def test_the_file_is_asked_for(tmp_path: Path) -> None:
    text = error_of(tmp_path, BODY.replace("filename", "file"))
    assert "measured" in text and '"filename"' in text


@pytest.mark.parametrize("name", ["ndf", "sigma", "vndf", "luminance", "rgb"])
@pytest.mark.parametrize("value", [0, -1, 1e30])
def test_odd_tables_stay_finite(name: str, value: float) -> None:
    tensors = changed(**{name: np.full_like(synthetic()[name], value)})
    bsdf = make_bsdf({"type": "measured", "measurement": _core.Measurement(**measurement(tensors))})
    u = np.random.default_rng(1).random((500, 3))
    for cosine in (1, 0.5, 1e-4):
        draws = bsdf.sample(direction(cosine, 1), u)
        assert np.isfinite(draws.weight[draws.valid]).all() and np.isfinite(draws.pdf[draws.valid]).all()
    assert np.isfinite(values_of(tensors, around())).all()
