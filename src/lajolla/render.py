"""Scenes from files or dicts, and the progressive driver that turns them into pictures."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from lajolla import _core
from lajolla.film import Film
from lajolla.image import Image
from lajolla.messages import names_checked, suggestion, warn
from lajolla.scene import (
    Description,
    SceneFile,
    SceneWarning,
    UnknownParameter,
    core_schema,
    describe,
    load_description,
    plugins_by_kind,
)

PASS_SECONDS = 2.0  # passes grow until they take about this long; an interrupted one is lost
POLL_SECONDS = 0.1

MAX_SAMPLES = 2**30  # as in the core
MAX_SEED = 2**32 - 1
MAX_SIZE = 65536
MAX_INTEGER = 2**31 - 1
DEFAULT_FILM = Film()
MAX_THREADS = 1024  # TBB hangs far above


class OptionError(ValueError):
    """A render option that does not fit the scene."""


@dataclass(frozen=True)
class Options:
    """What a caller sets beside the scene; None leaves the scene's own value."""

    spp: int | None = None  # samples per pixel
    size: tuple[int, int] | None = None  # width, height in pixels; drops the scene's crop window
    crop: tuple[int, int, int, int] | None = None  # x, y, width, height in pixels
    seed: int | None = None
    sampler: str | None = None  # "independent" or "sobol", which is also what every sampler of a scene means
    integrator: str | None = None  # keeps the parameters in the scene that the new one has too
    max_depth: int | None = None  # -1: unlimited, 1: emitters alone, 2: direct light
    sensor: int | str | None = None  # which one of several, by its number from 0 or its id

    def __post_init__(self) -> None:
        """Raises OptionError for values that no scene can have."""
        _check_range("spp", self.spp, 1, MAX_SAMPLES)
        _check_range("seed", self.seed, 0, MAX_SEED)
        _check_range("max_depth", self.max_depth, -1, MAX_INTEGER)
        _check_window("size", self.size, (1, 1), MAX_SIZE)
        _check_window("crop", self.crop, (0, 0, 1, 1), MAX_SIZE)
        if self.sensor is not None and not isinstance(self.sensor, str):
            _check_range("sensor", self.sensor, 0, MAX_INTEGER)
        _check_name("sampler", self.sampler, lambda: list(core_schema()["sampler"]))
        _check_name(
            "integrator", self.integrator, lambda: [p.name for p in plugins_by_kind()["integrator"].values()]
        )


def _check_name(kind: str, name: str | None, known: Callable[[], list[str]]) -> None:
    if name is not None and name not in known():
        raise OptionError(f"there is no {kind} {name!r}{suggestion(str(name), known())}")


def _check_range(name: str, value: int | None, lowest: int, highest: int) -> None:
    """Whole numbers of any type pass, and None, which stands for the scene's own value."""
    if value is None:
        return
    if isinstance(value, bool) or not isinstance(value, SupportsIndex):
        raise OptionError(f"{name} must be a whole number, not {value!r}")
    if not lowest <= value <= highest:
        raise OptionError(f"{name} must be in {lowest} to {highest}, not {value}")


def _check_window(name: str, values: Sequence[int] | None, lowest: Sequence[int], highest: int) -> None:
    if values is None:
        return
    if not isinstance(values, Sequence) or len(values) != len(lowest):
        raise OptionError(f"{name} must be {len(lowest)} whole numbers, not {values!r}")
    for value, low in zip(values, lowest, strict=True):
        _check_range(name, value, low, highest)


def apply_options(core: dict[str, Any], options: Options) -> dict[str, Any]:
    """The description with the options in place of the scene's own values. Raises OptionError.

    Another integrator or sensor is not among them: they are chosen when the scene is read.
    """
    result = dict(core)
    result["sampler"] = _with(
        core["sampler"], type=options.sampler, sample_count=options.spp, seed=options.seed
    )
    film = dict(core["film"])
    if options.size is not None:
        film = {key: value for key, value in film.items() if not key.startswith("crop_")}
        film["width"], film["height"] = options.size
    if options.crop is not None:
        film.update(_crop_fields(options.crop, film))
    result["film"] = film
    result["integrator"] = _integrator(core["integrator"], options)
    return result


