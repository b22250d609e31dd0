"""The command `lajolla view`: joins the render loop and the server."""

from __future__ import annotations

import argparse
import asyncio
import io
import os
import webbrowser
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TypeAlias

from lajolla.display import say
from lajolla.image import Image
from lajolla.interrupts import end_at_once, handled_by
from lajolla.limits import OptionError
from lajolla.loaded_scene import Scene
from lajolla.params import ParamError
from lajolla.render import StopRules, available_threads
from lajolla.tev import Tev, channels_of
from lajolla.viewer.facts import inspected, objects_found, parameters_of
from lajolla.viewer.protocol import Message, Picture, bands, event
from lajolla.viewer.replay import command_for
from lajolla.viewer.server import Answer, Handlers, ViewServer
from lajolla.viewer.session import ALWAYS, Session
from lajolla.viewer.view import View

WATCH_SECONDS = 0.5  # between two looks at the scene's file
Stamp: TypeAlias = tuple[int, int] | None  # when a file was changed, and its size; None: it is not there
BINARY = "application/octet-stream"


class Viewer:
    """A render loop and a server.

    Args:
        load: reads the scene, with the integrator of a name if one is given.
        arguments: the command line that named the scene.
        reference: a picture to compare with.
        tev: shows the pictures too.
    """

    def __init__(
        self,
        load: Callable[[str | None], Scene],
        arguments: argparse.Namespace,
        reference: Image | None = None,
        tev: Tev | None = None,
    ) -> None:
        self.arguments = arguments
        self.reference = reference
        self.tev = tev
        self.file: Path | None = None if str(arguments.scene) == "-" else arguments.scene
        self.server = ViewServer(Handlers(self._received, self._download, self._greeting), arguments.port)
        rules = StopRules(spp=arguments.spp, noise=arguments.noise or ALWAYS, adaptive=False)
        threads = arguments.threads or available_threads()
        folder = self.file.parent if self.file else Path()
        self.session = Session(load, rules, threads, self._publish, folder)

    @property
    def name(self) -> str:
        """What pages call the scene."""
        return self.file.name if self.file else "scene"

    async def run(self, announce: Callable[[str], None]) -> None:
        """Serves until it is cancelled; calls `announce` with the address when the scene is open.

        Raises what `load` raises, and OSError if the port is taken.
        """
        self.loop = asyncio.get_running_loop()
        await self.server.start()
        self.session.start()
        await asyncio.to_thread(self.session.opened.wait)
        if self.session.failure is not None:
            raise self.session.failure
        announce(self.server.address)
        await self._watch()

    def _publish(self, item: Picture | str) -> None:
        view, layer = self.session.view, self.session.layer
        if self.tev is not None and view is not None and isinstance(item, Picture) and item.is_whole:
            image = Image(item.pixels)
            shown = image if layer else view.rendering("").mean()
            self.tev.offer(self.name, lambda: channels_of(shown))
        self.loop.call_soon_threadsafe(self.server.publish, item)

    def _greeting(self) -> list[Picture | str]:
        latest = [self.session.latest] if self.session.latest else []
        return [
            event(
                "hello", file=self.name, folder=str(self.session.folder), reference=self.reference is not None
            ),
            *self.session.state.values(),
            *latest,
        ]

    async def _received(self, message: Message) -> str | None:
        """Answers questions, in another thread; everything else is for the render loop."""
        if message.type not in QUESTIONS:
            self.session.post(message)
            return None
        view = self.session.view
        if view is None:
            return None
        try:
            return await asyncio.to_thread(QUESTIONS[message.type], self, view, message)
        except (OptionError, ParamError) as problem:
            return event("refused", message=str(problem))

    def _inspect(self, view: View, message: Message) -> str:
        x, y = message["x"], message["y"]
        session = self.session
        command = command_for(
            self.arguments, session.integrator, session.chosen_sensor, session.changes, x, y
        )
        return event("inspected", **inspected(view, x, y), command=command)

    def _objects(self, view: View, message: Message) -> str:
        return event("objects", **objects_found(view.scene, message["search"]))

    def _parameters(self, view: View, message: Message) -> str:
        return event("parameters", **parameters_of(view.scene, message["object"]))

    async def _download(self, name: str) -> Answer | None:
        view = self.session.view
        if name == "picture.exr" and view is not None:
            return await asyncio.to_thread(_saved, view)
        if name == "reference" and self.reference is not None:
            return BINARY, self._reference_bands(self.reference)
        return None

    @staticmethod
    def _reference_bands(image: Image) -> bytes:
        """The picture to compare with, as it would come over the WebSocket in one message."""
        height, width, _ = image.array.shape
        picture = Picture(image.array, 0, 0, (0, 0, width, height))
        return b"".join(bands(picture, rows=height))

    async def _watch(self) -> None:
        """Reads the scene again whenever one of its files changes."""
        known: dict[Path, Stamp] = {}
        while True:
            view = self.session.view
            files = (view.scene.paths if view else set()) | ({self.file} if self.file else set())
            changed = await asyncio.to_thread(changed_files, files, known)
            if changed:
                is_scene = any(path == self.file or path.suffix.lower() == ".xml" for path in changed)
                self.session.post(Message("reload", {"is_scene": is_scene}))
            await asyncio.sleep(WATCH_SECONDS)


def changed_files(files: Iterable[Path], known: dict[Path, Stamp]) -> list[Path]:
    """The files that differ from what is known of them, which is brought up to date.

    One that cannot be read may just be replaced: it has changed when it can be read again.
    """
    changed = []
    for path in files:
        try:
            status = os.stat(path)
            now: Stamp = (status.st_mtime_ns, status.st_size)
        except OSError:
            known.setdefault(path, None)
            continue
        if known.setdefault(path, now) != now:
            changed.append(path)
        known[path] = now
    return changed


QUESTIONS = {"inspect": Viewer._inspect, "objects": Viewer._objects, "parameters": Viewer._parameters}


def _saved(view: View) -> Answer:
    """The picture so far as an EXR file, with its channels."""
    stream = io.BytesIO()
    view.rendering("").image().save(stream, format="exr")
    return "image/x-exr", stream.getvalue()


def view(arguments: argparse.Namespace, load: Callable[[], Scene]) -> int:
    """Runs `lajolla view` until Ctrl-C; prints the address and opens it in the browser."""
    reference = Image.open(arguments.compare) if arguments.compare is not None else None
    tev = None if arguments.tev is None else Tev(arguments.tev, lambda text: say(f"warning: {text}"))
    own = arguments.integrator

    def load_with(integrator: str | None) -> Scene:
        arguments.integrator = integrator or own
        try:
            return load()
        finally:
            arguments.integrator = own

    def announce(address: str) -> None:
        print(address, flush=True)
        if not arguments.no_browser:
            webbrowser.open(address)

    with handled_by(partial(end_at_once, message="the viewer has ended")):
        asyncio.run(Viewer(load_with, arguments, reference, tev).run(announce))
    return 0
