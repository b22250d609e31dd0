"""Small scenes as text, for the tests of the scene reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lajolla import _core
from lajolla.scene import Description, SceneError, load_description
from lajolla.scene.description.entries import row_of

FRAME = '<scene version="{version}">\n<integrator type="path"/><sensor type="perspective"/>\n{body}\n</scene>'


def write_scene(folder: Path, body: str, version: str = "3.0.0", name: str = "scene.xml") -> Path:
    """A scene file with an integrator and a sensor; `body` begins on line 3."""
    path = folder / name
    path.write_text(FRAME.format(version=version, body=body), encoding="utf-8")
    return path


def read(folder: Path, body: str, version: str = "3.0.0", **options: Any) -> Description:  # noqa: ANN401
    """The description of a small scene."""
    return load_description(write_scene(folder, body, version), **options)


def messages(description: Description, folder: Path) -> list[str]:
    """First lines of the warnings, without the folder; those about what these scenes lack are left out."""
    lines = [str(w).splitlines()[0].replace(f"{folder}/", "") for w in description.warnings]
    lacking = ("has no light", "does not see the media")
    return [line for line in lines if not any(text in line for text in lacking)]


def error(path: Path, **options: Any) -> str:  # noqa: ANN401
    """The message with which a scene file is refused, without the folder's name."""
    with pytest.raises(SceneError) as caught:
        load_description(path, **options)
    return str(caught.value).replace(f"{path.parent}/", "")


def error_of(folder: Path, body: str, version: str = "3.0.0", **options: Any) -> str:  # noqa: ANN401
    """The message with which a small scene is refused."""
    return error(write_scene(folder, body, version), **options)


def entries(stored: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A list of a description without columns."""
    columns = [[v for v in entry.values() if isinstance(v, _core.Column)] for entry in stored]
    return [
        row_of(entry, i)
        for entry, held in zip(stored, columns, strict=True)
        for i in range(len(held[0]) if held else 1)
    ]
