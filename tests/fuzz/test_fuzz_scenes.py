"""Scenes that are mostly right, as files and as dicts: a picture, or one message with its place."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answers import outcome, search
from file_formats import edited, formats, mistakes
from scene_author import scene_dicts, scene_texts

import lajolla

CORPUS = Path(__file__).parent / "corpus"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file of every format."""
    made = tmp_path_factory.mktemp("scenes")
    for form in formats(made).values():
        (made / f"a{form.ending}").write_bytes(form.samples[0])
    (made / "part.xml").write_text('<scene version="3.0.0"><shape type="cube"/></scene>')
    return made


def answer(folder: Path, text: bytes) -> str:
    path = folder / "scene.xml"
    path.unlink(missing_ok=True)
    path.write_bytes(text)
    return outcome(partial(lajolla.load, path))


def test_scene_files(folder: Path, fuzz_minutes: float | None) -> None:
    told: list[str] = []
    search(lambda text: told.append(answer(folder, text.encode())), 200, fuzz_minutes, text=scene_texts())
    assert 0.1 < told.count("picture") / len(told) < 0.9


def test_scene_files_of_any_bytes(folder: Path, fuzz_minutes: float | None) -> None:
    def check(text: str, edits: list[tuple[str, int, int, bytes]]) -> None:
        answer(folder, edited(text.encode(), edits))

    search(check, 150, fuzz_minutes, text=scene_texts(), edits=mistakes())


def test_scene_dicts(folder: Path, fuzz_minutes: float | None) -> None:
    told: list[str] = []

    def check(scene: dict[str, Any]) -> None:
        told.append(outcome(partial(lajolla.load_dict, scene, base_path=folder)))

    search(check, 200, fuzz_minutes, scene=scene_dicts())
    assert 0.1 < told.count("picture") / len(told) < 0.9


@pytest.mark.parametrize("path", sorted(CORPUS.glob("xml/*")), ids=lambda path: path.name)
def test_files_of_the_past(path: Path, folder: Path) -> None:
    answer(folder, path.read_bytes())


@pytest.mark.parametrize("path", sorted(CORPUS.glob("dict/*")), ids=lambda path: path.name)
def test_dicts_of_the_past(path: Path, folder: Path) -> None:
    """Kept as JSON, in which lists of lists are arrays."""

    def arrays(entry: dict[str, Any]) -> dict[str, Any]:
        return {
            key: np.array(value)
            if isinstance(value, list) and value and isinstance(value[0], list)
            else value
            for key, value in entry.items()
        }

    outcome(partial(lajolla.load_dict, json.loads(path.read_text(), object_hook=arrays), base_path=folder))
