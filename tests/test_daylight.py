"""Sun and sky: places of the sun, the two models' tables, and what files of either age mean by them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_tools import error_of, messages, read, write_scene
from scene_tools import rotation

from lajolla import _core
from lajolla.cli import main
from lajolla.scene import load_description
from lajolla.scene.data import cie, sky
from lajolla.scene.data.sky import Moment, hosek_sun, preetham_sun, sky_map, sun_angles

ALBEDO = np.full(3, 0.3)
LUMINANCE = np.array([0.212671, 0.715160, 0.072169])
SRGB_TO_XYZ = [[0.412453, 0.357580, 0.180423], LUMINANCE, [0.019334, 0.119193, 0.950227]]


@pytest.mark.parametrize(
    "moment, zenith, azimuth",
    [
        # Equinox noon at the equator and at 40 degrees north; solstices at noon; all by geometry.
        (Moment(2010, 3, 20, 12, 7, 0, 0, 0, 0), 0, None),
        (Moment(2010, 9, 23, 11, 52, 0, 40, 0, 0), 40, 180),
        (Moment(2010, 6, 21, 12, 2, 0, 23.44, 0, 0), 0, None),
        (Moment(2010, 12, 21, 11, 58, 0, -60, 0, 0), 36.56, 0),
        (Moment(2010, 3, 20, 18, 7, 0, 0, 0, 0), 90, 270),
        (Moment(2010, 3, 20, 9, 7, 0, 0, 0, 3), 90, 90),
    ],
)
def test_the_sun_is_where_geometry_puts_it(moment: Moment, zenith: float, azimuth: float | None) -> None:
    found = np.degrees(sun_angles(moment))
    assert abs(found[0] - zenith) < 0.5
    assert azimuth is None or abs((found[1] - azimuth + 180) % 360 - 180) < 1


def test_both_suns_redden_towards_the_horizon_and_agree_roughly() -> None:
    for model in (hosek_sun, preetham_sun):
        high, low = model(np.radians(60), 3.0), model(np.radians(5), 3.0)
        assert np.all(low < high) and low[2] / low[0] < 0.5 * high[2] / high[0]
    ratio = preetham_sun(np.radians(50), 3.0) / hosek_sun(np.radians(50), 3.0)
    assert np.all((ratio > 0.75) & (ratio < 1.35))


@pytest.mark.parametrize("elevation", [5, 30, 90])
@pytest.mark.parametrize("turbidity", [2, 8])
def test_the_sun_of_old_files_is_that_of_preetham(elevation: float, turbidity: float) -> None:
    """The formulas of the paper's appendix, which Mitsuba 0.6 takes every 5 nm, summed every quarter nm."""

    def absorption(table: list[tuple[float, float]]) -> np.ndarray:
        return np.interp(every, *np.array(table).T, left=0, right=0)

    every = np.arange(350.0, 801, 5)
    mass = 1 / (np.sin(np.radians(elevation)) + 0.15 * (93.885 - (90 - elevation)) ** -1.253)
    gas, water = absorption(sky.MIXED_GASES) * mass, 2 * absorption(sky.WATER_VAPOUR) * mass
    rayleigh = np.exp(-0.008735 * (every / 1000) ** -4.08 * mass)
    dust = np.exp(-(0.04608 * turbidity - 0.04586) * (every / 1000) ** -1.3 * mass)
    rest = 0.35 * absorption(sky.OZONE) * mass + 1.41 * gas / (1 + 118.93 * gas) ** 0.45
    rest += 0.2385 * water / (1 + 20.07 * water) ** 0.45
    outside = np.interp(every, np.arange(380, 751, 10), sky.SOLAR_RADIANCE, left=0, right=0)
    fine = np.arange(360, 830.1, 0.25)
    spectrum = np.interp(fine, every, outside * rayleigh * dust * np.exp(-rest), left=0, right=0)
    observer = np.stack([np.interp(fine, cie.WAVELENGTHS, column) for column in cie.OBSERVER_1931.T])
    xyz = (observer * spectrum).sum(1) / observer[1].sum()
    rgb = np.maximum(np.linalg.solve(SRGB_TO_XYZ, xyz), 0)
    np.testing.assert_allclose(preetham_sun(np.radians(elevation), turbidity), rgb, rtol=2e-3)


