"""Turns notebooks, with the outputs that they are stored with, into pages."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PICTURES = {"image/png": ".png", "image/jpeg": ".jpg"}


def write_page(path: Path) -> None:
    """Writes the page NAME.md of a notebook NAME.ipynb, and its pictures, beside it."""
    cells = json.loads(path.read_text())["cells"]
    parts = ["---\norphan: true\n---\n"]
    for number, cell in enumerate(cells):
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
        elif cell["cell_type"] == "code":
            parts.append(_fenced(text, "python"))
            parts += _shown(cell["outputs"], path.with_name(f"{path.stem}-{number}"))
        if len(parts) == 2:
            parts.append(f"This page shows the notebook {{download}}`{path.name}`.")
    path.with_suffix(".md").write_text("\n\n".join(parts) + "\n")


def _shown(outputs: list[dict[str, Any]], stem: Path) -> Iterator[str]:
    for number, output in enumerate(outputs):
        if output["output_type"] == "stream":
            yield _fenced("".join(output["text"]), "text")
            continue
        data = output["data"]
        kind = next((kind for kind in PICTURES if kind in data), None)
        if kind is None:
            yield _fenced("".join(data["text/plain"]), "text")
            continue
        picture = stem.with_name(f"{stem.name}-{number}{PICTURES[kind]}")
        picture.write_bytes(base64.b64decode("".join(data[kind])))
        yield f"![output]({picture.name})"


def _fenced(text: str, language: str) -> str:
    return f"````{language}\n{text.rstrip()}\n````"
