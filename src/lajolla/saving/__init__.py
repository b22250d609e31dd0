"""Saves a scene that was changed: the text of its file with the new values.

Everything else stays as it was written: comments, includes, parameters and the names of other files. Where an
object's plugin does not have the values that were changed, as a metal that is given by its name, all of its
values are written. What was written is read again before the file gets its name, and must be the same scene.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lajolla.image import write_encoded
from lajolla.messages import LajollaWarning, warn
from lajolla.params import Params
from lajolla.saving.differences import comparison
from lajolla.saving.edits import SceneEdits
from lajolla.scene import Description, SceneError, load_description
from lajolla.whole_files import check_folder, replacing

OUTPUTS = ("other_integrators", "channels")  # of integrators that show several things; options may add some


def save(read: Description, now: Description, params: Params, target: Path) -> None:
    """Writes a scene.

    Args:
        read: the scene as it was read.
        now, params: as it is.
        target: the file to write; others are put into a folder beside it.

    Raises:
        SceneError: it was not read from a file, or a change cannot be written; the message has its path.
        ImageError: a file cannot be written.
    """
    place = read.places.get("scene")
    if place is None or not place.source.data:
        raise SceneError(
            "only scenes that were loaded from files can be saved, not those of dicts and pickles"
        )
    check_folder(target)
    edits, text, made = _agreed(read, now, params, target)
    try:
        with replacing(target) as temporary:
            temporary.write_bytes(text)
    except BaseException:
        _remove(made)
        raise
    for option in _options(edits):
        warn(LajollaWarning(f"{target}: {option} is no part of a scene file; give it again"))


def _agreed(
    read: Description, now: Description, params: Params, target: Path
) -> tuple[SceneEdits, bytes, list[Path]]:
    """The text of the scene, as it is read again, and the files beside it that were written."""
    whole: set[str] = set()
    made: list[Path] = []
    first: tuple[str, str] | None = None  # what differs before any object is written as a whole, and why
    try:
        while True:
            edits = SceneEdits(read, now, params, target.parent, target.stem, whole)
            text = edits.written()
            made += _write_files(target.parent, edits.values.files)
            wrong, reason = _differing(edits, text, target)
            if not wrong:
                unused = [path for path in made if _name(path, target) not in edits.values.files]
                _remove(unused)
                return edits, text, made
            first = first or (wrong[0], reason)
            new = {changed.found.name for changed in edits.changes()} - whole
            blamed = {name for name in new if any(path.startswith(f"{name}.") for path in wrong)} or new
            if not blamed:
                path, reason = first
                raise SceneError(f"{path} cannot be saved: {reason}", _place(edits, path))
            whole |= blamed
    except BaseException:
        _remove(made)
        raise


def _differing(edits: SceneEdits, text: bytes, target: Path) -> tuple[list[str], str]:
    """The paths of what differs in the scene that a text is, and why they cannot be saved."""
    stream = io.BytesIO(text)
    stream.name = str(target)
    options = {**edits.read.options, "parameters": {}, "sensor": None, "integrator": None}
    try:
        found = load_description(stream, known_files=edits.read.files, **options)
    except SceneError as problem:
        return [_path_of(problem, edits)], problem.message
    core = {**edits.now.core, **{name: edits.read.core.get(name) for name in OUTPUTS}}
    core["sampler"] = {**core["sampler"], "type": edits.read.core["sampler"]["type"]}
    wrong = list(comparison(core, found.core, edits.params.objects).paths())
    return wrong, "its plugin in the scene file does not take this value, or other objects share it"


def _path_of(problem: SceneError, edits: SceneEdits) -> str:
    changed = next(edits.changes(), None)
    return f"{changed.found.name}.{changed.names[0]}" if changed else "the scene"


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
    return found


def _name(path: Path, target: Path) -> str:
    return path.relative_to(target.parent).as_posix()


def _write_files(folder: Path, files: Mapping[str, bytes | np.ndarray[Any, Any]]) -> list[Path]:
    """Writes files that are not there yet: their names follow from what they hold."""
    made = []
    for name, content in files.items():
        path = folder / name
        if path.exists():
            continue
        path.parent.mkdir(exist_ok=True)
        with replacing(path) as temporary:
            if isinstance(content, bytes):
                temporary.write_bytes(content)
            else:
                _write_pixels(temporary, content)
        made.append(path)
    return made


def _write_pixels(path: Path, pixels: np.ndarray[Any, Any]) -> None:
    names = ("R", "G", "B") if pixels.shape[2] == 3 else ("Y",)
    half = pixels.dtype == np.float16
    stored = pixels.astype(np.float32) if half else pixels
    write_encoded(path, stored, names=names, formats=["half"] * len(names) if half else ())


def _remove(files: list[Path]) -> None:
    """Removes files, and their folder if it is empty then."""
    for path in files:
        path.unlink(missing_ok=True)
    for folder in {path.parent for path in files}:
        if folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
