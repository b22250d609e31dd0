"""Work in another thread while an event loop goes on."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


async def in_thread(work: Callable[[Callable[[], None]], Result]) -> Result:
    """The result of `work(checkpoint)`, which runs in a thread of the event loop's own pool.

    When the task is cancelled, the next `checkpoint()` raises CancelledError in that thread, and the task
    ends when the work has ended. Work that waits for a free thread is dropped at once.
    """
    begun, stopped = threading.Event(), threading.Event()

    def checkpoint() -> None:
        if stopped.is_set():
            raise asyncio.CancelledError

    def run() -> Result:
        begun.set()
        checkpoint()
        return work(checkpoint)

    future = asyncio.get_running_loop().run_in_executor(None, run)
    try:
        return await asyncio.shield(future)
    except asyncio.CancelledError:
        stopped.set()
        future.add_done_callback(_retrieve)
        if begun.is_set():
            await asyncio.wait([future])
        else:
            future.cancel()
        raise


def _retrieve(future: asyncio.Future[Result]) -> None:
    """Nobody waits for it any more; without this, asyncio would report its exception."""
    if not future.cancelled():
        future.exception()
