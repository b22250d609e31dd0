"""The viewer's render loop: a thread that renders one view of the scene after the other."""

from __future__ import annotations

import os
import re
import threading
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from lajolla import _core
from lajolla.aovs import IDS
from lajolla.colour import FloatImage
from lajolla.limits import OptionError
from lajolla.loaded_scene import Scene
from lajolla.messages import LajollaWarning
from lajolla.params import ParamError
from lajolla.picture_files import ImageError
from lajolla.render import Progress, RenderCancelled, StopRules
from lajolla.scene import SceneError
from lajolla.viewer.facts import depth, scene_facts, view_facts
from lajolla.viewer.pace import Pace
from lajolla.viewer.protocol import Message
from lajolla.viewer.shown import Listener, Shown
from lajolla.viewer.view import View

ALWAYS = 1e-9  # a relative error that is never reached; with it, errors are estimated
INTERVALS = (0.1, 2.0)  # seconds between two pictures of the same view, at least and at most

FILE_NAME = re.compile(r"(?!\.)[^/\\\x00-\x1f\x7f]+\.xml", re.IGNORECASE)  # in the same folder, not hidden

Load: TypeAlias = Callable[["str | None"], Scene]
REFUSALS = (SceneError, OptionError, ParamError, ImageError, _core.DescriptionError)
OF_SENSOR = ("sensor.", "film.", "rfilter.", "sampler.")  # beginnings of parameters that each sensor has


