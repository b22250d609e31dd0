"""Every public scene opens and renders numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import lajolla
from lajolla.survey import survey

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "scenes"
SPP = 16
WIDEST = 24  # pixels

# All light of these comes through glass: only hits on the lamps find it, and few samples have none.
CAUSTICS_ALONE = ("dppm/box", "improved-pg/cbox_with_bulb/scene.xml")


def scene_files() -> list[Path]:
    """All scene files that stand for themselves: what others include lies in folders of these names."""
    return [
        path for path in sorted(FOLDER.rglob("*.xml")) if path.parent.name not in ("include", "fragments")
    ]


def small(scene: lajolla.Scene) -> tuple[int, int]:
    """A size of the same aspect, at most WIDEST pixels wide and high."""
    scale = WIDEST / max(scene.width, scene.height)
    return max(1, math.floor(scene.width * scale)), max(1, math.floor(scene.height * scale))


@pytest.mark.parametrize("path", scene_files(), ids=lambda path: str(path.relative_to(FOLDER)))
def test_scene_renders(path: Path) -> None:
    scene = lajolla.load(path, size=small(lajolla.load(path)))
    rendering = scene.rendering(spp=SPP)
    rendering.run()
    picture = rendering.image().array
    assert rendering.accumulator.nonfinite == 0
    assert np.isfinite(picture).all()
    if not str(path.relative_to(FOLDER)).startswith(CAUSTICS_ALONE):
        assert picture.max() > 0, "the picture is black"


def test_survey_opens_them_all(shared_scenes: Path) -> None:
    findings = survey(shared_scenes, lajolla.load)
    assert {finding.path for finding in findings} >= set(scene_files())
    assert [finding for finding in findings if finding.error] == []
