"""The reading route in docs/book/weekend.md: adds the numbers of lines to its tables."""

from __future__ import annotations

import re
from pathlib import Path

NAME = "book/weekend.md"
ROW = re.compile(r"^\| \[(?P<name>[^\]]+)\]\(\.\./\.\./(?P=name)\) \|.*\|$", re.MULTILINE)


def files(text: str) -> list[str]:
    """The files of the route, relative to the checkout, in order."""
    return [row["name"] for row in ROW.finditer(text)]


def lines_of(path: Path) -> int:
    """How long a file is."""
    return len(path.read_text().splitlines())


def with_lines(text: str, root: Path) -> str:
    """The page with the lines of each file in a column of their own, and their sum."""
    total = sum(lines_of(root / name) for name in files(text))
    text = text.replace("fewer than 5000 lines", f"{total} lines")
    text = text.replace(
        "| File | What to look for |\n|---|---|", "| File | What to look for | Lines |\n|---|---|---|"
    )
    return ROW.sub(lambda row: f"{row[0]} {lines_of(root / row['name'])} |", text)
