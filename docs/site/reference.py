"""Generates the reference."""

from pathlib import Path


def write_reference(folder: Path) -> None:
    """Writes the pages of the reference."""
    folder.mkdir()
