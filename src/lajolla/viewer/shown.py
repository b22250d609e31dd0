"""What pages are shown: the pictures of one view, and messages about it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from lajolla.colour import FloatImage
from lajolla.render import Progress, Rendering
from lajolla.viewer.protocol import Message, Picture, event
from lajolla.viewer.view import View, limits_of

OF_THE_MOMENT = ("refused", "noticed")  # messages that are not repeated to pages that come later

Listener: TypeAlias = Callable[["Picture | str"], None]


class Shown:
    """A view that is rendered.

    Args:
        listener: called with pictures, and with messages for the page, in the thread that makes them.

    Attributes:
        view: what is rendered; None until there is a scene.
        layer: of it that is shown; "" is the picture.
        latest: the last picture.
        state: the last message of each type, for a page that comes later.
        changes: parameters that were changed in pages, by path; those of other sensors are not among them.
        integrator, chosen_sensor: that were chosen in pages instead of those of the command line.
        is_fixed: whether pages can change nothing.
    """

    is_fixed = False

    def __init__(self, listener: Listener) -> None:
        self.listener = listener
        self.view: View | None = None
        self.layer = ""
        self.latest: Picture | None = None
        self.state: dict[str, str] = {}
        self.changes: dict[str, Any] = {}
        self.integrator: str | None = None
        self.chosen_sensor: str | None = None
        self._pictures = 0

    def post(self, message: Message) -> None:
        """Takes a message of a page that changes something, in any thread."""
        raise NotImplementedError

    def _rendering(self) -> Rendering | None:
        """The render of the layer."""
        return None if self.view is None else self.view.rendering(self.layer)

    def publish(self, view: View, pixels: FloatImage) -> None:
        """Shows a picture of the layer."""
        self._pictures += 1
        limits = limits_of(self.layer, pixels)
        self.latest = Picture(pixels, self._pictures, view.number, view.window, limits)
        self.listener(self.latest)

    def tell(self, type: str, **fields: object) -> None:
        """Sends a message."""
        text = event(type, **fields)
        if type not in OF_THE_MOMENT:
            self.state[type] = text
        self.listener(text)

    def tell_progress(self, state: str, progress: Progress | None = None) -> None:
        """Tells how far the render of the layer is; `state` is "rendering", "finished" or "paused"."""
        rendering = self._rendering()
        if self.view is None or rendering is None:
            return
        progress = progress or Progress(
            rendering.samples, rendering.seconds, rendering.rules, rendering.noise
        )
        seconds = max(rendering.seconds, 1e-9)
        pixels = self.view.scene.width * self.view.scene.height
        self.tell(
            "progress",
            state=state,
            picture=self._pictures,  # the last one; it may come later than this message
            fraction=progress.fraction,
            samples=progress.samples,
            limit=rendering.rules.spp,
            seconds=seconds,
            seconds_left=progress.seconds_left,
            samples_per_second=progress.samples * pixels / seconds,
            rays_per_second=float(np.sum(rendering.accumulator.rays)) / seconds,
            noise=rendering.noise,
            nonfinite=rendering.accumulator.nonfinite,
        )
