"""Loads scenes from files or dicts."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lajolla import _core
from lajolla.aovs import ALPHA, VARIANCE, needs_names
from lajolla.colour import FloatImage
from lajolla.denoising import FEATURE_SAMPLES, LAYERS, DenoiseError, check_available, features_output
from lajolla.image import Image
from lajolla.limits import MOST_SAMPLES, OptionError, check
from lajolla.messages import names_checked, suggestion, warn
from lajolla.objects import ObjectLayers
from lajolla.options import Options, apply_options
from lajolla.params import Params
from lajolla.picture_files import ImageWarning
from lajolla.render import Progress, Rendering, StopRules, available_threads
from lajolla.scene import (
    Description,
    Places,
    SceneFile,
    SceneWarning,
    UnknownParameter,
    describe,
    load_description,
)

if TYPE_CHECKING:
    from distributed import Client


class Scene:
    """A scene ready to be rendered; made by `load` and `load_dict`."""

    def __init__(self, description: Description, options: Options, load_seconds: float = 0.0) -> None:
        start = time.perf_counter()
        core = apply_options(description.core, options, description.light_groups)
        try:
            self.core = _core.Scene(core)
        except Exception as problem:
            raise description.refusal(problem) from None
        # To build it again elsewhere, which needs no places of errors.
        self.description = replace(description, core=core, places=Places())
        self._places = description.places
        self.film = description.film.with_alpha() if ALPHA in options.aovs else description.film
        self.aovs = tuple(options.aovs)
        self._params: Params | None = None
        self.names = description.names  # of objects, if an aov needs them
        self.sensors = description.sensors  # ids of all sensors, or their numbers
        self.warnings: list[SceneWarning] = list(description.warnings)
        self.load_seconds = load_seconds  # reading files
        self.build_seconds = time.perf_counter() - start  # acceleration structures, light tables

    def __reduce__(self) -> tuple[object, ...]:
        """A pickle holds the description with its options; the scene is built when the pickle is loaded."""
        kept = {"film": self.film, "aovs": self.aovs, "names": self.names}
        return Scene, (self.description, Options(), self.load_seconds), kept

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

    @property
    def params(self) -> Params:
        """All parameters by readable paths, such as "red.reflectance", to read; see `with_params`."""
        if self._params is None:
            self._params = Params(self.description, self._places)
        return self._params

    def __getitem__(self, path: str) -> Any:  # noqa: ANN401
        """The value of a parameter; the same as `params[path]`."""
        return self.params[path]

    def __setitem__(self, path: str, value: object) -> None:
        """Changes a parameter; see `with_params`. Renderings that were made before are not affected."""
        self.update({path: value})

    def update(self, values: Mapping[str, Any]) -> None:
        """Changes several parameters of this scene at once; see `with_params`."""
        self.__dict__.update(self.with_params(values).__dict__)

    def with_params(self, values: Mapping[str, Any]) -> Scene:
        """The same scene with other values of some parameters.

        Renders are the same, bit for bit, as those of a scene that was loaded with these values. Only what
        depends on them is made anew: nothing for a camera, no acceleration structure for a colour.

        Args:
            values: by the paths of `params`. A value is what the path would return, or what a scene dict
                takes there: a number, a colour, an array, a `{"type": "bitmap", "data": array}`, or the
                name of another texture or bsdf. None removes normals and uvs of a mesh, and media.

        Raises:
            ParamError: there is no such parameter; the message names the most similar one.
            SceneError: a value is of another type or out of range, or the scene cannot be built with it.

        Example:
            >>> scene.with_params({"red.reflectance": (0.6, 0.05, 0.05), "sensor.fov": 40.0})
        """
        edits = self.params.edits(values)
        changes, core = edits.changes(), edits.description()
        try:
            changed = self.core.with_changes(changes) or _core.Scene(core)
        except Exception as problem:
            raise self.params.refusal(problem, changes) from None
        for warning in edits.warnings:
            warn(warning)
        result = Scene.__new__(Scene)
        result.__dict__.update(self.__dict__)
        result.core = changed
        result.description = replace(self.description, core=core)
        result._params = self.params.after(edits, result.description)
        return result

    @names_checked
    def rendering(
        self,
        *,
        spp: int | None = None,
        seconds: float | None = None,
        noise: float | None = None,
        adaptive: bool | None = None,
        seed: int | None = None,
        threads: int | None = None,
        first_sample: int = 0,
        cluster: str | Client | None = None,
        mixed: bool = False,
    ) -> Rendering:
        """A Rendering to run step by step; see `render`.

        Args:
            first_sample: index of the first sample of each pixel, in its sequence of samples. Renders of
                different ranges of samples can be merged.
        """
        numbers = (("spp", spp), ("seed", seed), ("threads", threads), ("sample", first_sample))
        for name, value in numbers:
            check(name, value)
        if spp is None and seconds is None and noise is None:
            spp = self.core.sample_count
        if spp is not None and first_sample + spp > MOST_SAMPLES:
            raise OptionError(f"sample {first_sample + spp - 1} is beyond the last, {MOST_SAMPLES - 1}")
        rules = StopRules(
            spp=spp,
            seconds=math.inf if seconds is None else seconds,
            noise=0.0 if noise is None else noise,
            adaptive=noise is not None if adaptive is None else adaptive,
            most=MOST_SAMPLES - first_sample,
        )
        seed = self.core.seed if seed is None else seed
        if cluster is not None:
            from lajolla.cluster import ClusterRendering  # here, as it takes long

            return ClusterRendering(
                self.core,
                self.description.core,
                cluster=cluster,
                mixed=mixed,
                rules=rules,
                seed=seed,
                threads=threads,
                film=self.film,
                first_sample=first_sample,
            )
        threads = available_threads() if threads is None else threads
        if spp is not None and spp < 2 and VARIANCE in self.aovs:
            raise OptionError("the aov 'variance' needs at least two samples per pixel")
        return Rendering(
            self.core,
            self.description.core,
            rules=rules,
            seed=seed,
            threads=threads,
            film=self.film,
            first_sample=first_sample,
            layers=ObjectLayers(self.core, self.aovs, self.names, seed, first_sample, threads),
        )

    @names_checked
    def render(
        self,
        *,
        spp: int | None = None,
        seconds: float | None = None,
        noise: float | None = None,
        adaptive: bool | None = None,
        seed: int | None = None,
        threads: int | None = None,
        cluster: str | Client | None = None,
        mixed: bool = False,
        observe: Callable[[Progress], None] = lambda progress: None,
        denoise: bool = False,
    ) -> Image:
        """Renders the picture, until the first of spp, seconds and noise is reached.

        The same scene, seed, spp, noise and adaptive give the same picture, bit for bit. An exception, such
        as KeyboardInterrupt, loses the picture; a `rendering` keeps its finished tiles.

        Args:
            spp: samples per pixel, or their mean if adaptive; default: the scene's own number, if neither
                seconds nor noise are given.
            seconds: time for rendering.
            noise: relative error of the picture to be reached, as estimated from its samples: the root of the
                mean of squared errors divided by v^2 + m^2 / 100, of values v and their mean m.
            adaptive: whether to take more samples where the error is larger; default: if noise is given.
            seed: seed of the sampler; default: the scene's own seed.
            threads: number of threads; default: as many as this process may use. With `cluster`: of each
                worker; default: as many as it has.
            cluster: renders on the workers of a Dask scheduler, such as "tcp://host:8786", or of a
                `distributed.Client`; or in so many processes of this machine, such as "local:4". The picture
                is the same. Raises ClusterError.
            mixed: permits workers with another instruction set; the picture may then differ in the last bits.
            observe: called with the progress about ten times a second.
            denoise: removes noise with the help of `features`; see `Image.denoise`. If that fails, the
                picture is returned as rendered, with an ImageWarning.

        Raises:
            DenoiseError: `denoise` is set, and Open Image Denoise is not installed.
            OptionError: an option is out of range, or the integrator shows no light to denoise.
        """
        if denoise:
            check_available()
        rendering = self.rendering(
            spp=spp,
            seconds=seconds,
            noise=noise,
            adaptive=adaptive,
            seed=seed,
            threads=threads,
            cluster=cluster,
            mixed=mixed,
        )
        features = self.features(seed=seed, threads=threads) if denoise else None
        rendering.run(observe)
        image = rendering.image()
        if features is None:
            return image
        try:
            return image.denoise(features, threads=threads)
        except DenoiseError as problem:
            warn(ImageWarning(f"{problem}; the picture is as rendered"))
            return image

    @names_checked
    def features(
        self,
        *,
        seed: int | None = None,
        threads: int | None = None,
        observe: Callable[[Progress], None] = lambda progress: None,
    ) -> dict[str, FloatImage]:
        """What `Image.denoise` should know of the picture: "albedo.R", ..., "normal.z", by their names.

        They show the first surface that is neither a mirror nor glass, with little noise; see
        docs/denoising.md. Raises OptionError if the integrator shows no light.
        """
        for name, value in (("seed", seed), ("threads", threads)):
            check(name, value)
        output = features_output(self.description.core["integrator"])
        rendering = Rendering(
            self.core.with_output(output),
            {**self.description.core, **output},
            rules=StopRules(spp=FEATURE_SAMPLES),
            seed=self.core.seed if seed is None else seed,
            threads=available_threads() if threads is None else threads,
        )
        rendering.run(observe)
        image = rendering.image()
        return {**dict(zip(LAYERS["albedo"], np.moveaxis(image.array, 2, 0), strict=True)), **image.channels}

    @names_checked
    def radiance(self, x: int, y: int, sample: int | None = None, *, seed: int | None = None) -> NDArray[Any]:
        """The value of one sample of pixel (x, y), or the mean of all samples: three numbers, float64.

        x and y count from the top left corner of the film, with or without a crop window. Unlike in a
        picture, values that are not finite are kept. Raises OptionError outside of the picture.
        """
        for name, value in (("pixel", (x, y)), ("sample", sample), ("seed", seed)):
            check(name, value)
        left, top = self.core.crop_offset
        if not (left <= x < left + self.width and top <= y < top + self.height):
            begin = f", which begins at {left},{top}" if left or top else ""
            raise OptionError(f"pixel {x},{y} is outside of the picture, {self.width} x {self.height}{begin}")
        seed = self.core.seed if seed is None else seed
        samples = range(self.core.sample_count) if sample is None else [sample]
        values = [_core.sample_radiance(self.core, seed, x, y, index) for index in samples]
        return np.mean(np.asarray(values, np.float64), axis=0)


def load(
    path: SceneFile,
    *,
    strict: bool = False,
    two_sided: bool = False,
    parameters: Mapping[str, object] | None = None,
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
        options: the fields of `Options` (spp, size, crop, seed, sampler, integrator, max_depth, sensor,
            hide_emitters, aovs); other names are parameters that the file must have.

    Raises:
        SceneError: the scene has an error; the message contains the location.
        OptionError: an option does not fit the scene.
        TypeError: unknown option or parameter.
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
            named=needs_names(own.aovs),
        )
    except UnknownParameter as problem:
        hint = suggestion(problem.name, [*LOAD_OPTIONS, "parameters", *vars(own), *problem.known])
        what = f"load() has no option {problem.name!r}, nor has the scene such a parameter"
        raise TypeError(what + hint) from None
    return _warned(Scene(description, own, time.perf_counter() - start))


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
        named=needs_names(own.aovs),
    )
    return _warned(Scene(description, own, time.perf_counter() - start))


def _warned(scene: Scene) -> Scene:
    for warning in scene.warnings:
        warn(warning)
    return scene


def _split_options(options: Mapping[str, Any]) -> tuple[Options, dict[str, Any]]:
    known = vars(Options())
    extra = {name: value for name, value in options.items() if name not in known}
    return Options(**{name: value for name, value in options.items() if name in known}), extra


def _as_text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