class Session(Shown):
    """Renders a scene in a thread of its own, and tells a listener what there is to show.

    Args:
        load: reads the scene, with the integrator of a name if one is given.
        rules: when the render of the picture ends. Without a number of samples: the scene's.
        threads: of the renderer.
        listener: called in the render's thread, with pictures and with messages for the page.
        folder: where the page may save the scene.

    Attributes:
        sensor: the name of the one that is looked through.
        opened: is set when the scene was read for the first time, or could not be: then `failure` says why.
    """

    def __init__(
        self, load: Load, rules: StopRules, threads: int, listener: Listener, folder: Path | None = None
    ) -> None:
        super().__init__(listener)
        self.load, self.rules, self.threads = load, rules, threads
        self.folder = folder or Path()
        self.sensor = ""
        self._of_others: dict[str, dict[str, Any]] = {}  # changes of other sensors
        self.opened = threading.Event()
        self.failure: Exception | None = None
        self._paused = False
        self._closed = False
        self._pace = Pace()
        self._seen = False  # whether there is a picture of the present view and layer
        self._changed = threading.Condition()
        self._pending: list[Message] = []
        self._running: _core.Render | None = None  # what a new message cancels
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
        """Makes a change, from any thread. A view ends at once if there is a picture of it."""
        with self._changed:
            self._pending.append(message)
            if self._running is not None:
                self._running.cancel()
            self._changed.notify()

    # --- changes ------------------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._open({})
        except Exception as problem:
            self.failure = problem
        self.opened.set()
        while not self._closed:
            is_done = self.view is None or self._paused or self._render(self.view)
            with self._changed:
                if is_done:
                    self._changed.wait_for(lambda: self._pending)
                messages, self._pending = merged(self._pending), []
            for message in messages:
                self._handle(message)

    def _handle(self, message: Message) -> None:
        """Calls the function for a type of message: `_edit` for "edit"."""
        try:
            with warnings.catch_warnings(record=True) as found:
                warnings.simplefilter("always", LajollaWarning)
                getattr(self, f"_{message.type}")(message)
            for warning in found:
                self.tell("noticed", message=str(warning.message))
        except REFUSALS as problem:
            self.tell("refused", message=str(problem))
        except Exception as problem:  # a fault of ours: the viewer goes on with the scene that it has
            self.tell("refused", message=f"{type(problem).__name__}: {problem}")

    def _open(self, changes: Mapping[str, Any]) -> None:
        """Reads the scene, and makes these changes, as far as it has such parameters."""
        scene = self.load(self.integrator)
        for sensor, own in self._of_others.items():
            if sensor in scene.sensors:
                scene = _with_changes(scene.with_sensor(sensor), own)[0]
        if self.chosen_sensor in scene.sensors:
            scene = scene.with_sensor(str(self.chosen_sensor))
        scene, self.changes = _with_changes(scene, changes)
        self._show_scene(scene)

    def _show_scene(self, scene: Scene) -> None:
        """Begins a view of another scene, or through another sensor."""
        self.sensor = scene.sensor
        self._look_at(scene)
        assert self.view is not None
        self.tell("opened", **scene_facts(self.view, self.layer))

    def _reload(self, message: Message) -> None:
        """Reads the scene again, one of whose files was changed.

        Cameras stay where they are, and if it was no scene file, everything stays that was changed.
        """
        whole, others = not message["is_scene"], self._of_others
        try:
            self._of_others = {name: _kept(own, whole) for name, own in self._of_others.items()}
            self._open(_kept(self.changes, whole))
        except Exception as problem:
            self._of_others = others
            self.tell("failed", message=f"the scene could not be read: {problem}")

    def _choose(self, message: Message) -> None:
        """Another integrator."""
        before, self.integrator = self.integrator, message["integrator"]
        try:
            self._open(self.changes)
        except Exception:
            self.integrator = before
            raise

    def _look(self, message: Message) -> None:
        """Looks through another sensor; what was changed of either one stays with it."""
        scene, before = self._scene(), self.sensor
        changed = scene.with_sensor(message["sensor"])
        own = {path: value for path, value in self.changes.items() if path.startswith(OF_SENSOR)}
        shared = {path: value for path, value in self.changes.items() if path not in own}
        if changed is not scene:
            self._of_others[before] = own
            self.changes = {**shared, **self._of_others.pop(changed.sensor, {})}
            self.chosen_sensor = changed.sensor
        self._show_scene(changed)

    def _save(self, message: Message) -> None:
        """Saves the scene as a new file in its folder."""
        name = message["name"]
        if not FILE_NAME.fullmatch(name):
            raise OptionError(f"{name!r} is no name of a file beside the scene: NAME.xml")
        target = self.folder / name
        if os.path.lexists(target):
            raise OptionError(f"{name} exists; choose another name")
        self._scene().save(target)
        self.tell("noticed", message=f"wrote {target}")

    def _look_at(self, scene: Scene) -> None:
        """Begins another view."""
        number = 0 if self.view is None else self.view.number + 1
        self.view = View(scene, number, self._rules(scene), self.threads)
        self._seen = False
        self.state.pop("failed", None)
        self.tell("viewed", **view_facts(self.view))

    def _rules(self, scene: Scene) -> StopRules:
        """When the render of the picture ends: by itself if nothing was asked for."""
        if self.rules.spp is None and self.rules.noise <= ALWAYS:
            return replace(self.rules, spp=scene.core.sample_count)
        return self.rules

    def _change(self, values: Mapping[str, Any]) -> None:
        scene = self._scene().with_params(values)
        self.changes |= values
        self._look_at(scene)

    def _scene(self) -> Scene:
        if self.view is None:
            raise OptionError("the scene is not open")
        return self.view.scene

    def _edit(self, message: Message) -> None:
        self._change(message["values"])

    def _crop(self, message: Message) -> None:
        left, top, width, height = message["window"] or (0, 0, 0, 0)
        size = {"film.crop_width": width, "film.crop_height": height}
        self._change({"film.crop_offset_x": left, "film.crop_offset_y": top, **size})

    def _focus(self, message: Message) -> None:
        scene = self._scene()
        if "sensor.focus_distance" not in scene.params:
            raise OptionError("the camera has no lens: only thinlens and telecentric have a focus")
        found = depth(scene, message["x"], message["y"])
        if found is None:
            raise OptionError("there is nothing to focus on")
        self._change({"sensor.focus_distance": found})

    def _show(self, message: Message) -> None:
        name = message["layer"]
        if self.view is not None and name and name not in self.view.layers:
            raise OptionError(f"there is no layer {name!r}")
        self._seen = self._seen and self.layer == name
        self.layer = name

    def _limit(self, message: Message) -> None:
        self.rules = replace(self.rules, spp=message["samples"])
        if self.view is not None:
            self.view.limit(self._rules(self.view.scene))

    def _pause(self, message: Message) -> None:
        self._paused = True
        self.tell_progress("paused")

    def _resume(self, message: Message) -> None:
        self._paused = False

    # --- rendering ----------------------------------------------------------------------------------------

    def _render(self, view: View) -> bool:
        """Renders until a stop rule is met, or something changes; False if it was cancelled."""
        try:
            if not self._seen:
                self._preview(view)
            if not (self._seen and self._pending):
                self._accumulate(view)
        except RenderCancelled:  # now, or by a message that came between two passes
            return False
        except Exception as problem:
            self.tell("failed", message=f"the render ended: {type(problem).__name__}: {problem}")
        finally:
            with self._changed:
                self._running = None
        return True

    def _preview(self, view: View) -> None:
        """Pictures with few pixels; the first one is shown even if the view has changed meanwhile."""
        for divisor in self._pace.divisors(self.layer, view.scene.width * view.scene.height):
            if self._seen and self._pending:
                return
            start = time.perf_counter()
            begun = self._cancellable if self._seen else lambda render: None
            pixels = view.preview(self.layer, divisor, begun)
            if pixels is None:
                return
            self._pace.measure(self.layer, pixels.shape[0] * pixels.shape[1], time.perf_counter() - start)
            self._publish(view, pixels)

    def _accumulate(self, view: View) -> None:
        layer = self.layer
        if layer in IDS:
            self._publish(view, view.picture(layer))
            return self.tell_progress("finished")
        rendering = view.rendering(layer)
        start = shown = time.perf_counter()
        pixels, before = view.scene.width * view.scene.height, rendering.samples
        if self._seen:
            self._cancellable(rendering.accumulator)

        def observe(progress: Progress) -> None:
            nonlocal shown
            now = time.perf_counter()
            due = now - shown > min(max(INTERVALS[0], (now - start) / 8), INTERVALS[1])
            if (due or not self._seen) and rendering.accumulator.counts.min() > 0:
                self._pace.measure(layer, (rendering.samples - before) * pixels, now - start)
                self._publish(view, view.picture(layer))
                self._cancellable(rendering.accumulator)
                shown = now
            self.tell_progress("rendering", progress)

        rendering.run(observe)
        self._publish(view, view.picture(layer))
        return self.tell_progress("finished")

    def _publish(self, view: View, pixels: FloatImage) -> None:
        self._seen = True
        self.publish(view, pixels)

    def _cancellable(self, render: _core.Render) -> None:
        """Lets messages cancel a render from now on; it is cancelled at once if there is one already."""
        with self._changed:
            self._running = render
            if self._pending:
                render.cancel()


def _with_changes(scene: Scene, changes: Mapping[str, Any]) -> tuple[Scene, dict[str, Any]]:
    """A scene with those changes that it has parameters for, and these."""
    known = {path: value for path, value in changes.items() if path in scene.params}
    return scene.with_params(known) if known else scene, known


def _kept(changes: Mapping[str, Any], whole: bool) -> dict[str, Any]:
    """The changes that stay: all, or those of the camera."""
    return {path: value for path, value in changes.items() if whole or path.startswith("sensor.")}


def merged(messages: list[Message]) -> list[Message]:
    """The same changes, with edits that follow each other as one."""
    result: list[Message] = []
    for message in messages:
        if result and message.type == result[-1].type == "edit":
            values = {**result.pop()["values"], **message["values"]}
            message = Message("edit", {"values": values})
        result.append(message)
    return result
