"""Progressive rendering in passes, until a number of samples, a time or a noise level is reached."""

import math
import os
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lajolla import _core
from lajolla.adaptive import FIRST_COUNT, Counts, ErrorEstimate, Halves
from lajolla.aovs import SAMPLES
from lajolla.colour import FloatImage
from lajolla.film import Film
from lajolla.image import Image
from lajolla.layers import named_channels
from lajolla.limits import LIMITS, MOST_SAMPLES, OptionError, check_flag, check_real
from lajolla.messages import names_checked
from lajolla.objects import ObjectLayers

PASS_SECONDS = 2.0  # passes grow until they take about this long
POLL_SECONDS = 0.1

DEFAULT_FILM = Film()


@dataclass(frozen=True)
class StopRules:
    """A render ends when the first of these is reached.

    Raises OptionError for impossible values.
    """

    spp: int | None = None  # samples per pixel; if adaptive, the mean of all pixels
    seconds: float = math.inf  # of rendering, without loading the scene and saving the picture
    noise: float = 0.0  # estimated relative error, as in ErrorEstimate
    adaptive: bool = False  # take more samples where the error is larger
    most: int = MOST_SAMPLES  # samples per pixel that there are

    def __post_init__(self) -> None:
        check_real("seconds", self.seconds)
        check_real("noise", self.noise)
        check_flag("adaptive", self.adaptive)
        if not self.seconds > 0:
            raise OptionError(f"seconds must be positive, not {self.seconds}")
        if not 0 <= self.noise < 1:
            raise OptionError(f"noise must be at least 0 and less than 1, not {self.noise}")

    @property
    def most_samples(self) -> int:
        """Samples per pixel that must not be exceeded."""
        return self.most if self.spp is None else self.spp

    @property
    def in_rounds(self) -> bool:
        """Whether errors must be estimated."""
        return self.adaptive or self.noise > 0


@dataclass(frozen=True)
class Progress:
    """Progress of a render."""

    samples: float  # per pixel, the mean of all pixels
    seconds: float  # of rendering so far
    rules: StopRules
    noise: float = math.inf  # estimated relative error; infinite if unknown

    @property
    def fraction(self) -> float:
        """How far it is, by the rule that will be met first."""
        return min(
            1.0,
            max(
                self.samples / self.rules.spp if self.rules.spp else 0.0,
                self.seconds / self.rules.seconds,
                (self.rules.noise / max(self.noise, 1e-30)) ** 2,
            ),
        )

    @property
    def seconds_left(self) -> float:
        return self.seconds * (1 - self.fraction) / self.fraction if self.fraction else math.inf


class RenderCancelled(RuntimeError):
    """The accumulator of a rendering was cancelled, from another thread."""


