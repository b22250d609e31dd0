"""What every input gets: a picture, or one error with its place, and that soon. And a search for inputs."""

from __future__ import annotations

import gc
import os
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np

import lajolla

SECONDS, MEMORY = 2.0, 200 << 20  # of the processor, as tests run beside it; and bytes
if "ASAN_OPTIONS" in os.environ:  # see tests/sanitize
    SECONDS, MEMORY = 60.0, 4 << 30


def outcome(load: Callable[..., lajolla.Scene]) -> str:
    """Opens a scene and renders four pixels of it: "picture", or the error's message.

    Args:
        load: `lajolla.load` or `lajolla.load_dict` with all but its options.

    Raises:
        AssertionError: it took too long or too much, a pixel is no number, or an error has no place.
    """
    with frugal(), warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy's
        warnings.simplefilter("ignore", lajolla.LajollaWarning)
        try:
            scene = load(size=(2, 2))
            picture = scene.render(spp=1, threads=1).array
        except lajolla.SceneError as problem:
            assert problem.message.strip()
            assert problem.location is not None, problem
            cause = problem.__cause__
            assert cause is None or isinstance(cause, ValueError | MemoryError), repr(cause)
            return str(problem)
        assert np.isfinite(picture).all()
        return "picture"


@contextmanager
def frugal() -> Iterator[None]:
    """Asserts that what is done within takes neither long nor much memory."""
    _forget_peak()
    before, start = _memory("VmRSS"), time.process_time()
    yield
    seconds = time.process_time() - start
    assert seconds < SECONDS, f"it took {seconds:.1f} s"
    used = _memory("VmHWM") - before
    assert used < MEMORY, f"it took {used >> 20} MiB"


def _forget_peak() -> None:
    """Linux then counts the most memory of a process from now on."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _memory(name: str) -> int:
    """Bytes of this process that Linux tells; elsewhere nothing is measured."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next(int(line.split()[1]) << 10 for line in lines if line.startswith(name))


def search(check: Callable[..., None], count: int, minutes: float | None, **inputs: Any) -> None:  # noqa: ANN401
    """Gives a check many inputs; the smallest that fails it is shown.

    Args:
        check: called with an input for each of `inputs`, by name.
        count: how many, always the same ones, where there are no minutes.
        minutes: for so long there are others, different ones in each run.
        inputs: a strategy for each.
    """
    end = time.monotonic() + 60 * (minutes or 0)
    while True:
        settings = hypothesis.settings(
            max_examples=count, derandomize=minutes is None, database=None, deadline=None,
            suppress_health_check=list(hypothesis.HealthCheck), print_blob=False,
        )  # fmt: skip
        given = hypothesis.given(**inputs)(lambda **values: check(**values))
        seeded = hypothesis.seed(int.from_bytes(os.urandom(4), "big"))(given) if minutes else given
        settings(seeded)()
        gc.collect()
        if time.monotonic() >= end:
            return