@pytest.mark.parametrize("elevation", [0, 1e-4, 0.3, np.pi / 2])
@pytest.mark.parametrize("turbidity", [1, 1.5, 9.99, 10])
def test_corners_are_finite(elevation: float, turbidity: float) -> None:
    sun = np.array([np.cos(elevation), np.sin(elevation), 0])
    for values in (
        sky_map(sun, turbidity, ALBEDO, 16)[0],
        sky_map(sun, turbidity, np.zeros(3), 16, stretch=2, extend=True)[0],
        hosek_sun(elevation, turbidity),
        preetham_sun(elevation, turbidity),
    ):
        assert np.all(np.isfinite(values)) and np.all(values >= 0)


def test_the_sky_ends_at_the_horizon_unless_it_is_extended() -> None:
    sun = np.array([0, 0.6, -0.8])
    (plain, end), (extended, nadir) = (sky_map(sun, 3, ALBEDO, 32, extend=e) for e in (False, True))
    assert plain.shape == (17, 32, 3) and (end, nadir) == (90, 180)
    assert plain.all() and extended[:16].all() and not extended[16].any()
    np.testing.assert_allclose(extended[:9], plain[::2], rtol=1e-5)  # the same down to the horizon
    row = plain[round(16 * np.arccos(0.6) / (np.pi / 2)), :, 1]
    assert np.argmax(row) in (0, 31) and row.max() > 2 * row.min()  # brightest around the sun, at -z


