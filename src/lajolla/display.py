"""Progress and messages of the command line on standard error."""

from __future__ import annotations

import fcntl
import io
import math
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, suppress
from typing import TYPE_CHECKING, TextIO, TypeAlias

if TYPE_CHECKING:
    from lajolla.render import Progress

Observer: TypeAlias = "Callable[[Progress], None]"


class Messages(io.TextIOBase):
    """A text stream that forwards to another one and ignores its write errors."""

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    @property
    def encoding(self) -> str:
        return self.stream.encoding

    def write(self, text: str) -> int:
        try:
            self.stream.write(text)
            self.stream.flush()
        except (OSError, ValueError):
            discard(self.stream)
        return len(text)

    def isatty(self) -> bool:
        return self.stream.isatty()

    def fileno(self) -> int:
        return self.stream.fileno()


def discard(stream: TextIO) -> None:
    """Discards the output of a stream, including its buffer."""
    with suppress(OSError, ValueError):  # it is no file
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def open_streams() -> None:
    """Replaces closed standard streams, because files would get their descriptors.

    Messages are then lost, but writing results is an error.
    """
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDONLY if name == "stdout" else os.O_RDWR)  # gets the lowest number
        if getattr(sys, name) is None:
            mode = "r" if name == "stdin" else "w"
            setattr(sys, name, open(descriptor, mode, closefd=False))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):  # names of files can be any bytes
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def is_closed(stream: TextIO) -> bool:
    """Whether a standard stream takes nothing, as `open_streams` leaves one that was closed."""
    try:
        mode = fcntl.fcntl(stream.fileno(), fcntl.F_GETFL) & os.O_ACCMODE
    except (OSError, ValueError):  # it is no file
        return False
    return mode == os.O_RDONLY


@contextmanager
def safe_messages() -> Iterator[None]:
    """A context in which failures to write messages are ignored."""
    with redirect_stderr(Messages(sys.stderr)):
        yield


def say(message: str) -> None:
    """Prints a line of the program on standard error."""
    print_message(f"lajolla: {message}")


def print_message(message: object) -> None:
    """A message on standard error, such as a SceneError with its place and the line under it."""
    print(coloured(str(message), sys.stderr), file=sys.stderr, flush=True)


# The severity is a word after the place or the program's name; the caret stands on the last line.
SEVERITY = re.compile(r"(?:^|(?<=: ))(error|warning): ")
CARET = re.compile(r"\^$")
COLOURS = {"error": "1;31", "warning": "1;33"}  # red and yellow, both bold


def coloured(message: str, stream: TextIO) -> str:
    """A message with its severity and its caret in colour, where the stream shows colours."""
    found = SEVERITY.search(message) if shows_colours(stream) else None
    if found is None:
        return message
    start, end = f"\x1b[{COLOURS[found[1]]}m", "\x1b[0m"
    message = message[: found.start(1)] + start + found[1] + end + message[found.end(1) :]
    return CARET.sub(f"{start}^{end}", message) if "\n" in message else message


def shows_colours(stream: TextIO) -> bool:
    """Whether a stream is a terminal with colours; environment variables override it, NO_COLOR first."""
    if os.environ.get("NO_COLOR"):
        return False
    return bool(os.environ.get("FORCE_COLOR")) or (stream.isatty() and os.environ.get("TERM") != "dumb")


def rate(per_second: float, unit: str) -> str:
    """For example '3.21 Msamples/s'."""
    for prefix, factor in (("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if per_second >= factor:
            return f"{per_second / factor:.3g} {prefix}{unit}/s"
    return f"{per_second:.3g} {unit}/s"


def duration(seconds: float) -> str:
    """'3 s', '2 min 05 s', '1 h 02 min'."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02} s"
    return f"{whole // 3600} h {whole // 60 % 60:02} min"


def size_in_memory(count: float) -> str:
    """For example '12.3 MiB'."""
    for unit in ("bytes", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.4g} {unit}"
        count /= 1024
    return f"{count:.4g} GiB"


def description(progress: Progress, pixels: int, label: str = "") -> str:
    """Rate and time left, after what is rendered."""
    speed = rate(progress.samples * pixels / max(progress.seconds, 1e-9), "samples")
    samples = f"{progress.samples:.0f}"
    if progress.rules.spp is not None:
        samples += f"/{progress.rules.spp}"
    noise = f"noise {progress.noise:.2g}, " if math.isfinite(progress.noise) else ""
    left = f", {duration(progress.seconds_left)} left" if math.isfinite(progress.seconds_left) else ""
    return f"{label}{samples} spp, {noise}{speed}{left}"


@contextmanager
def progress_display(*, pixels: int, quiet: bool, label: str = "") -> Iterator[Observer]:
    """An observer of a Rendering: a bar on a terminal, a line for about every 10 % elsewhere."""
    if quiet:
        yield lambda progress: None
    elif not sys.stderr.isatty():
        yield line_observer(pixels, label)
    else:
        from rich.console import Console  # not loaded where no terminal shows it
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as Bar

        columns = (BarColumn(), TextColumn("{task.percentage:3.0f} %"), TextColumn("{task.description}"))
        with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("", total=1.0)
            yield lambda progress: bar.update(
                task, completed=progress.fraction, description=description(progress, pixels, label)
            )


def line_observer(pixels: int, label: str = "") -> Observer:
    """Prints a line whenever another tenth is done; the end is for the caller to report."""
    tenth = 0

    def observe(progress: Progress) -> None:
        nonlocal tenth
        if tenth < int(10 * progress.fraction) < 10:
            tenth = int(10 * progress.fraction)
            say(f"{10 * tenth} % ({description(progress, pixels, label)})")

    return observe