class Rendering:
    """A render in progress: passes of samples are added until a stop rule is met.

    An exception in `run`, such as KeyboardInterrupt, leaves the samples of all finished tiles; `run` can be
    called again.
    """

    def __init__(
        self,
        core: _core.Scene,
        description: Mapping[str, Any],
        *,
        rules: StopRules,
        seed: int,
        threads: int,
        film: Film = DEFAULT_FILM,
        first_sample: int = 0,
        layers: ObjectLayers | None = None,
    ) -> None:
        self.description = description  # what `core` was built from
        self.film = film
        self.layers = layers
        self.channels = core.channels
        self.rules = rules
        self.seed = seed
        self.first_sample = first_sample  # every pixel begins with this one
        self.threads = threads
        self.seconds = 0.0
        self.accumulator = _core.Render(core, seed, first_sample)
        self.halves = Halves(core.width, core.height, core.crop_offset)
        self.estimate = ErrorEstimate(self.halves)
        self.round: Counts | None = None  # the counts at the end of a round that has begun

    @property
    def samples(self) -> float:
        """Samples per pixel, the mean of all pixels."""
        return self.halves.mean(self.accumulator.counts)

    @property
    def aovs(self) -> Sequence[str]:
        """Names of the variables beside the picture."""
        return self.layers.aovs if self.layers is not None else ()

    @property
    def noise(self) -> float:
        """The estimated relative error of the picture; infinite if the stop rules do not need it."""
        return self.estimate.noise

    def image(self) -> Image:
        """The mean of the samples so far."""
        image = self.mean()
        if self.layers is not None:
            image.layers = self.layers.layers(int(self.accumulator.pixel_counts().max()))
        return image

    def mean(self) -> Image:
        """The same without the layers that are no means, such as numbers of objects."""
        counts = self.accumulator.pixel_counts()
        return developed(self.accumulator.image(), counts, self.channels, self.aovs, self.film)

    @names_checked
    def run(self, observe: Callable[[Progress], None] = lambda progress: None) -> None:
        """Renders until a stop rule is met; calls `observe` in this thread about ten times a second."""
        with ThreadPoolExecutor(1) as worker:
            for counts in self._passes():
                self._advance(counts, worker, observe)

    def _passes(self) -> Iterator[Counts]:
        """The numbers of samples after each pass."""
        return self._rounds() if self.rules.in_rounds else self._even_passes(self.rules.most_samples)

    def _advance(
        self, counts: Counts, worker: ThreadPoolExecutor, observe: Callable[[Progress], None]
    ) -> None:
        """One pass: renders until the halves of cells have these numbers of samples."""
        before = self.samples
        after = self.halves.mean(np.maximum(counts, self.accumulator.counts))
        start = time.perf_counter() - self.seconds
        task = worker.submit(self.accumulator.advance, counts, self.threads)
        try:
            while not wait([task], timeout=POLL_SECONDS).done:
                self.seconds = time.perf_counter() - start
                samples = before + self.accumulator.progress * (after - before)
                observe(Progress(samples, self.seconds, self.rules, self.noise))
        except BaseException:
            self.accumulator.cancel()
            task.exception()  # waits
            self.accumulator.resume()  # it may have ended already
            raise
        finally:
            self.seconds = time.perf_counter() - start
        if not task.result():
            raise RenderCancelled("the rendering was cancelled")
        observe(Progress(self.samples, self.seconds, self.rules, self.noise))

    def _even_passes(self, spp: int) -> Iterator[Counts]:
        """The same number of samples for all pixels: after the passes 1, 2, 4, ..., as time allows."""
        while (samples := int(self.accumulator.counts.min())) < spp:
            rate = self.samples / max(self.seconds, 1e-9)
            if samples and (self.rules.seconds - self.seconds) * rate < 1:
                return
            step = min(samples, int(min(PASS_SECONDS, self.rules.seconds - self.seconds) * rate))
            yield np.full(self.halves.shape, min(samples + max(step, 1), spp), np.uint32)

    def _rounds(self) -> Iterator[Counts]:
        """Even passes, and then rounds that double the samples of some pixels, or of all."""
        yield from self._even_passes(min(FIRST_COUNT, self.rules.most_samples))
        while self.accumulator.counts.min() >= FIRST_COUNT:
            if self.round is None:
                self.estimate.update(self.accumulator.image()[..., :3], self.accumulator.counts)
                if 0 < self.rules.noise >= self.noise:
                    return
                self.round = self._next_round()
                if (self.round <= self.accumulator.counts).all():
                    return
            yield from self._passes_to(self.round)
            if (self.accumulator.counts < self.round).any():  # no time is left
                return
            self.round = None

    def _next_round(self) -> Counts:
        counts = self.accumulator.counts
        if self.rules.adaptive and np.isfinite(self.noise):
            cost = self.halves.cost(self.accumulator.rays, counts)
            most, noise = self.rules.most_samples, self.rules.noise or None
            return self.estimate.next_counts(counts, cost, most=most, noise=noise)
        return np.minimum(2 * counts, self.rules.most_samples).astype(np.uint32)

    def _passes_to(self, counts: Counts) -> Iterator[Counts]:
        """Passes that end with these numbers of samples, or when there is no time left."""
        while (missing := np.maximum(counts, self.accumulator.counts) - self.accumulator.counts).any():
            rate = self.samples / max(self.seconds, 1e-9)
            possible = min(PASS_SECONDS, self.rules.seconds - self.seconds) * rate
            share = possible / self.halves.mean(missing)
            step = np.ceil(missing * min(share, 1)).astype(np.uint32)
            if self.halves.mean(step) > (self.rules.seconds - self.seconds) * rate:
                return
            yield self.accumulator.counts + step


def developed(
    means: FloatImage,
    counts: NDArray[np.uint32],
    labels: Sequence[str],
    aovs: Collection[str],
    film: Film,
) -> Image:
    """The picture of means (height, width, 3 + number of labels) of counts (height, width) samples."""
    channels = named_channels(means, labels, counts)
    if SAMPLES in aovs:
        channels[f"{SAMPLES}.C"] = counts.astype(np.float32)
    return Image(means[..., :3], channels, film)


def available_threads() -> int:
    """The number of processors that this process may use."""
    ((_, most),) = LIMITS["threads"]
    if hasattr(os, "sched_getaffinity"):
        return min(most, len(os.sched_getaffinity(0)))
    return min(most, os.cpu_count() or 1)
