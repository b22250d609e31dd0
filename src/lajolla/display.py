"""What the command line shows of a running render, on standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from lajolla.render import Progress

Observer: TypeAlias = "Callable[[Progress], None]"


def say(message: str) -> None:
    """A line of the program's own, on standard error."""
    print(f"lajolla: {message}", file=sys.stderr, flush=True)


def rate(per_second: float, unit: str) -> str:
    """'3.21 Msamples/s', and the like."""
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
    """'12.3 MiB', and the like."""
    for unit in ("bytes", "KiB", "MiB"):
        if count < 1024:
            return f"{count:.4g} {unit}"
        count /= 1024
    return f"{count:.4g} GiB"


def description(progress: Progress, pixels: int) -> str:
    """Rate and time left."""
    speed = rate(progress.samples * pixels / max(progress.seconds, 1e-9), "samples")
    return f"{progress.samples:.0f}/{progress.spp} spp, {speed}, {duration(progress.seconds_left)} left"


@contextmanager
def progress_display(*, pixels: int, quiet: bool) -> Iterator[Observer]:
    """An observer of a Rendering: a bar on a terminal, a line for about every 10 % elsewhere."""
    if quiet:
        yield lambda progress: None
    elif not sys.stderr.isatty():
        yield line_observer(pixels)
    else:
        from rich.console import Console  # not loaded where no terminal shows it
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as Bar

        columns = (BarColumn(), TextColumn("{task.percentage:3.0f} %"), TextColumn("{task.description}"))
        with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("", total=1.0)
            yield lambda progress: bar.update(
                task, completed=progress.fraction, description=description(progress, pixels)
            )


def line_observer(pixels: int) -> Observer:
    """Prints a line whenever another tenth is done; the end is for the caller to report."""
    tenth = 0

    def observe(progress: Progress) -> None:
        nonlocal tenth
        if tenth < int(10 * progress.fraction) < 10:
            tenth = int(10 * progress.fraction)
            say(f"{10 * tenth} % ({description(progress, pixels)})")

    return observe
