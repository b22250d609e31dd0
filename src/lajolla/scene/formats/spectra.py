"""Spectra in text files."""

from __future__ import annotations

from pathlib import Path

from ..syntax.errors import Location, SceneError
from ..syntax.files import file_bytes
from ..syntax.literals import Text, checked_spectrum, parse_floats
from ..syntax.nodes import Spectrum


def read_spd(path: Path, location: Location) -> Spectrum:
    """Reads an `.spd` file: a wavelength in nm and a value per line, `#` starts a comment.

    Raises:
        SceneError: the file cannot be read as that.
    """
    try:
        text = file_bytes(path).decode()
    except (OSError, UnicodeError):
        raise SceneError(f'"{path}" cannot be read as a text file', location) from None
    pairs = []
    for number, line in enumerate(text.splitlines(), start=1):
        if content := line.partition("#")[0].strip():
            try:
                pairs.append(parse_floats(Text(content, location), (2,)))
            except SceneError:  # which quotes the file
                raise SceneError(f'"{path}", line {number}: expected 2 numbers', location) from None
    return checked_spectrum(tuple(p[0] for p in pairs), tuple(p[1] for p in pairs), location)