def _with(entry: Mapping[str, Any], **values: object) -> dict[str, Any]:
    return {**entry, **{key: value for key, value in values.items() if value is not None}}


def _crop_fields(crop: tuple[int, int, int, int], film: Mapping[str, Any]) -> dict[str, int]:
    x, y, width, height = crop
    if x < 0 or y < 0 or x + width > film["width"] or y + height > film["height"]:
        raise OptionError(
            f"the crop window {x},{y},{width},{height} (x, y, width, height) reaches outside of the film, "
            f"{film['width']} x {film['height']}"
        )
    return {"crop_offset_x": x, "crop_offset_y": y, "crop_width": width, "crop_height": height}


def _integrator(entry: Mapping[str, Any], options: Options) -> dict[str, Any]:
    fields = {field["name"] for field in core_schema()["integrator"][entry["type"]]["fields"]}
    if options.max_depth is not None and "max_depth" not in fields:
        raise OptionError(f"the integrator {entry['type']!r} has no max_depth")
    return _with(entry, max_depth=options.max_depth)


@dataclass(frozen=True)
class Progress:
    """How far a rendering is."""

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
    """A picture in the making: passes of samples are added until there are enough.

    An exception in `run`, such as KeyboardInterrupt, leaves the finished passes: `samples` of `spp`.
    """

    def __init__(
        self, core: _core.Scene, *, spp: int, seed: int, threads: int, film: Film = DEFAULT_FILM
    ) -> None:
        self.film = film
        self.channels = core.channels
        self.spp = spp
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
        return Image(values[..., :3], channels, self.film)

    def run(self, observe: Callable[[Progress], None] = lambda progress: None) -> None:
        """Renders what is missing; calls `observe` in this thread, about ten times a second."""
        with ThreadPoolExecutor(1) as worker:
            for count in self._passes():
                start = time.perf_counter()
                task = worker.submit(self.accumulator.add, self.samples, count, self.threads)
                try:
                    while not wait([task], timeout=POLL_SECONDS).done:
                        done = self.samples + self.accumulator.progress * count
                        observe(Progress(done, self.spp, self.seconds + time.perf_counter() - start))
                except BaseException:
                    self.accumulator.cancel()
                    if task.result():  # it had ended already, and the next pass would be cancelled instead
                        self.accumulator.add(self.samples, 1, self.threads)
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


