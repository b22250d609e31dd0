"""Atomic file writes."""

import hashlib
import os
import platform
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeAlias

from lajolla.messages import shortened
from lajolla.picture_files import ImageError

Target: TypeAlias = Path | BinaryIO  # where a file is written: its path, or a stream


def check_folder(path: Path) -> None:
    """Raises ImageError if `path` can neither be created nor written to."""
    try:
        target = target_of(path)
        if is_device(path):
            if not os.access(path, os.W_OK):
                raise ImageError(f"{path}: is not writable")
            return
        if not target.parent.is_dir():
            raise ImageError(f"{path}: the folder {target.parent} does not exist")
        if target.is_dir():
            raise ImageError(f"{path}: is a folder")
    except OSError as error:  # the name is too long
        raise ImageError(f"{shortened(path)}: {error.strerror}") from error
    except ValueError as error:  # it has a character that no name has
        raise ImageError(f"{shortened(path)!a}: is no name of a file") from error
    if not os.access(target.parent, os.W_OK):
        raise ImageError(f"{path}: the folder {target.parent} is not writable")


def target_of(path: Path) -> Path:
    """The target of a link, which need not exist; the path itself if it is not a link."""
    target = Path(os.path.realpath(path))
    if target.is_symlink():
        raise ImageError(f"{path}: is a link that leads to itself")
    return target


def is_device(path: Path) -> bool:
    """Whether this is a pipe, terminal or similar, which is written to instead of replaced."""
    return path.exists() and not path.is_file() and not path.is_dir()


@contextmanager
def written_to(target: Target, ending: str) -> Iterator[Path]:
    """A temporary path with this ending; if the block succeeds, its file is moved to a path or a stream."""
    if isinstance(target, Path):
        with replacing(target, ending) as temporary:
            yield temporary
        return
    with tempfile.TemporaryDirectory() as folder:
        temporary = Path(folder, f"picture{ending}")
        yield temporary
        try:
            with temporary.open("rb") as file:
                shutil.copyfileobj(file, target)
            target.flush()
        except OSError as error:
            raise ImageError(f"{name_of(target)}: cannot be written: {error.strerror}") from error


def name_of(target: Target) -> str:
    """What messages call it."""
    if isinstance(target, Path):
        return str(target)
    if target is getattr(sys.stdout, "buffer", None):
        return "standard output"
    name = getattr(target, "name", None)
    return name if isinstance(name, str) else "the picture"  # files opened by their number are named by it


@contextmanager
def replacing(path: Path, ending: str | None = None) -> Iterator[Path]:
    """A temporary path that takes the place of `path` when the block succeeds.

    Where there is a pipe or a device, the bytes are written to it instead. A link stays a link.

    Args:
        path: the file to be.
        ending: of the temporary path, if not that of `path`.
    """
    try:
        target, device = target_of(path), is_device(path)
        folder = Path(tempfile.gettempdir()) if device else target.parent
        prefix = _temporary_prefix(target)
        _remove_abandoned(folder, prefix)
        temporary = folder / f"{prefix}{os.getpid()}-{secrets.token_hex(4)}{ending or path.suffix}"
        try:
            yield temporary
            if device:
                with open(temporary, "rb") as file, open(os.open(path, os.O_WRONLY), "wb") as stream:
                    shutil.copyfileobj(file, stream)
                return
            with open(temporary, "rb+") as file:
                os.fsync(file.fileno())
            os.replace(temporary, target)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or "only a part was written; the disk may be full"  # NumPy has no reason
        raise ImageError(f"{path}: cannot be written: {reason}") from error


def _temporary_prefix(target: Path) -> str:
    """How the names of temporary files for a target begin, where process ids mean what they mean here."""
    origin = os.fsencode(target) + b"\0" + _process_space().encode()
    return f".lajolla-{hashlib.blake2b(origin, digest_size=6).hexdigest()}-"


def _process_space() -> str:
    """What has process ids of its own: a machine since it was started, and in it a container."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text() + os.readlink("/proc/self/ns/pid")
    except OSError:  # not Linux
        return platform.node()


def _remove_abandoned(folder: Path, prefix: str) -> None:
    """Removes the temporary files of processes that were killed while they wrote, as far as it can."""
    for left in folder.glob(f"{prefix}*"):
        with suppress(OSError, OverflowError, ValueError):  # it is another user's, or no name of ours
            try:
                os.kill(int(left.name[len(prefix) :].partition("-")[0]), 0)
            except ProcessLookupError:
                left.unlink()
