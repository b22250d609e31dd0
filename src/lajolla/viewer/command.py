"""The command `lajolla view`: joins the render loop and the server."""

from __future__ import annotations

import argparse
import asyncio
import os
import webbrowser
from collections.abc import Callable
from pathlib import Path

from lajolla.loading import Scene
from lajolla.render import StopRules, available_threads
from lajolla.viewer.protocol import Message, Picture, event
from lajolla.viewer.server import Answer, Handlers, ViewServer
from lajolla.viewer.session import Session

NOISE_GOAL = 0.002  # relative error at which a render ends by itself: nobody sees it
WATCH_SECONDS = 0.5  # between two looks at the scene's file


class Viewer:
    """A session and its server.

    Args:
        load: reads the scene.
        file: the scene's file, which is watched; None if there is none.
    """

    def __init__(
        self,
        load: Callable[[], Scene],
        file: Path | None,
        *,
        port: int = 0,
        threads: int | None = None,
        rules: StopRules | None = None,
    ) -> None:
        self.file = file
        self.server = ViewServer(Handlers(self._received, self._download, self._greeting), port)
        rules = rules or StopRules(noise=NOISE_GOAL, adaptive=False)
        self.session = Session(load, rules, threads or available_threads(), self._publish)

    async def run(self, announce: Callable[[str], None]) -> None:
        """Serves until it is cancelled; calls `announce` with the address when it can be opened."""
        self.loop = asyncio.get_running_loop()
        server = await self.server.start()
        self.session.start()
        announce(self.server.address)
        try:
            await self._watch()
        finally:
            server.close()
            self.session.close()

    def _publish(self, item: Picture | str) -> None:
        self.loop.call_soon_threadsafe(self.server.publish, item)

    def _greeting(self) -> list[Picture | str]:
        name = self.file.name if self.file else "scene"
        latest = [self.session.latest] if self.session.latest else []
        return [event("hello", file=name), *self.session.state.values(), *latest]

    async def _received(self, message: Message) -> str | None:
        self.session.post(message)
        return None

    async def _download(self, name: str, options: dict[str, str]) -> Answer | None:
        return None

    async def _watch(self) -> None:
        """Reads the scene again whenever its file changes."""
        before = self._stamp()
        while True:
            await asyncio.sleep(WATCH_SECONDS)
            now = self._stamp()
            if now is not None and now != before:
                self.session.post(Message("reload", {}))
            before = now or before

    def _stamp(self) -> tuple[int, int] | None:
        if self.file is None:
            return None
        try:
            status = os.stat(self.file)
        except OSError:  # it is just being replaced
            return None
        return status.st_mtime_ns, status.st_size


def view(arguments: argparse.Namespace, load: Callable[[], Scene]) -> int:
    """Runs `lajolla view` until Ctrl-C; prints the address and opens it in the browser."""
    rules = StopRules(spp=arguments.spp, noise=arguments.noise or NOISE_GOAL, adaptive=False)
    file = None if str(arguments.scene) == "-" else arguments.scene
    viewer = Viewer(load, file, rules=rules, port=arguments.port, threads=arguments.threads)

    def announce(address: str) -> None:
        print(address, flush=True)
        if not arguments.no_browser:
            webbrowser.open(address)

    asyncio.run(viewer.run(announce))
    return 0