class Scene:
    """A scene ready to be rendered; made by `load` and `load_dict`."""

    def __init__(self, description: Description, options: Options, load_seconds: float = 0.0) -> None:
        start = time.perf_counter()
        core = apply_options(description.core, options)
        try:
            self.core = _core.Scene(core)
        except Exception as problem:
            raise description.refusal(problem) from None
        self.film = description.film
        self.sensors = description.sensors  # ids, or numbers, of all that there are
        self.warnings: list[SceneWarning] = list(description.warnings)
        self.load_seconds = load_seconds  # reading files
        self.build_seconds = time.perf_counter() - start  # acceleration structures, light tables

    def __repr__(self) -> str:
        samples = self.core.sample_count
        return f"<lajolla.Scene, {self.width} x {self.height} pixels, {samples} samples per pixel>"

    @property
    def width(self) -> int:
        """Of the picture, in pixels."""
        return self.core.width

    @property
    def height(self) -> int:
        """Of the picture, in pixels."""
        return self.core.height

    @names_checked
    def rendering(
        self, *, spp: int | None = None, seed: int | None = None, threads: int | None = None
    ) -> Rendering:
        """A Rendering to run step by step; see `render`."""
        spp = self.core.sample_count if spp is None else spp
        seed = self.core.seed if seed is None else seed
        threads = available_threads() if threads is None else threads
        _check_range("spp", spp, 1, MAX_SAMPLES)
        _check_range("seed", seed, 0, MAX_SEED)
        _check_range("threads", threads, 1, MAX_THREADS)
        return Rendering(self.core, spp=spp, seed=seed, threads=threads, film=self.film)

    @names_checked
    def render(
        self,
        *,
        spp: int | None = None,
        seed: int | None = None,
        threads: int | None = None,
        observe: Callable[[Progress], None] = lambda progress: None,
    ) -> Image:
        """Renders the picture; the same scene, spp and seed give the same picture, bit for bit.

        Args:
            spp: samples per pixel; the scene's own number by default.
            seed: of the sampler; the scene's own by default.
            threads: all that this process may use by default.
            observe: is told the progress about ten times a second.
        """
        rendering = self.rendering(spp=spp, seed=seed, threads=threads)
        rendering.run(observe)
        return rendering.image()

    @names_checked
    def radiance(self, x: int, y: int, sample: int | None = None, *, seed: int | None = None) -> NDArray[Any]:
        """What one sample of pixel (x, y) adds, or the mean of all samples: three numbers, float64.

        The pixel is counted from the film's corner, whatever the crop window. Unlike in a picture, values
        that are not finite stay what they are. Raises OptionError outside of the picture.
        """
        _check_range("x", x, 0, MAX_SIZE)
        _check_range("y", y, 0, MAX_SIZE)
        left, top = self.core.crop_offset
        if not (left <= x < left + self.width and top <= y < top + self.height):
            begin = f", which begins at {left},{top}" if left or top else ""
            raise OptionError(f"pixel {x},{y} is outside of the picture, {self.width} x {self.height}{begin}")
        seed = self.core.seed if seed is None else seed
        _check_range("seed", seed, 0, MAX_SEED)
        _check_range("sample", sample, 0, MAX_SAMPLES - 1)
        samples = range(self.core.sample_count) if sample is None else [sample]
        values = [_core.sample_radiance(self.core, seed, x, y, index) for index in samples]
        return np.mean(np.asarray(values, np.float64), axis=0)


def available_threads() -> int:
    """The number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return min(MAX_THREADS, len(os.sched_getaffinity(0)))
    return min(MAX_THREADS, os.cpu_count() or 1)


def load(
    path: SceneFile,
    *,
    strict: bool = False,
    two_sided: bool = False,
    parameters: Mapping[str, object] | None = None,
    **options: Any,  # noqa: ANN401
) -> Scene:
    """Opens a Mitsuba scene file.

    Python's `warnings` tell what is not rendered as written, each as a SceneWarning; the scene keeps them.

    Args:
        path: the XML file, or a binary file object to read it from. Other files are beside it; where it has no
            name, in the current folder.
        strict: makes unknown plugins and properties errors.
        two_sided: lets opaque surfaces reflect on both sides.
        parameters: values of the file's `$name` parameters.
        options: the fields of `Options` (spp, size, crop, seed, sampler, integrator, max_depth, sensor); any
            other name is a parameter that the file must have.

    Raises:
        SceneError: something is wrong with the scene; the message tells where.
        OptionError: an option does not fit the scene.
        TypeError: there is no such option or parameter.
    """
    own, extra = _split_options(options)
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
        )
    except UnknownParameter as problem:
        hint = suggestion(problem.name, [*LOAD_OPTIONS, "parameters", *vars(own), *problem.known])
        what = f"load() has no option {problem.name!r}, nor has the scene such a parameter"
        raise TypeError(what + hint) from None
    return _told(Scene(description, own, time.perf_counter() - start))


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

    Relative file names in it belong to `base_path`, or else to the current folder.
    """
    own, unknown = _split_options(options)
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
    return _told(Scene(description, own, time.perf_counter() - start))


def _told(scene: Scene) -> Scene:
    for warning in scene.warnings:
        warn(warning)
    return scene


def _split_options(options: Mapping[str, Any]) -> tuple[Options, dict[str, Any]]:
    known = vars(Options())
    extra = {name: value for name, value in options.items() if name not in known}
    return Options(**{name: value for name, value in options.items() if name in known}), extra


def _as_text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
