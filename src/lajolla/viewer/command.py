"""The command `lajolla view`: a scene that is rendered while it is looked at, and changed."""

from __future__ import annotations

import argparse
import asyncio
import os
import webbrowser
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TypeAlias

from lajolla.display import say
from lajolla.image import Image
from lajolla.interrupts import end_at_once, handled_by
from lajolla.loaded_scene import Scene
from lajolla.render import StopRules, available_threads
from lajolla.tev import Tev
from lajolla.viewer.pages import Pages
from lajolla.viewer.protocol import Message
from lajolla.viewer.session import ALWAYS, Session
from lajolla.viewer.shown import Listener

WATCH_SECONDS = 0.5  # between two looks at the scene's files
Stamp: TypeAlias = tuple[int, int] | None  # when a file was changed, and its size; None: it is not there


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

    def made(listener: Listener) -> Session:
        rules = StopRules(spp=arguments.spp, noise=arguments.noise or ALWAYS, adaptive=False)
        threads = arguments.threads or available_threads()
        folder = Path() if str(arguments.scene) == "-" else arguments.scene.parent
        return Session(load_with, rules, threads, listener, folder)

    with handled_by(partial(end_at_once, message="the viewer has ended")):
        asyncio.run(_serve(Pages(arguments, made, reference, tev), arguments))
    return 0


async def _serve(pages: Pages[Session], arguments: argparse.Namespace) -> None:
    """Serves until it is cancelled. Raises what reading the scene raises, and OSError as `Pages.start`."""
    address = await pages.start()
    pages.session.start()
    await asyncio.to_thread(pages.session.opened.wait)
    if pages.session.failure is not None:
        raise pages.session.failure
    print(address, flush=True)
    if not arguments.no_browser:
        webbrowser.open(address)
    await _watch(pages)


async def _watch(pages: Pages[Session]) -> None:
    """Reads the scene again whenever one of its files changes."""
    known: dict[Path, Stamp] = {}
    while True:
        view = pages.session.view
        files = (view.scene.paths if view else set()) | ({pages.file} if pages.file else set())
        changed = await asyncio.to_thread(changed_files, files, known)
        if changed:
            is_scene = any(path == pages.file or path.suffix.lower() == ".xml" for path in changed)
            pages.session.post(Message("reload", {"is_scene": is_scene}))
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
