"""Loads scenes from files or dicts."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lajolla.limits import check_flag, check_mapping
from lajolla.loaded_scene import Scene
from lajolla.messages import suggestion, warn
from lajolla.options import Options
from lajolla.scene import SceneFile, UnknownParameter, describe, load_description


def load(
    path: SceneFile,
    *,
    strict: bool = False,
    two_sided: bool = False,
    parameters: Mapping[str, object] | None = None,
    reuse: Scene | None = None,
    **options: Any,  # noqa: ANN401
) -> Scene:
    """Opens a Mitsuba scene file.

    Differences between the file and what is rendered are reported as SceneWarnings, and are also in
    `Scene.warnings`.

    Args:
        path: the XML file, or a binary file object. Other files are searched in its folder, or in the
            current folder if the file object has no name.
        strict: makes unknown plugins and properties errors.
        two_sided: makes opaque surfaces reflect on both sides.
        parameters: values of the file's `$name` parameters.
        reuse: a scene, such as the last frame of an animation: files that it has read are read again only if
            they have changed, and what is equal in both scenes, such as acceleration structures, is shared.
        options: the fields of `Options` (spp, size, crop, seed, sampler, integrator, max_depth, strategy,
            footprint, sensor, hide_emitters, robust, aovs); other names are parameters that the file must
            have.

    Raises:
        SceneError: the scene has an error; the message contains the location.
        OptionError: an option does not fit the scene.
        TypeError: unknown option or parameter.
    """
    if reuse is not None and not isinstance(reuse, Scene):
        raise TypeError(f"reuse must be a Scene, not {reuse!r}")
    if parameters is not None:
        check_mapping("parameters", parameters)
    own, extra = _split_options(options)
    _check_flags(strict=strict, two_sided=two_sided)
    texts = {name: _as_text(value) for name, value in {**extra, **(parameters or {})}.items()}
    start = time.perf_counter()
    try:
        description = load_description(
            path,
            parameters=texts,
            required_names=extra,
            strict=strict,
            two_sided=two_sided,
            integrator=own.integrator,
            sensor=own.sensor,
            known_files=reuse.files if reuse is not None else {},
        )
    except UnknownParameter as problem:
        hint = suggestion(problem.name, [*LOAD_OPTIONS, "parameters", "reuse", *vars(own), *problem.known])
        what = f"load() has no option {problem.name!r}, nor has the scene such a parameter"
        raise TypeError(what + hint) from None
    return _warned(Scene(description, own, time.perf_counter() - start, reuse))


LOAD_OPTIONS = ("strict", "two_sided")


def load_dict(
    scene: Mapping[str, Any],
    *,
    base_path: str | os.PathLike[str] | None = None,
    strict: bool = False,
    two_sided: bool = False,
    **options: Any,  # noqa: ANN401
) -> Scene:
    """Opens a scene given as nested dicts, in the form of Mitsuba 3's `load_dict`; see `load`.

    Relative file names are relative to `base_path`, by default the current folder.
    """
    own, unknown = _split_options(options)
    _check_flags(strict=strict, two_sided=two_sided)
    for name in unknown:
        hint = suggestion(name, [*LOAD_OPTIONS, "base_path", *vars(own)])
        raise TypeError(f"load_dict() has no option {name!r}{hint}")
    start = time.perf_counter()
    folder = None if base_path is None else Path(base_path)
    description = describe(
        scene,
        base_path=folder,
        strict=strict,
        two_sided=two_sided,
        integrator=own.integrator,
        sensor=own.sensor,
    )
    return _warned(Scene(description, own, time.perf_counter() - start))


def _warned(scene: Scene) -> Scene:
    for warning in scene.warnings:
        warn(warning)
    return scene


def _check_flags(**flags: object) -> None:
    for name, value in flags.items():
        check_flag(name, value)


def _split_options(options: Mapping[str, Any]) -> tuple[Options, dict[str, Any]]:
    known = vars(Options())
    extra = {name: value for name, value in options.items() if name not in known}
    return Options(**{name: value for name, value in options.items() if name in known}), extra


def _as_text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
