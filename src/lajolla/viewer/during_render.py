"""The page of `lajolla render --view`: it shows a render while it goes on, and changes nothing of it."""

from __future__ import annotations

import argparse
import asyncio
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager

from lajolla.display import say
from lajolla.loaded_scene import Scene
from lajolla.render import Progress, Rendering
from lajolla.viewer.facts import scene_facts, view_facts
from lajolla.viewer.pages import Pages
from lajolla.viewer.protocol import Message
from lajolla.viewer.session import INTERVALS
from lajolla.viewer.shown import Listener, Shown
from lajolla.viewer.view import View, layers_of, of_layer

REFUSAL = "this page shows a render of the command line, which stays as it is; lajolla view changes scenes"
FAREWELL_SECONDS = 5.0  # that pages have to take the last picture


class Watched(Shown):
    """A render of the command line; `observe` is called while it goes on."""

    is_fixed = True

    def __init__(self, scene: Scene, rendering: Rendering, listener: Listener) -> None:
        super().__init__(listener)
        self.rendering = rendering
        self.view = View(scene, 0, rendering.rules, rendering.threads, {"": rendering})
        self._begun = self._shown = time.perf_counter()
        self._lock = threading.Lock()  # pages ask for layers in another thread
        self._layers = layers_of(rendering.channels)
        self._state = "rendering"

    def _rendering(self) -> Rendering:
        return self.rendering

    def open(self) -> None:
        """Tells of the scene; call it when the listener can be called."""
        assert self.view is not None
        self.tell("viewed", **view_facts(self.view))
        self.tell("opened", **{**scene_facts(self.view, ""), "layers": self._layers, "sensors": []})

    def observe(self, progress: Progress) -> None:
        """Shows the picture if it is time for another one."""
        now = time.perf_counter()
        due = now - self._shown > min(max(INTERVALS[0], (now - self._begun) / 8), INTERVALS[1])
        if due or self.latest is None:
            self._shown = now
            self.show()
        self.tell_progress(self._state, progress)

    def show(self) -> None:
        """Shows the picture so far, if there is one."""
        assert self.view is not None
        with self._lock:
            counts = self.rendering.accumulator.pixel_counts()
            if counts.max() > 0:
                means = self.rendering.accumulator.image()
                self.publish(self.view, of_layer(means, self.layer, self.rendering.channels, counts))

    def end(self, message: str) -> None:
        """Shows the last picture, and tells how the render ended."""
        self._state = "finished"
        self.show()
        self.tell_progress(self._state)
        self.tell("ended", message=message)

    def post(self, message: Message) -> None:
        if message.type != "show" or not (message["layer"] == "" or message["layer"] in self._layers):
            self.tell("refused", message=REFUSAL)
            return
        self.layer = message["layer"]
        self.show()
        self.tell_progress(self._state)


@contextmanager
def page_of_render(
    scene: Scene, rendering: Rendering, arguments: argparse.Namespace, written: Sequence[str]
) -> Iterator[Callable[[Progress], None]]:
    """Serves a page within the block; yields what is to be called with the progress of the render.

    Args:
        written: at the end of the block, the names of the pictures that were written.

    Raises:
        OSError: the port cannot be used.
    """
    pages = Pages(arguments, lambda listener: Watched(scene, rendering, listener))
    address: Future[str] = Future()
    ended = threading.Event()
    thread = threading.Thread(target=lambda: asyncio.run(_serve(pages, address, ended)), daemon=True)
    thread.start()
    say(f"the page is {address.result()}")
    pages.session.open()
    if not arguments.no_browser:
        webbrowser.open(address.result())
    try:
        yield pages.session.observe
    finally:
        names = ", ".join(written)
        pages.session.end(f"The render has ended{f'; wrote {names}' if names else ' without a picture'}.")
        ended.set()
        thread.join()


async def _serve(pages: Pages[Watched], address: Future[str], ended: threading.Event) -> None:
    """Serves until the render has ended, and pages have its picture."""
    try:
        address.set_result(await pages.start())
    except Exception as problem:
        address.set_exception(problem)
        return
    await asyncio.to_thread(ended.wait)
    end = time.monotonic() + FAREWELL_SECONDS
    while not pages.server.is_idle and time.monotonic() < end:
        await asyncio.sleep(0.02)
