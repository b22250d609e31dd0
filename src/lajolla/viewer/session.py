"""The viewer's render loop: a thread that renders one view of the scene after the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from lajolla import _core
from lajolla.limits import OptionError
from lajolla.loading import Scene
from lajolla.render import Progress, StopRules
from lajolla.scene import SceneError
from lajolla.viewer.protocol import Message, Picture, event
from lajolla.viewer.view import View, limits_of

FIRST_SECONDS = 0.03  # that the first picture of a view may take
DIRECT_SECONDS = 0.2  # a picture with all pixels that takes less needs no previews between
UNKNOWN_DIVISOR = 8  # of the first preview, before the speed is known
MOST_DIVISOR = 32
INTERVALS = (0.1, 2.0)  # seconds between two pictures of the same view, at least and at most

Listener: TypeAlias = Callable[["Picture | str"], None]
REFUSALS = (SceneError, OptionError, _core.DescriptionError)


class Session:
    """Renders a scene in a thread of its own, and tells a listener what there is to show.

    Messages may be posted from any thread. The listener is called in the render's thread, with pictures and with
    messages for the page. `state` has the last message of each type, for a page that comes later.
    """

    def __init__(self, load: Callable[[], Scene], rules: StopRules, threads: int, listener: Listener) -> None:
        self.load = load
        self.rules = rules
        self.threads = threads
        self.listener = listener
        self.state: dict[str, str] = {}
        self.latest: Picture | None = None
        self.view: View | None = None
        self.layer = ""
        self.paused = False
        self._camera: dict[str, Any] = {}  # edits of the camera, which a scene that is read again gets too
        self._pending: list[Message] = []
        self._changed = threading.Condition()
        self._running: _core.Render | None = None  # what a new message cancels
        self._closed = False
        self._pictures = 0
        self._rates: dict[str, float] = {}  # samples per second of layers
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)

    def start(self) -> None:
        """Reads the scene and renders it."""
        self._thread.start()

    def close(self) -> None:
        """Ends the render."""
        self._closed = True
        self.post(Message("pause", {}))
        self._thread.join()

    def post(self, message: Message) -> None:
        """A change, which interrupts the render as soon as the present view has been seen."""
        with self._changed:
            self._pending.append(message)
            if self._running is not None:
                self._running.cancel()
            self._changed.notify()

    # --- the thread ---------------------------------------------------------------------------------------

    def _run(self) -> None:
        self._open()
        while not self._closed:
            if not self.paused and self.view is not None:
                self._render(self.view)
            with self._changed:
                self._changed.wait_for(lambda: self._pending)
                messages, self._pending = merged(self._pending), []
            for message in messages:
                self._handle(message)

    def _open(self) -> None:
        """Reads the scene, again if there is one already; the camera stays where it is."""
        try:
            scene = self.load()
            self._look_at(with_values(scene, self._camera) if self._camera else scene)
        except Exception as problem:
            self._tell("failed", message=f"the scene cannot be opened: {problem}")
            return
        self._tell("opened", **scene_facts(self.view))

    def _handle(self, message: Message) -> None:
        try:
            getattr(self, f"_on_{message.type}")(message)
        except REFUSALS as problem:
            self._tell("refused", message=str(problem))

    def _on_edit(self, message: Message) -> None:
        values = message["values"]
        self._look_at(with_values(self._scene, values))
        self._camera |= {path: value for path, value in values.items() if path.startswith("sensor.")}

    def _on_layer(self, message: Message) -> None:
        name = message["name"]
        if self.view is not None and name and name not in self.view.layers:
            raise OptionError(f"there is no layer {name!r}")
        self.layer = name

    def _on_samples(self, message: Message) -> None:
        self.rules = replace(self.rules, spp=message["limit"])
        if self.view is not None:
            self.view.rendering("").rules = self.view.rules = self.rules

    def _on_pause(self, message: Message) -> None:
        self.paused = True
        self._tell_progress("paused")

    def _on_resume(self, message: Message) -> None:
        self.paused = False

    def _on_reload(self, message: Message) -> None:
        self._open()

    @property
    def _scene(self) -> Scene:
        if self.view is None:
            raise OptionError("the scene is not open")
        return self.view.scene

    def _look_at(self, scene: Scene) -> None:
        """Begins another view."""
        number = 0 if self.view is None else self.view.number + 1
        self.view = View(scene, number, self.rules, self.threads)
        self._tell("camera", **camera_facts(self.view))

    # --- rendering ----------------------------------------------------------------------------------------

    def _render(self, view: View) -> None:
        """Renders until a stop rule is met, or something changes."""
        self.state.pop("failed", None)
        self._told = self.latest is not None and (self.latest.view, self.latest.layer) == (
            view.number,
            self.layer,
        )
        try:
            self._refine(view)
        except Exception as problem:
            if not self._pending:  # it was not cancelled
                self._tell("failed", message=f"the render ended: {type(problem).__name__}: {problem}")
        finally:
            with self._changed:
                self._running = None

    def _refine(self, view: View) -> None:
        for divisor in [] if self._told else self._divisors(view):
            if self._told and self._pending:
                return
            self._preview(view, divisor)
        if not self._told or not self._pending:
            self._accumulate(view)

    def _divisors(self, view: View) -> list[int]:
        """The previews: the first one is there in FIRST_SECONDS, the others have 16 times as many pixels each."""
        pixels = view.scene.width * view.scene.height
        rate = self._rates.get(self.layer)
        if rate is None:
            return [UNKNOWN_DIVISOR] if pixels > 64 * UNKNOWN_DIVISOR**2 else []
        divisor = 1
        while divisor < MOST_DIVISOR and pixels / divisor**2 > rate * FIRST_SECONDS:
            divisor *= 2
        result = [divisor] if divisor > 1 else []
        while divisor > 4 and pixels / rate > DIRECT_SECONDS:
            divisor //= 4
            result.append(divisor)
        return result

    def _preview(self, view: View, divisor: int) -> None:
        start = time.perf_counter()
        pixels = view.preview(self.layer, divisor)
        self._measure(pixels.shape[0] * pixels.shape[1], time.perf_counter() - start)
        self._show(view, pixels)

    def _measure(self, samples: float, seconds: float) -> None:
        """Notes a speed; a slower one counts at once, a faster one by and by."""
        rate = samples / max(seconds, 1e-6)
        before = self._rates.get(self.layer, rate)
        self._rates[self.layer] = min(rate, 0.5 * (before + rate))

    def _accumulate(self, view: View) -> None:
        layer = self.layer
        if layer in ("shape", "material", "instance", "primitive"):
            self._show(view, view.picture(layer))
            return self._tell_progress("finished")
        rendering = view.rendering(layer)
        if self._told and not self._may_be_cancelled(rendering.accumulator):
            return None
        shown = time.perf_counter()
        start, samples_before = shown, rendering.samples

        def observe(progress: Progress) -> None:
            nonlocal shown
            now = time.perf_counter()
            interval = min(max(INTERVALS[0], (now - start) / 8), INTERVALS[1])
            if rendering.accumulator.counts.min() > 0 and (not self._told or now - shown > interval):
                if samples_before == 0 and not self._told:
                    self._measure(rendering.samples * view.scene.width * view.scene.height, now - start)
                self._show(view, view.picture(layer))
                self._may_be_cancelled(rendering.accumulator)
                shown = now
            self._tell_progress("rendering", progress)

        rendering.run(observe)
        self._show(view, view.picture(layer))
        self._tell_progress("finished")
        return None

    def _may_be_cancelled(self, render: _core.Render) -> bool:
        """Lets new messages cancel a render from now on; False if there is one."""
        with self._changed:
            self._running = render
            if self._pending:
                render.cancel()
            return not self._pending

    def _show(self, view: View, pixels: Any) -> None:  # noqa: ANN401
        self._pictures += 1
        limits = limits_of(self.layer, pixels)
        self.latest = Picture(pixels, self._pictures, view.number, view.window, self.layer, limits)
        self._told = True
        self.listener(self.latest)

    # --- messages -----------------------------------------------------------------------------------------

    def _tell(self, type: str, **fields: object) -> None:
        self.state[type] = event(type, **fields)
        self.listener(self.state[type])

    def _tell_progress(self, state: str, progress: Progress | None = None) -> None:
        if self.view is None:
            return
        rendering = self.view.rendering(self.layer)
        seconds = max(progress.seconds if progress else rendering.seconds, 1e-9)
        samples = progress.samples if progress else rendering.samples
        pixels = self.view.scene.width * self.view.scene.height
        self._tell(
            "progress",
            state=state,
            samples=samples,
            limit=rendering.rules.spp,
            seconds=seconds,
            seconds_left=progress.seconds_left if progress else None,
            samples_per_second=samples * pixels / seconds,
            rays_per_second=float(np.sum(rendering.accumulator.rays)) / seconds,
            noise=rendering.noise,
            nonfinite=rendering.accumulator.nonfinite,
        )


def merged(messages: list[Message]) -> list[Message]:
    """The same changes, with edits that follow each other as one."""
    result: list[Message] = []
    for message in messages:
        if result and message.type == result[-1].type == "edit":
            values = {**result.pop()["values"], **message["values"]}
            message = Message("edit", {"values": values})
        result.append(message)
    return result


def with_values(scene: Scene, values: dict[str, Any]) -> Scene:
    core = {**scene.description.core}
    for path, value in values.items():
        name, _, field = path.rpartition(".")
        core[name] = {**core[name], field: value}
    import copy

    result = copy.copy(scene)
    result.description = replace(scene.description, core=core)
    result.core = _core.Scene(core)
    return result


def scene_facts(view: View | None) -> dict[str, Any]:
    """What a page has to know of a scene."""
    assert view is not None
    scene = view.scene
    return {
        "layers": view.layers,
        "warnings": [str(warning) for warning in scene.warnings],
        "load_seconds": scene.load_seconds,
        "build_seconds": scene.build_seconds,
    }


def camera_facts(view: View) -> dict[str, Any]:
    """What a page has to know of a view."""
    core = view.scene.description.core
    sensor = {name: value for name, value in core["sensor"].items() if name != "medium"}
    return {"view": view.number, "sensor": sensor, "film": core["film"], "integrator": core["integrator"]}