@pytest.mark.parametrize("stretch", [1, 1.5])
@pytest.mark.parametrize("tilted", [False, True])
def test_the_horizon_is_sharp(stretch: float, tilted: bool, tmp_path: Path) -> None:
    """Against Mitsuba's own sky: its radiance at elevations close to the horizon, and black below it."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    turn = rotation((1, 2, 3), 50) if tilted else np.eye(4)
    matrix = " ".join(map(str, turn.ravel()))
    local = np.array([-0.3, 0.5, 0.8]) / np.linalg.norm([-0.3, 0.5, 0.8])
    x, y, z = turn[:3, :3] @ local
    body = f"""<emitter type="sky"><float name="stretch" value="{stretch}"/>
        <transform name="to_world"><matrix value="{matrix}"/></transform>
        <vector name="sun_direction" x="{x}" y="{y}" z="{z}"/></emitter>"""
    scene = _core.Scene(read(tmp_path, body).core)
    degrees = np.array([-20, -5, -1, -0.1, -1e-3, 1e-3, 0.02, 0.1, 0.2, 0.5, 1, 3, 10, 45, 80])
    azimuth = np.radians(np.linspace(0, 350, len(degrees)))
    theirs = []
    their_sky = mi.load_dict(
        {"type": "sunsky", "sun_scale": 0.0, "sun_direction": [float(v) for v in local], "turbidity": 3.0}
    )
    for elevation, phi in zip(np.radians(degrees), azimuth, strict=True):
        interaction = mi.SurfaceInteraction3f()
        interaction.wi = -mi.Vector3f(*direction(elevation, phi))
        theirs.append(np.array(their_sky.eval(interaction)))
    zenith = np.pi / 2 - np.radians(degrees)
    seen = np.stack([direction(np.pi / 2 - stretch * t, phi) for t, phi in zip(zenith, azimuth, strict=True)])
    ours, _ = _core.eval_emitters(
        scene, np.zeros(3, np.float32), (seen @ turn[:3, :3].T).astype(np.float32), None
    )
    below, near = degrees < 0, (degrees > 0) & (degrees < 0.4)
    assert not ours[below].any()
    # A table has the rows that are closest to the horizon 0.35 degrees apart, where blue grows by a third.
    np.testing.assert_allclose(ours[near], np.array(theirs)[near], rtol=0.08)
    np.testing.assert_allclose(ours[~below & ~near], np.array(theirs)[~below & ~near], rtol=0.01)


def direction(elevation: float, azimuth: float) -> np.ndarray:
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def emitters(folder: Path, body: str, version: str) -> list[dict]:
    return read(folder, body, version).core["emitters"]


def test_old_files_have_y_up_and_new_ones_z(tmp_path: Path) -> None:
    body = '<emitter type="sunsky"/>'
    (_, old), (_, new) = (emitters(tmp_path, body, version) for version in ("0.6.0", "3.0.0"))
    zenith, azimuth = sun_angles(Moment())
    level = np.sin(zenith) * np.array([np.cos(azimuth), np.sin(azimuth)])
    np.testing.assert_allclose(old["direction"], [-level[1], -np.cos(zenith), level[0]], atol=1e-6)
    np.testing.assert_allclose(new["direction"], [level[0], level[1], -np.cos(zenith)], atol=1e-6)


@pytest.mark.parametrize("version, name", [("0.6.0", "sunDirection"), ("3.0.0", "sun_direction")])
def test_the_direction_is_that_in_the_scene(tmp_path: Path, version: str, name: str) -> None:
    body = f"""<emitter type="sunsky"><vector name="{name}" x="3" y="2" z="1"/>
        <transform name="{"toWorld" if version < "2" else "to_world"}"><rotate x="1" angle="20"/>
        </transform></emitter>"""
    envmap, disk = emitters(tmp_path, body, version)
    expected = np.array([3, 2, 1]) / np.sqrt(14)
    np.testing.assert_allclose(disk["direction"], -expected, atol=1e-6)
    assert envmap["type"] == "envmap" and disk["type"] == "distantdisk"


def test_a_larger_sun_shines_as_much(tmp_path: Path) -> None:
    body = '<emitter type="sun"><float name="sunRadiusScale" value="{}"/></emitter>'
    point, true, large = (emitters(tmp_path, body.format(s), "0.6.0")[0] for s in (0, 1, 15))
    assert point["type"] == "directional" and large["angle"] == pytest.approx(15 * true["angle"])
    for light in (true, large):
        np.testing.assert_allclose(light["irradiance"], point["irradiance"], rtol=2e-3)


def test_a_sun_below_the_horizon_is_told(tmp_path: Path) -> None:
    body = '<emitter type="sunsky"><float name="hour" value="2"/></emitter>'
    description = read(tmp_path, body)
    assert not description.core["emitters"]
    assert any("below the horizon" in line for line in messages(description, tmp_path))


def test_a_sun_without_direction_is_refused(tmp_path: Path) -> None:
    body = '<emitter type="sky"><vector name="sun_direction" x="0" y="0" z="0"/></emitter>'
    assert "no direction to the sun" in error_of(tmp_path, body)


def test_old_files_without_a_light_get_sun_and_sky(tmp_path: Path) -> None:
    kinds = [light["type"] for light in emitters(tmp_path, '<shape type="sphere"/>', "0.5.0")]
    assert kinds == ["envmap", "distantdisk"]
    assert not emitters(tmp_path, '<shape type="sphere"/>', "3.0.0")


def test_beams_without_width_are_told(tmp_path: Path) -> None:
    description = read(tmp_path, '<emitter type="collimated"/>', "0.6.0")
    assert not description.core["emitters"]
    assert any("no path can hit" in line for line in messages(description, tmp_path))


@pytest.mark.parametrize("plugin", ["sky", "sun", "sunsky"])
def test_daylight_in_the_words_of_mitsuba_3(
    plugin: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Written for Mitsuba 3 and read again, it is the same light."""
    body = f"""<emitter type="{plugin}"><float name="sunRadiusScale" value="4"/><float name="hour" value="9"/>
        <transform name="toWorld"><rotate y="1" angle="-30"/><rotate x="1" angle="90"/></transform>
        </emitter>"""
    if plugin == "sky":
        body = body.replace('<float name="sunRadiusScale" value="4"/>', "")
    source, target = write_scene(tmp_path, body, "0.6.0", "old.xml"), tmp_path / "new.xml"
    assert main(["convert", str(source), str(target)]) == 0
    assert ("another model of the sun" in capsys.readouterr().err) == (plugin != "sky")
    old, new = (load_description(path).core["emitters"] for path in (source, target))
    assert [light["type"] for light in new] == [light["type"] for light in old]
    for a, b in zip(old, new, strict=True):
        if a["type"] == "envmap":
            up, sun_up = (light["to_world"][:3, 1] for light in (a, b))
            np.testing.assert_allclose(up, sun_up, atol=1e-6)
            continue
        np.testing.assert_allclose(a["direction"], b["direction"], atol=1e-5)
        assert b["angle"] == pytest.approx(a["angle"], rel=1e-4)
        assert np.dot(LUMINANCE, b["irradiance"]) == pytest.approx(
            np.dot(LUMINANCE, a["irradiance"]), rel=1e-3
        )
