"""Progressive rendering in passes."""

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass

from lajolla import _core
from lajolla.aovs import VARIANCE
from lajolla.film import Film
from lajolla.image import Image
from lajolla.layers import variance_of_mean
from lajolla.limits import LIMITS
from lajolla.messages import names_checked
from lajolla.objects import ObjectLayers

PASS_SECONDS = 2.0  # passes grow until they take about this long; an interrupted one is lost
POLL_SECONDS = 0.1

DEFAULT_FILM = Film()


@dataclass(frozen=True)
class Progress:
    """Progress of a render."""

    samples: float  # per pixel; a fraction counts the running pass
    spp: int
    seconds: float  # of rendering so far

    @property
    def fraction(self) -> float:
        return self.samples / self.spp

    @property
    def seconds_left(self) -> float:
        return self.seconds * (self.spp - self.samples) / self.samples if self.samples else float("inf")


class Rendering:
    """A render in progress: passes of samples are added until the sample count is reached.

    An exception in `run`, such as KeyboardInterrupt, leaves the finished passes: `samples` of `spp`. The pass
    that it cuts off is `lost`, in samples per pixel; `run` can be called again.
    """

    def __init__(
        self,
        core: _core.Scene,
        *,
        spp: int,
        seed: int,
        threads: int,
        film: Film = DEFAULT_FILM,
        layers: ObjectLayers | None = None,
    ) -> None:
        self.film = film
        self.layers = layers
        self.channels = core.channels
        self.spp = spp
        self.lost = 0
        self.seconds = 0.0
        self.threads = threads
        self.accumulator = _core.Render(core, seed)

    @property
    def samples(self) -> int:
        return self.accumulator.samples

    def image(self) -> Image:
        """The mean of the samples of all finished passes."""
        values = self.accumulator.image()
        channels = {label: values[..., 3 + index] for index, label in enumerate(self.channels)}
        if self.layers is None:
            return Image(values[..., :3], channels, self.film)
        if VARIANCE in self.layers.aovs:
            for index, letter in enumerate("RGB"):
                mean, square = values[..., index], channels[f"{VARIANCE}.{letter}"]
                channels[f"{VARIANCE}.{letter}"] = variance_of_mean(mean, square, self.samples)
        return Image(values[..., :3], channels, self.film, self.layers.layers(self.samples))

    @names_checked
    def run(self, observe: Callable[[Progress], None] = lambda progress: None) -> None:
        """Renders the remaining samples; calls `observe` in this thread about ten times a second."""
        self.lost = 0
        with ThreadPoolExecutor(1) as worker:
            for count in self._passes():
                start, before = time.perf_counter(), self.samples
                task = worker.submit(self.accumulator.add, before, count, self.threads)
                try:
                    while not wait([task], timeout=POLL_SECONDS).done:
                        done = before + self.accumulator.progress * count
                        observe(Progress(done, self.spp, self.seconds + time.perf_counter() - start))
                except BaseException:
                    self.accumulator.cancel()
                    if task.result():  # it had ended already, and the next pass would be cancelled instead
                        self.accumulator.add(self.samples, 1, self.threads)
                    else:
                        self.lost = count
                    raise
                if not task.result():
                    raise RuntimeError("the rendering was cancelled")
                self.seconds += time.perf_counter() - start
                observe(Progress(self.samples, self.spp, self.seconds))

    def _passes(self) -> Iterator[int]:
        """1, 1, 2, 4, ... samples per pixel, as many as fit into PASS_SECONDS."""
        count = 1
        while self.samples < self.spp:
            if self.samples:
                affordable = int(PASS_SECONDS * self.samples / max(self.seconds, 1e-9))
                count = max(1, min(self.samples, affordable))
            yield min(count, self.spp - self.samples)


def available_threads() -> int:
    """The number of processors that this process may use."""
    ((_, most),) = LIMITS["threads"]
    if hasattr(os, "sched_getaffinity"):
        return min(most, len(os.sched_getaffinity(0)))
    return min(most, os.cpu_count() or 1)
