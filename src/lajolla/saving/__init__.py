"""Saves a scene that was changed: the text of its file with the new values.

Everything else stays as it was written: comments, includes, parameters and the names of other files. Where an
object's plugin does not have the values that were changed, as a metal that is given by its name, all of its
values are written. What was written is read again before the file gets its name, and must be the same scene.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from lajolla.image import write_encoded
from lajolla.messages import LajollaWarning, warn
from lajolla.params import Params
from lajolla.picture_files import ImageError
from lajolla.saving.differences import OUTPUTS, comparison
from lajolla.saving.edits import SceneEdits
from lajolla.saving.values import equal
from lajolla.scene import Description, SceneError, load_description
from lajolla.whole_files import check_folder, is_device, replacing, target_of


def save(read: Description, now: Description, params: Params, target: Path) -> None:
    """Writes a scene.

    Args:
        read: the scene as it was read.
        now, params: as it is.
        target: the file to write; others are put into a folder beside it.

    Raises:
        SceneError: it was not read from a file; a change cannot be written, and the message has its path;
            or the target is another file of the scene, or a device while there are others to be written.
        ImageError: a file cannot be written.
    """
    place = read.places.get("scene")
    if place is None or not place.source.data:
        raise SceneError(
            "only scenes that were loaded from files can be saved, not those of dicts and pickles"
        )
    check_folder(target)
    if not is_device(target):
        target = target_of(target)  # names are relative to the file that a link leads to
    own = Path(place.source.name).resolve()
    if target in {path.resolve() for path in read.paths} - {own}:
        raise SceneError(f'"{target}" is a file of this scene, and cannot be replaced by it')
    made: list[Path] = []
    try:
        edits, text = _agreed(read, now, params, target, made)
        with replacing(target) as temporary:
            temporary.write_bytes(text)
    except BaseException:
        _remove(made)
        raise
    for option in _options(edits):
        warn(LajollaWarning(f"{target}: {option} is no part of a scene file; give it again"))


def _agreed(
    read: Description, now: Description, params: Params, target: Path, made: list[Path]
) -> tuple[SceneEdits, bytes]:
    """The text of the scene, as it is read again; files beside it that were not there are added to `made`."""
    whole: set[str] = set()
    first: tuple[str, str] | None = None  # what differs before any object is written as a whole, and why
    while True:
        edits = SceneEdits(read, now, params, target.parent, target.stem, whole)
        text = edits.written()
        files = {target.parent / name: content for name, content in edits.values.files.items()}
        if files and is_device(target):
            raise SceneError(f'"{target}" is no ordinary file, and the scene needs others beside it')
        _write_files(files, made)
        wrong, reason = _differing(edits, text, target)
        if not wrong:
            _remove([path for path in made if path not in files])
            return edits, text
        first = first or (wrong[0], reason)
        new = {changed.found.name for changed in edits.changes()} - whole
        blamed = {name for name in new if any(path.startswith(f"{name}.") for path in wrong)} or new
        if not blamed:
            path, reason = first
            raise SceneError(f"{path} cannot be saved: {reason}", _place(edits, path))
        whole |= blamed


def _differing(edits: SceneEdits, text: bytes, target: Path) -> tuple[list[str], str]:
    """The paths of what differs in the scene that a text is, and why they cannot be saved."""
    stream = io.BytesIO(text)
    stream.name = str(target)
    options = {**edits.read.options, "parameters": {}, "sensor": None, "integrator": None}
    try:
        found = load_description(stream, known_files=edits.read.files, **options)
    except SceneError as problem:
        paths = [f"{changed.found.name}.{name}" for changed in edits.changes() for name in changed.names]
        return [paths[0] if len(paths) == 1 else "the scene"], problem.message
    core = {**edits.now.core, **{name: edits.read.core.get(name) for name in OUTPUTS}}
    core["sampler"] = {**core["sampler"], "type": edits.read.core["sampler"]["type"]}
    wrong = list(comparison(core, found.core, edits.params.objects).paths())
    return wrong, "its plugin in the scene file does not take this value, or other objects share it"


def _place(edits: SceneEdits, path: str) -> Any:  # noqa: ANN401
    for changed in edits.changes():
        if path.startswith(f"{changed.found.name}."):
            return next(iter(changed.places), None)
    return None


def _options(edits: SceneEdits) -> list[str]:
    """Options with which the scene was loaded that no file can hold."""
    found = ["two_sided"] if edits.read.options.get("two_sided") else []
    if edits.now.core["sampler"]["type"] != edits.read.core["sampler"]["type"]:
        found.append("sampler")
    if not equal(edits.now.core.get("channels", []), edits.read.core.get("channels", [])):
        found.append("aovs")
    return found


def _write_files(files: Mapping[Path, bytes | np.ndarray[Any, Any]], made: list[Path]) -> None:
    """Writes files whose names follow from what they hold; new ones, and their folder, are added to `made`.

    Those that are whole stay; pixels are written again, as files that hold the same ones may differ.
    """
    for path, content in files.items():
        try:
            if path.exists():
                if isinstance(content, bytes) and path.read_bytes() == content:
                    continue
            else:  # noted before they are there: what fails or is interrupted leaves nothing
                made += [path] if path.parent.exists() else [path.parent, path]
                path.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise ImageError(f"{path}: cannot be written: {error.strerror}") from error
        with replacing(path) as temporary:
            if isinstance(content, bytes):
                temporary.write_bytes(content)
            else:
                _write_pixels(temporary, content)


def _write_pixels(path: Path, pixels: np.ndarray[Any, Any]) -> None:
    names = ("R", "G", "B") if pixels.shape[2] == 3 else ("Y",)
    half = pixels.dtype == np.float16
    stored = pixels.astype(np.float32) if half else pixels
    write_encoded(path, stored, names=names, formats=["half"] * len(names) if half else ())


def _remove(made: list[Path]) -> None:
    """Removes files, and before them in the list their folder, unless it has others."""
    for path in reversed(made):
        with suppress(OSError):
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink(missing_ok=True)
