"""Several renders of one command: of all sensors, of frames, or the jobs of a file."""

import argparse
import itertools
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lajolla.arguments import STREAMS, Parser, UsageError, build_parser
from lajolla.messages import suggestion

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
PLACEHOLDER = re.compile(r"\{\{|\}\}|\{(\w+)(?::(0?\d+))?\}")
PATHS = ("scene", "output", "stats", "checkpoint", "resume")  # options of files, relative to the job file
OWN_KEYS = ("scene", "parameters", "job")
NOT_IN_JOBS = ("keep-going", "pixel", "sample")  # options of a whole batch, or that write no picture
MOST_RENDERS = 1_000_000


@dataclass(frozen=True)
class Render:
    """One render of several."""

    name: str  # for messages: "frame 7"
    arguments: argparse.Namespace


# --- sensors and frames -------------------------------------------------------------------------------------


def for_each_sensor(arguments: argparse.Namespace, names: Sequence[str]) -> list[Render]:
    """A render of each sensor, with other output files: "a.exr" becomes "a-NAME.exr"."""
    if not names:  # it has one that its file does not name
        return [_of_sensor(arguments, "the sensor", None, "")]
    _refuse_devices(arguments, "--all-sensors", len(names))
    written = [re.sub(r"[^\w.-]+", "_", name) for name in names]
    if len(set(written)) < len(written):
        written = [f"{number}-{name}" for number, name in enumerate(written)]
    return [
        _of_sensor(arguments, f"sensor {name}", number, f"-{written[number]}")
        for number, name in enumerate(names)
    ]


def _of_sensor(arguments: argparse.Namespace, name: str, number: int | None, suffix: str) -> Render:
    result = _with_files(arguments, lambda path: _with_suffix(path, suffix), suffix)
    result.all_sensors, result.sensor = False, number
    result.keep_partial = arguments.keep_partial and not arguments.skip_existing
    return Render(name, result)


def for_each_frame(arguments: argparse.Namespace) -> list[Render]:
    """A render of each frame.

    Parameters may contain {frame}, or be a range FROM..TO, whose ends belong to the first and last frame. In
    names of files, {frame:04} becomes the number with at least four digits; others get it as a suffix.

    Raises:
        UsageError: another {name}, or several pictures for standard output.
    """
    frames = arguments.frames
    _refuse_devices(arguments, "--frames", len(frames))
    digits = max(4, *(len(str(abs(frame))) for frame in frames))
    result = []
    for index, frame in enumerate(frames):
        values = {"frame": frame}
        suffix = f"-{frame:0{digits}d}"

        def renamed(path: Path, values: Mapping[str, int] = values, suffix: str = suffix) -> Path:
            text = filled(str(path), values)
            return Path(text) if text != str(path) else _with_suffix(path, suffix)

        each = _with_files(arguments, renamed, arguments.suffix + suffix)
        position = index / max(len(frames) - 1, 1)
        each.parameters = [(name, _at(text, values, position)) for name, text in arguments.parameters]
        each.frames, each.keep_partial = None, False
        result.append(Render(f"frame {frame}", each))
    return result


def _at(text: str, values: Mapping[str, int], position: float) -> str:
    """A parameter's value at a position from 0 to 1 of a series."""
    found = re.fullmatch(rf"({NUMBER})\.\.({NUMBER})", text.strip())
    if found is None:
        return filled(text, values)
    first, last = float(found[1]), float(found[2])
    return f"{first + (last - first) * position:.9g}"


def filled(text: str, values: Mapping[str, object], later: Sequence[str] = ()) -> str:
    """A text with values in place of {name}, and of {name:04}, which fills whole numbers up with zeros.

    {{ and }} are braces. If some names are to be filled in later, they and such braces are left as they are.
    Raises UsageError for other names.
    """

    def value(found: re.Match[str]) -> str:
        name, width = found.groups()
        if name in later or (later and name is None):
            return found[0]
        if name is None:
            return found[0][0]
        if name not in values:
            raise UsageError(f"{text}: there is no {{{name}}}{suggestion(name, [*values, *later])}")
        if width is None:
            return str(values[name])
        if not isinstance(values[name], int):
            raise UsageError(f"{text}: {{{name}}} is {values[name]}, no whole number to fill up with zeros")
        return f"{values[name]:{width}d}"

    return PLACEHOLDER.sub(value, text)


def _with_files(
    arguments: argparse.Namespace, renamed: Callable[[Path], Path], suffix: str
) -> argparse.Namespace:
    """A copy of a command that writes other files."""
    result = argparse.Namespace(**vars(arguments))
    result.suffix = suffix
    result.outputs = [path if _is_stream(path) else renamed(path) for path in arguments.outputs or []]
    for name in ("stats", "checkpoint", "resume"):
        path = getattr(arguments, name)
        setattr(result, name, renamed(path) if path and not _is_stream(path) else path)
    return result


def all_frames(renders: Iterable[Render]) -> list[Render]:
    """The same renders, with one for each frame in place of those of several."""
    result = []
    for render in renders:
        if render.arguments.frames is None:
            result.append(render)
        else:
            frames = for_each_frame(render.arguments)
            result += [Render(f"{render.name}, {each.name}", each.arguments) for each in frames]
    return result


def check_distinct(renders: Iterable[Render]) -> None:
    """Raises UsageError if two renders of a series write the same file."""
    writers: dict[str, str] = {}
    for render in renders:
        arguments = render.arguments
        for path in filter(None, [*(arguments.outputs or []), arguments.stats, arguments.checkpoint]):
            if _is_stream(path):
                continue
            first = writers.setdefault(os.path.realpath(path), render.name)
            if first != render.name:
                raise UsageError(f"{path} is written by {first} and {render.name}")


