"""The pages of the viewer: what they are sent, and the answers to their questions."""

from __future__ import annotations

import argparse
import asyncio
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

from lajolla.image import Image
from lajolla.limits import OptionError
from lajolla.params import ParamError
from lajolla.tev import Tev, channels_of
from lajolla.viewer.facts import inspected, objects_found, parameters_of
from lajolla.viewer.protocol import Message, Picture, bands, event
from lajolla.viewer.replay import command_for
from lajolla.viewer.server import Answer, Handlers, ViewServer
from lajolla.viewer.shown import Listener, Shown
from lajolla.viewer.view import View

BINARY = "application/octet-stream"
Made = TypeVar("Made", bound=Shown)


class Pages(Generic[Made]):
    """The pages that show something: their server, and the answers to what they ask.

    Args:
        arguments: the command line that named the scene.
        make: returns what they show, for a listener.
        reference: a picture to compare with.
        tev: shows the pictures too.
    """

    def __init__(
        self,
        arguments: argparse.Namespace,
        make: Callable[[Listener], Made],
        reference: Image | None = None,
        tev: Tev | None = None,
    ) -> None:
        self.arguments = arguments
        self.reference = reference
        self.tev = tev
        self.file: Path | None = None if str(arguments.scene) == "-" else arguments.scene
        self.server = ViewServer(Handlers(self._received, self._download, self._greeting), arguments.port)
        self.session = make(self._publish)

    @property
    def name(self) -> str:
        """What pages call the scene."""
        return self.file.name if self.file else "scene"

    async def start(self) -> str:
        """Begins to serve; the address. Raises OSError if the port cannot be used."""
        self.loop = asyncio.get_running_loop()
        await self.server.start()
        return self.server.address

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
                "hello",
                file=self.name,
                folder=str(self.file.parent if self.file else "."),
                reference=self.reference is not None,
                fixed=self.session.is_fixed,
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


Question = Callable[["Pages[Any]", View, Message], str]
QUESTIONS: dict[str, Question] = {
    "inspect": Pages._inspect,
    "objects": Pages._objects,
    "parameters": Pages._parameters,
}


def _saved(view: View) -> Answer:
    """The picture so far as an EXR file, with its channels."""
    stream = io.BytesIO()
    view.rendering("").image().save(stream, format="exr")
    return "image/x-exr", stream.getvalue()
