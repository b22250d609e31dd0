"""Finding the files of a scene."""

from __future__ import annotations

import errno
import itertools
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from lajolla.messages import shortened

from .errors import Location, SceneError

MAX_BYTES = 1 << 34  # of a file that is read as a whole


def file_bytes(path: Path) -> bytes:
    """All bytes of a regular file; devices and pipes, which may be endless, are rejected.

    Raises:
        OSError: it cannot be read; it is no file, or too large.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a file")
    if status.st_size > MAX_BYTES:
        raise OSError(errno.EFBIG, f"larger than {MAX_BYTES:,} bytes")
    with path.open("rb") as file:
        data = file.read(max(status.st_size, 4096))
        if len(data) > status.st_size or file.read(1):  # it grows, or is made up by the system
            raise OSError(errno.EINVAL, "changed while it was read")
    return data


class MissingFile(SceneError, FileNotFoundError):
    """A scene's file, or one that it names, does not exist."""


def identity(path: Path) -> tuple[int, int, int, int]:
    """An identifier of a file's content that does not depend on its path: it changes if the file does."""
    status = path.stat()
    return status.st_dev, status.st_ino, status.st_mtime_ns, status.st_size


def find_file(name: str, directories: Iterable[Path], location: Location) -> Path:
    """Finds a file by its name in a scene: relative to one of the folders, with either slash, in any case.

    The working folder is the last of them.

    Raises:
        MissingFile: nothing is there; the message lists the folders that were searched.
    """
    wanted = name.replace("\\", "/")
    directories = list(directories)
    if directories and wanted.strip() and os.path.exists(usual := os.path.join(directories[0], wanted)):
        location.source.named.add(Path(usual))
        return Path(usual)
    searched = list(dict.fromkeys([*directories, Path()]))
    if not wanted.strip() or "\0" in wanted:
        raise SceneError("a file name is expected", location)
    for directory, spelling in itertools.product(searched, _spellings(wanted)):
        found = in_any_case(directory / spelling)
        if found is not None:
            location.source.named.add(found)
            return found
    location.source.named.add(searched[0] / wanted)
    where = "" if wanted.startswith("/") else f"; searched: {', '.join(map(str, searched))}"
    raise MissingFile(f'file "{shortened(name)}" not found{where}', location)


def _spellings(name: str) -> list[str]:
    """A name as the file system may have it: old files can have names in latin-1."""
    try:
        return [name] if name.isascii() else [name, os.fsdecode(name.encode("latin-1"))]
    except UnicodeEncodeError:
        return [name]


def in_any_case(path: Path) -> Path | None:
    """The path itself if it exists, else what differs from it in case only."""
    try:
        if os.path.exists(path):
            return path
        folder = path.parent if path.parent.is_dir() else in_any_case(path.parent)
        if path.parent == path or folder is None or not folder.is_dir():
            return None
        wanted = path.name.lower()
        return next((entry for entry in sorted(folder.iterdir()) if entry.name.lower() == wanted), None)
    except OSError:  # a name too long, a folder that may not be listed
        return None
