"""Scenes ready to be rendered."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lajolla import _core, holes
from lajolla.aovs import ALPHA, VARIANCE, check_aovs, with_aovs
from lajolla.background import in_thread
from lajolla.colour import FloatImage
from lajolla.denoising import (
    FEATURE_SAMPLES,
    HELD_OUT,
    LAYERS,
    DenoiseError,
    check_available,
    features_output,
)
from lajolla.description_changes import description_changes
from lajolla.image import Image
from lajolla.layers import has_shadows
from lajolla.limits import MOST_SAMPLES, OptionError, check, check_flag, check_mapping, whole
from lajolla.messages import names_checked, suggestion, warn
from lajolla.objects import ObjectLayers
from lajolla.options import Options, apply_options, apply_to_view
from lajolla.params import ParamError, Params
from lajolla.picture_files import ImageWarning
from lajolla.queries import Intersections, intersections_of, occlusion_of
from lajolla.render import Progress, Rendering, StopRules, available_threads
from lajolla.saving import save
from lajolla.scene import Description, SceneWarning, View

if TYPE_CHECKING:
    from distributed import Client

OUTPUT = ("integrator", "other_integrators", "channels")  # entries of a description


class Scene:
    """A scene ready to be rendered; made by `load` and `load_dict`.

    `scene[path]` reads and `scene[path] = value` changes a parameter, see `params`; `path in scene` tells
    whether there is one, and iteration gives the paths. A sensor that is not in use is also reached by its
    id: `scene["second.fov"]`.

    Attributes:
        width, height: of the picture, in pixels.
        params: all parameters by their paths.
        warnings: what is not rendered as written, also of changes: a list of SceneWarning.
        sensors: the ids of all sensors, or their numbers if they have none; empty for a scene without one.
        sensor: the one in use.
        aovs: the variables that are rendered beside the picture.
        film: how pictures are written.
        load_seconds, build_seconds: the time to read files, and to build acceleration structures and tables.
    """

    def __init__(
        self,
        description: Description,
        options: Options,
        load_seconds: float = 0.0,
        reuse: Scene | None = None,
    ) -> None:
        start = time.perf_counter()
        core = apply_options(description.core, options, description.light_groups)
        try:
            changes = description_changes(reuse.description.core, core) if reuse is not None else None
            shared = reuse.core.with_changes(changes) if reuse is not None and changes is not None else None
            self.core: _core.Scene = shared or _core.Scene(core)
        except Exception as problem:
            raise description.refusal(problem) from None
        # To build it again elsewhere, which needs neither places of errors nor the contents of files.
        self.description: Description = replace(description.without_files(), core=core)
        self._read = description  # as it was read, for `save`
        self.files: Mapping[Any, Any] = description.files  # that were read, for `load(reuse=)`
        self.options = options
        self.sensors = description.sensors  # ids of all sensors, or their numbers
        self._places = description.places
        self.film = description.film.with_alpha() if ALPHA in options.aovs else description.film
        self.aovs = tuple(options.aovs)
        self._params = Params(self.description, self._places)
        self._updates = threading.RLock()  # of all copies: one update after another
        self.warnings: list[SceneWarning] = list(description.warnings)
        self.load_seconds = load_seconds  # reading files
        self.build_seconds = time.perf_counter() - start  # acceleration structures, light tables

    def __reduce__(self) -> tuple[object, ...]:
        """A pickle holds the description with its options; the scene is built when the pickle is loaded."""
        kept = {"film": self.film, "aovs": self.aovs, "options": self.options, "_params": self._params}
        views = {name: view.without_places() for name, view in self.description.views.items()}
        return Scene, (replace(self.description, views=views), Options(), self.load_seconds), kept

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
        return self._params

    @property
    def paths(self) -> set[Path]:
        """All files that it was read from: the scene file, and those that this one names or includes."""
        return self._read.paths

    def __getitem__(self, path: str) -> Any:  # noqa: ANN401
        """The value of a parameter; the same as `params[path]`, and those of sensors that are not in use."""
        view = self._view_of(path)
        if view:
            return self.with_sensor(view).params[_in_view(path)]
        return self.params[path]

    def __contains__(self, path: object) -> bool:
        try:
            self[str(path)]
        except ParamError:
            return False
        return True

    def __iter__(self) -> Iterator[str]:
        return iter(self.params)

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.params)

    def _view_of(self, path: object) -> str:
        """The sensor whose parameter a path means, if it is not the one in use; else ""."""
        name = str(path).rpartition(".")[0]
        return name if name in self.description.views and name not in self.params.objects else ""

    def __setitem__(self, path: str, value: object) -> None:
        """Changes a parameter; see `with_params`. Renderings that were made before are not affected."""
        self.update({path: value})

    def update(self, values: Mapping[str, Any]) -> None:
        """Changes several parameters of this scene at once; see `with_params`."""
        with self._updates:
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
        check_mapping("values", values)
        before = self._as_it_is()
        if names := {name: None for path in values if (name := before._view_of(path))}:
            return before._with_views(names, values)
        edits = before.params.edits(values)
        changes, core = edits.changes(), edits.description()
        try:
            changed = before.core.with_changes(changes) or _core.Scene(core)
        except Exception as problem:
            raise before.params.refusal(problem, changes) from None
        for warning in edits.warnings:
            warn(warning)
        result = before._as_it_is()
        result.core = changed
        result.description = replace(before.description, core=core, objects=edits.known_after())
        result._params = before.params.after(edits, result.description)
        replaced = {f"params[{path}]" for path in values}
        kept = [warning for warning in before.warnings if str(warning.location) not in replaced]
        result.warnings = [*kept, *edits.warnings]
        return result

    def _with_views(self, names: Iterable[str], values: Mapping[str, Any]) -> Scene:
        """The scene with other values of parameters, also of sensors that are not in use."""
        views = dict(self.description.views)
        for name in names:
            own = {path: value for path, value in values.items() if self._view_of(path) == name}
            seen = self.with_sensor(name).with_params({_in_view(path): own[path] for path in own})
            views[name] = replace(seen._own_view(views[name].entries), warnings=views[name].warnings)
        result = self._as_it_is()
        result.description = replace(self.description, views=views)
        result._params = self._params.of(result.description, self._places)
        return result.with_params({p: v for p, v in values.items() if not self._view_of(p)})

    def _as_it_is(self) -> Scene:
        """The scene at one moment; another thread may change it in the next."""
        result = Scene.__new__(Scene)
        result.__dict__.update(self.__dict__)
        return result

    @property
    def sensor(self) -> str:
        """The id or number of the sensor that the scene is seen by; "" if it has none."""
        return next((name for name in self.sensors if name not in self.description.views), "")

    def with_sensor(self, sensor: int | str) -> Scene:
        """The same scene, seen by another of its sensors; nothing is loaded again.

        Args:
            sensor: its number, from 0, or its id. The size and other options with which the scene was loaded
                apply to it too.

        Raises:
            OptionError: there is no such sensor.
            SceneError: it cannot be used.
        """
        name = self._sensor_name(sensor)
        if name == self.sensor:
            return self
        view = self.description.views[name]
        if view.problem is not None:
            raise view.problem
        for warning in view.warnings:
            warn(warning)
        entries = apply_to_view(view.entries, self.options)
        own = self._own_view(entries)
        views = {
            **{other: v for other, v in self.description.views.items() if other != name},
            self.sensor: own,
        }
        changed = self.core.with_changes(entries)
        assert changed is not None  # the scene stays where it is
        result = self._copy(changed, {**self.description.core, **entries})
        objects = self.description.objects.with_view(entries, view.plugins, view.ids)
        result._places = self._places.with_places(view.places)
        result._describe(replace(result.description, views=views, objects=objects))
        result.film = view.film
        return result._with_alpha() if view.film.has_alpha or ALPHA in self.aovs else result

    def _own_view(self, names: Iterable[str]) -> View:
        """That of the sensor in use, of these entries."""
        known, core = self.description.objects, self.description.core
        plugins = {name: known.plugins[name] for name in names if name in known.plugins}
        ids = {name: known.ids[name] for name in names if name in known.ids}
        places = {name: place for name in names if (place := self._places.find(name)) is not None}
        return View({name: core[name] for name in names}, self.film, plugins, places, ids=ids)

    def _sensor_name(self, sensor: int | str) -> str:
        if sensor in self.sensors:
            return str(sensor)
        number = int(sensor) if isinstance(sensor, str) and sensor.isdecimal() else whole(sensor)
        if number is None or not 0 <= number < len(self.sensors):
            raise OptionError(f"unknown sensor {sensor!r}{suggestion(str(sensor), self.sensors)}")
        return self.sensors[number]

    def with_aovs(self, aovs: Sequence[str]) -> Scene:
        """The same scene, of which these variables are rendered too, such as "depth" and "shape".

        `lajolla list aov` lists them; `Image.arrays` returns them. Raises OptionError.
        """
        new = [name for name in check_aovs(aovs) if name not in self.aovs]
        if not new:
            return self
        core = with_aovs(self.description.core, new, self.description.light_groups)
        result = self._copy(self.core.with_output(_output_of(core)), core)
        result.aovs = (*self.aovs, *new)
        return result._with_alpha() if ALPHA in new else result

    def _with_alpha(self) -> Scene:
        """This scene with alpha, in the picture and among its channels."""
        self.film = self.film.with_alpha()
        core, channels = self.description.core, list(self.description.core.get("channels", ()))
        if all(channel["label"] != "A" for channel in channels):
            core = {**core, "channels": [{"label": "A", "recorded": "alpha"}, *channels]}
            self.core = self.core.with_output(_output_of(core))
            self._describe(replace(self.description, core=core))
        return self

    def _copy(self, core: _core.Scene, description: dict[str, Any]) -> Scene:
        """The same with another core, and the description of that."""
        result = self._as_it_is()
        result.core = core
        result._describe(replace(self.description, core=description))
        return result

    def _describe(self, description: Description) -> None:
        self.description = description
        self._params = self._params.of(description, self._places)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the scene as it is now: the text of its file, with what was changed since it was loaded.

        Loaded again, it renders the same bits. Everything else stays as it was written, and the files that it
        names stay where they are; arrays that were put in, such as vertices or pixels, are written into a
        folder beside it. The options of `load` become parts of the file, except `two_sided`, `sampler`, and
        `aovs`, with a warning.

        Raises:
            SceneError: a change cannot be written, and the message has its path; the scene was loaded
                from a dict; or `path` is a mesh, a texture or an included file of the scene.
            ImageError: the file cannot be written.

        Example:
            >>> scene["red.reflectance"] = (0.1, 0.2, 0.6)
            >>> scene.save("blue.xml")
        """
        save(self._read, self.description, self.params, Path(path))

    @names_checked
    def intersect(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        max_distance: ArrayLike = math.inf,
        *,
        threads: int | None = None,
    ) -> Intersections:
        """The closest surfaces that rays meet, on all processors.

        Args:
            origins, directions: (N, 3), or (3,) for the same in all rays; directions need no unit length.
            max_distance: where rays end, in lengths of the direction: a number, or (N,).
            threads: number of threads; default: as many as this process may use.

        Nothing is met by rays of which max_distance is negative, or whose origin or direction has a length
        that is not finite or above 1e18.

        Raises:
            ValueError: shapes of the arrays do not fit together, or max_distance is NaN.

        Example:
            >>> hits = scene.intersect((0, 1, 5), [[0, 0, -1], [0, 1, 0]])
            >>> hits.distance[hits.hit]
        """
        threads = check("threads", threads)
        return intersections_of(self.core, self.description, origins, directions, max_distance, threads or 0)

    @names_checked
    def occluded(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        max_distance: ArrayLike = math.inf,
        *,
        threads: int | None = None,
    ) -> NDArray[np.bool_]:
        """Whether rays meet any surface: (N,); see `intersect`, which takes longer."""
        threads = check("threads", threads)
        return occlusion_of(self.core, origins, directions, max_distance, threads or 0)

    def camera_rays(self) -> tuple[NDArray[np.float64], FloatImage, FloatImage]:
        """The camera's rays through the centres of pixels, row by row, for `intersect` and `occluded`.

        Origins (height * width, 3), on the near plane, directions (height * width, 3) of unit length, and
        max_distance (height * width,), to the far plane. A lens is seen through its centre.

        Example:
            >>> hits = scene.intersect(*scene.camera_rays())
            >>> names = np.array(hits.shape_names)[hits.shape].reshape(scene.height, scene.width)
        """
        origins, directions, ends = _core.camera_rays(self.core)
        return origins, directions, ends

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
        sensor: int | str | None = None,
        aovs: Sequence[str] = (),
        first_sample: int = 0,
        cluster: str | Client | None = None,
        mixed: bool = False,
    ) -> Rendering:
        """A Rendering to run step by step; see `render` for the options.

        `render(denoise=True)` is `rendering().image().denoise(scene.features())`.

        Args:
            first_sample: index of the first sample of each pixel, in its sequence of samples. Renders of
                different ranges of samples can be merged.
        """
        scene = (self if sensor is None else self.with_sensor(sensor)).with_aovs(aovs)
        scene._warn_of_lost_shadows()
        spp, seed, threads = check("spp", spp), check("seed", seed), check("threads", threads)
        first_sample = check("sample", first_sample)
        check_flag("mixed", mixed)
        if spp is None and seconds is None and noise is None:
            spp = scene.core.sample_count
        if spp is not None and first_sample + spp > MOST_SAMPLES:
            raise OptionError(f"sample {first_sample + spp - 1} is beyond the last, {MOST_SAMPLES - 1}")
        rules = StopRules(
            spp=spp,
            seconds=math.inf if seconds is None else seconds,
            noise=0.0 if noise is None else noise,
            adaptive=noise is not None if adaptive is None else adaptive,
            most=MOST_SAMPLES - first_sample,
        )
        seed = scene.core.seed if seed is None else seed
        if cluster is not None:
            from lajolla.cluster import ClusterRendering  # here, as it takes long

            return ClusterRendering(
                scene.core,
                scene.description.core,
                cluster=cluster,
                mixed=mixed,
                rules=rules,
                seed=seed,
                threads=threads,
                film=scene.film,
                first_sample=first_sample,
            )
        threads = available_threads() if threads is None else threads
        if spp is not None and spp < 2 and VARIANCE in scene.aovs:
            raise OptionError("the aov 'variance' needs at least two samples per pixel")
        return Rendering(
            scene.core,
            scene.description.core,
            rules=rules,
            seed=seed,
            threads=threads,
            film=scene.film,
            first_sample=first_sample,
            layers=scene._object_layers(seed, first_sample, threads),
        )

    def _warn_of_lost_shadows(self) -> None:
        if not self.film.has_alpha and has_shadows(self.with_aovs([ALPHA]).core.channels):
            message = "the shadows on shadow catchers are lost, because the picture has no alpha"
            warn(ImageWarning(f"{message}; render the aov {ALPHA!r} too"))

    def _object_layers(self, seed: int, first_sample: int, threads: int) -> ObjectLayers:
        known, core = self.description.objects, self.description.core
        return ObjectLayers(self.core, self.aovs, known, core, seed, first_sample, threads)

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
        sensor: int | str | None = None,
        aovs: Sequence[str] = (),
        cluster: str | Client | None = None,
        mixed: bool = False,
        progress: Callable[[Progress], None] | None = None,
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
            sensor: number or id of the sensor to look through; see `with_sensor`.
            aovs: variables to render beside the picture; see `with_aovs`.
            cluster: renders on the workers of a Dask scheduler, such as `"tcp://host:8786"`, or of a
                `distributed.Client`; or in so many processes of this machine, such as `"local:4"`. The
                picture is the same. Raises ClusterError.
            mixed: permits workers with another instruction set; the picture may then differ in the last bits.
            progress: called with the progress about ten times a second; an exception of it ends the render.
            denoise: removes noise with the help of `features`; see `Image.denoise`. If that fails, the
                picture is returned as rendered, with an ImageWarning. The progress is 0 during `features`.

        Raises:
            DenoiseError: `denoise` is set, and Open Image Denoise is not installed.
            OptionError: an option is out of range, or the integrator shows no light to denoise.
        """
        check_flag("denoise", denoise)
        if denoise:
            check_available()
        scene = (self if sensor is None else self.with_sensor(sensor)).with_aovs(aovs)
        rendering = scene.rendering(
            spp=spp,
            seconds=seconds,
            noise=noise,
            adaptive=adaptive,
            seed=seed,
            threads=threads,
            cluster=cluster,
            mixed=mixed,
        )
        features = None
        if denoise:
            waiting = Progress(0.0, 0.0, rendering.rules)
            report = (lambda _: progress(waiting)) if progress else None
            features = scene.features(seed=seed, threads=threads, progress=report)
        rendering.run(progress)
        image = rendering.image()
        if features is None:
            return image
        try:
            return image.denoise(features, threads=threads)
        except DenoiseError as problem:
            warn(ImageWarning(f"{problem}; the picture is as rendered"))
            return image

    async def render_async(
        self,
        *,
        progress: Callable[[Progress], None] | None = None,
        **options: Any,  # noqa: ANN401
    ) -> Image:
        """Renders in another thread, while the event loop goes on; options and errors are those of `render`.

        `progress` is called in that thread. Cancelling the task stops the render, and its picture is lost.

        Example:
            >>> image = await scene.render_async(spp=64)
            >>> image = await asyncio.wait_for(scene.render_async(spp=10000), timeout=5)
        """

        def work(checkpoint: Callable[[], None]) -> Image:
            def observe(state: Progress) -> None:
                checkpoint()
                if progress is not None:
                    progress(state)

            return self.render(progress=observe, **options)

        return await in_thread(work)

    @names_checked
    def features(
        self,
        *,
        seed: int | None = None,
        threads: int | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> dict[str, FloatImage]:
        """What `Image.denoise` should know of the picture: "albedo.R", ..., "normal.z", by their names, and
        "holdout.C" if there are holdouts.

        They show the first surface that is neither a mirror nor glass, with little noise; see
        docs/denoising.md. Raises OptionError if the integrator shows no light.
        """
        seed, threads = check("seed", seed), check("threads", threads)
        output = features_output(self.description.core["integrator"])
        rendering = Rendering(
            self.core.with_output(output),
            {**self.description.core, **output},
            rules=StopRules(spp=FEATURE_SAMPLES),
            seed=self.core.seed if seed is None else seed,
            threads=available_threads() if threads is None else threads,
        )
        rendering.run(progress)
        image = rendering.image()
        result = {
            **dict(zip(LAYERS["albedo"], np.moveaxis(image.array, 2, 0), strict=True)),
            **image.channels,
        }
        held_out = holes.held_out(self.core, self.description.core, rendering.threads)
        return result if held_out is None else {**result, HELD_OUT: held_out.astype(np.float32)}

    @names_checked
    def radiance(self, x: int, y: int, sample: int | None = None, *, seed: int | None = None) -> NDArray[Any]:
        """The value of one sample of pixel (x, y), or the mean of all samples: three numbers, float64.

        x and y count from the top left corner of the film, with or without a crop window. Unlike in a
        picture, values that are not finite are kept. Raises OptionError outside of the picture.
        """
        (x, y), sample, seed = check("pixel", (x, y)), check("sample", sample), check("seed", seed)
        left, top = self.core.crop_offset
        if not (left <= x < left + self.width and top <= y < top + self.height):
            begin = f", which begins at {left},{top}" if left or top else ""
            raise OptionError(f"pixel {x},{y} is outside of the picture, {self.width} x {self.height}{begin}")
        seed = self.core.seed if seed is None else seed
        samples = range(self.core.sample_count) if sample is None else [sample]
        values = [_core.sample_radiance(self.core, seed, x, y, index) for index in samples]
        return np.mean(np.asarray(values, np.float64), axis=0)


def _in_view(path: str) -> str:
    """The path of a sensor's parameter when it is in use; a sensor without an id is named by its number."""
    name, _, param = str(path).rpartition(".")
    return f"sensor.{param}" if name.isdecimal() else path


def _output_of(core: Mapping[str, Any]) -> dict[str, Any]:
    return {key: core[key] for key in OUTPUT if key in core}
