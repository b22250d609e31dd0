"""Renders in the background of an event loop: cancelling them leaves nothing behind."""

from __future__ import annotations

import asyncio
import gc
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from test_params import ROOM, loaded

import lajolla

ENDLESS = 1 << 28  # samples


def reports_of(main: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    """What the event loop complains about while it runs a coroutine, and afterwards."""
    reports: list[dict[str, Any]] = []

    async def watched() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, report: reports.append(report))
        await main
        gc.collect()

    asyncio.run(watched())
    gc.collect()
    return reports


async def cancelled(task: asyncio.Task[Any]) -> None:
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task


def test_cancelled_renders_are_not_reported() -> None:
    scene = loaded(ROOM)

    async def main() -> None:
        began = threading.Event()
        task = asyncio.create_task(scene.render_async(spp=ENDLESS, progress=lambda _: began.set()))
        await asyncio.to_thread(began.wait)
        await cancelled(task)

    assert reports_of(main()) == []


def test_a_second_cancel_is_not_reported() -> None:
    scene = loaded(ROOM)

    async def main() -> None:
        began, go_on = threading.Event(), threading.Event()

        def progress(state: lajolla.Progress) -> None:
            began.set()
            go_on.wait()

        task = asyncio.create_task(scene.render_async(spp=ENDLESS, progress=progress))
        await asyncio.to_thread(began.wait)
        task.cancel()
        await asyncio.sleep(0)
        await cancelled(task)
        go_on.set()

    assert reports_of(main()) == []


def test_a_queued_render_is_cancelled_at_once() -> None:
    scene = loaded(ROOM)

    async def main() -> float:
        release = threading.Event()
        loop = asyncio.get_running_loop()
        loop.set_default_executor(ThreadPoolExecutor(1))
        busy = loop.run_in_executor(None, release.wait, 20)
        task = asyncio.create_task(scene.render_async(spp=1))
        await asyncio.sleep(0.01)
        start = time.perf_counter()
        await cancelled(task)
        waited = time.perf_counter() - start
        release.set()
        await busy
        return waited

    assert asyncio.run(main()) < 5


def test_errors_reach_the_caller() -> None:
    def fail(progress: lajolla.Progress) -> None:
        raise LookupError("from progress")

    with pytest.raises(LookupError, match="from progress"):
        asyncio.run(loaded(ROOM).render_async(spp=ENDLESS, progress=fail))


def test_features_are_watched() -> None:
    pytest.importorskip("pyoidn")
    seen: list[lajolla.Progress] = []
    loaded(ROOM).render(spp=3, denoise=True, progress=seen.append)
    assert {state.rules.spp for state in seen} == {3}
    assert seen[0].samples == 0
    assert seen[-1].samples == 3


def test_an_exception_ends_the_features() -> None:
    pytest.importorskip("pyoidn")
    scene, calls = loaded(ROOM), []

    def stop(progress: lajolla.Progress) -> None:
        calls.append(progress)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        scene.render(spp=ENDLESS, denoise=True, progress=stop)
    assert [state.samples for state in calls] == [0]
