"""Scenes of all kinds, converted, have the same mean in Mitsuba's picture as in ours.

`test_convert.py` opens all public scenes with Mitsuba, and `bench/compatibility.py` compares all of them.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from oracle import default_variant

import lajolla
from lajolla import cli

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"
WIDEST = 16  # pixels
BATCHES, SPP = 8, 64
ALLOWANCE = 0.02  # of the mean, beyond four standard errors

FRAGMENTS = ("include", "fragments", "hostile", "includes")
# These take long to load, or tell nothing that others do not. In the last two, what is bright is at the
# border, where Mitsuba's filters differ; and its spheres of radius 1e5 are less exact (see test_smallpt).
SLOW = re.compile(
    "spaceship|coffee|teapot|staircase2|ashtray|ajar|arealight|constant_path|envmap_path|pointlight|array|smoke"
    "|sigmat|area_light|inside_medium|simple|sponza|officebox|interior|volpath_test[56]$|smallpt"
)
# What is lost of these does not change the mean.
HARMLESS = re.compile(r'Mitsuba 3 does not support (sampler "|"gamma" of film|"terminator" of bsdf)')


def scene_files() -> list[Path]:
    folders = (SHARED / "cases", SHARED / "scenes", ROOT / "scenes")
    found = [path for folder in folders for path in sorted(folder.rglob("*.xml"))]
    own = [p for p in found if p.parent.name not in FRAGMENTS and "_rand_" not in p.name]
    return [p for p in own if not SLOW.search(f"{p.parent.name}/{p.stem}")]


def small(scene: lajolla.Scene) -> tuple[int, int]:
    scale = WIDEST / max(scene.width, scene.height)
    return max(1, round(scene.width * scale)), max(1, round(scene.height * scale))


def set_size(path: Path, width: int, height: int) -> None:
    """Gives the films of a converted scene this size and no window."""
    tree = ET.parse(path)
    for sensor in tree.getroot().iter("sensor"):
        film = sensor.find("film")
        film = ET.SubElement(sensor, "film", type="hdrfilm") if film is None else film
        for child in [c for c in film if (c.get("name") or "").startswith(("width", "height", "crop_"))]:
            film.remove(child)
        for name, value in (("width", width), ("height", height)):
            ET.SubElement(film, "integer", name=name, value=str(value))
    tree.write(path)


def means(pictures: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The mean of each channel and its standard error."""
    each = np.array([picture[..., :3].mean((0, 1)) for picture in pictures], np.float64)
    return each.mean(0), each.std(0, ddof=1) / np.sqrt(len(each))


@pytest.mark.parametrize("path", scene_files(), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_means_agree(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mi = pytest.importorskip("mitsuba")
    target = tmp_path / "new.xml"
    assert cli.main(["convert", str(path), str(target)]) == 0
    lost = [line for line in capsys.readouterr().err.splitlines() if "Mitsuba 3" in line]
    scene = lajolla.load(path, size=small(lajolla.load(path)))
    set_size(target, scene.width, scene.height)
    mi.set_variant(default_variant())
    mi.set_log_level(mi.LogLevel.Error)
    theirs = mi.load_file(str(target))
    if not all(HARMLESS.search(line) for line in lost):
        return
    pictures = [np.array(mi.render(theirs, spp=SPP, seed=seed)) for seed in range(BATCHES)]
    a, error_a = means([scene.render(spp=SPP, seed=seed).array for seed in range(BATCHES)])
    b, error_b = means(pictures)
    margin = 4 * np.hypot(error_a, error_b) + ALLOWANCE * np.abs(b) + 1e-6
    assert np.all(np.abs(a - b) <= margin), f"{a} instead of {b}, margin {margin}"