def _refuse_devices(arguments: argparse.Namespace, option: str, count: int) -> None:
    """Checks that standard output gets at most one picture, and a pipe at most one file."""
    found = [path for path in arguments.outputs or [] if _is_stream(path)]
    stats = arguments.stats
    if stats is not None and str(stats) not in STREAMS and stats.is_fifo():
        found.append(stats)
    if found and count > 1:
        what = "standard output" if str(found[0]) == "-" else str(found[0])
        raise UsageError(f"{what} takes one file; {option} writes {count}")


def _with_suffix(path: Path, suffix: str) -> Path:
    return path.with_name(path.stem + suffix + path.suffix)


def _is_stream(path: Path) -> bool:
    from lajolla.whole_files import is_device  # here, as no --help needs it

    return str(path) in STREAMS or is_device(path)


# --- files of jobs ------------------------------------------------------------------------------------------


def jobs_of(path: Path) -> list[tuple[str, list[str]]]:
    """The command lines `lajolla render ...` of a TOML file, without these two words, and their names for
    messages, such as "job 2, metal=Cu".

    Raises:
        UsageError: the file is no list of jobs; the message names the job and the option.
    """
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as problem:
        raise UsageError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise UsageError(f"{path}: {problem}") from None
    jobs = table.pop("job", [{}])
    if not isinstance(jobs, list) or not jobs or not all(isinstance(job, dict) for job in jobs):
        raise UsageError(f"{path}: jobs are tables that begin with [[job]]")
    result: list[tuple[str, list[str]]] = []
    for number, job in enumerate(jobs, 1):
        where = f"{path}: job {number}" if len(jobs) > 1 else str(path)
        parameters = {**_parameters(where, table), **_parameters(where, job)}
        options = {**table, **job, "parameters": parameters}
        result += [
            (", ".join([f"job {number}", *chosen]), words)
            for chosen, words in _command_lines(where, path.parent, options)
        ]
    return result


def _parameters(where: str, table: Mapping[str, Any]) -> Mapping[str, Any]:
    parameters = table.get("parameters", {})
    if not isinstance(parameters, dict):
        raise UsageError(f"{where}: parameters are a table: [parameters], or parameters = {{name = value}}")
    return parameters


def _command_lines(
    where: str, folder: Path, options: dict[str, Any]
) -> Iterator[tuple[list[str], list[str]]]:
    """The command lines of a job, one for each combination of values of its parameters, and the values of
    those that have several."""
    parameters = options.pop("parameters")
    scene = options.pop("scene", None)
    if not isinstance(scene, str):
        raise UsageError(f'{where}: needs a scene: scene = "FILE"')
    choices = [value if isinstance(value, list) else [value] for value in parameters.values()]
    if not all(choices):
        empty = next(name for name, value in parameters.items() if value == [])
        raise UsageError(f'{where}: the parameter "{empty}" has no values')
    if (count := math.prod(map(len, choices))) > MOST_RENDERS:
        raise UsageError(f"{where}: {count} combinations of parameters are more than {MOST_RENDERS}")
    render = build_parser()[1]["render"]
    later = ("frame",) if "frames" in options else ()
    for chosen in itertools.product(*choices):
        values = dict(zip(parameters, chosen, strict=True))
        try:
            texts = {name: f"{name}={_text(name, value)}" for name, value in values.items()}
            words = [str(folder / scene), *(word for text in texts.values() for word in ("-D", text))]
            for name, value in options.items():
                words += _words(_action(render, name), folder, name, value, values, later)
            yield [text for name, text in texts.items() if isinstance(parameters[name], list)], words
        except UsageError as problem:
            raise UsageError(f"{where}: {problem}") from None
        if not options.get("output"):
            raise UsageError(f'{where}: needs a picture: output = "FILE"')


def _words(
    action: argparse.Action,
    folder: Path,
    name: str,
    value: object,
    values: Mapping[str, object],
    later: Sequence[str],
) -> Iterator[str]:
    """An option of `lajolla render` as words of a command line."""
    if action.nargs == 0 and not isinstance(value, bool):
        raise UsageError(f'"{name}" is true or false, not {value!r}')
    if action.nargs == 0:
        if value:
            yield f"--{name}"
        elif f"--no-{name}" in action.option_strings:
            yield f"--no-{name}"
        return
    if isinstance(value, list) and not isinstance(action, argparse._AppendAction):
        raise UsageError(f'"{name}" takes one value, not {value!r}')
    for each in value if isinstance(value, list) else [value]:
        text = _text(name, each)
        if name in PATHS and text not in STREAMS:
            literal = str(folder).replace("{", "{{").replace("}", "}}") if later else str(folder)
            text = str(Path(literal, filled(text, values, later)))
        yield f"--{name}={text}"


def _action(parser: Parser, name: str) -> argparse.Action:
    """The option of a name; raises UsageError."""
    actions = {option: action for action in parser._actions for option in action.option_strings}
    negations = {f"--no-{option[2:]}" for option in actions}  # false says the same
    names = [option[2:] for option in actions if option.startswith("--") and option not in negations]
    names = [known for known in names if known not in ("help", *NOT_IN_JOBS)]
    if name not in names:
        raise UsageError(f'there is no option "{name}"{suggestion(name, [*names, *OWN_KEYS])}')
    return actions[f"--{name}"]


def _text(name: str, value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str | int | float):
        return str(value)
    raise UsageError(f'"{name}" is a text or a number, not {value!r}')
