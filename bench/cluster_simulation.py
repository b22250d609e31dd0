"""Whether one client and one scheduler keep up with many workers, which sleep instead of rendering.

    python bench/cluster_simulation.py --workers 100 --seconds 40
    python bench/cluster_simulation.py --workers 1000 --seconds 60 --virtual

The driver, the scheduler, all messages and the sums are real. Many workers share a process, and return
invented sums of the right size when a unit would be done. All run on this machine and compete for its
processors with the client and the scheduler; on a real cluster, each of these has one to itself.

With --virtual there are no processes and no messages: only the units are real, and times are computed. This
shows how well the work is divided.
"""

from __future__ import annotations

import argparse
import asyncio
import heapq
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import dask
import distributed
import numpy as np

import lajolla
from lajolla import cluster, units
from lajolla.adaptive import CELL_SIZE, Halves

SCENE = {
    "type": "scene",
    "integrator": {"type": "path"},
    "sensor": {"type": "perspective"},
    "light": {"type": "constant"},
    "ball": {"type": "sphere", "center": [0, 0, 5]},
}
WORKERS_OF_PROCESS = 250


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=60, help="of rendering")
    parser.add_argument("--rate", type=float, default=1e6, help="samples per second of a worker")
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--spp", type=int, default=2**20, help="of the picture, with --virtual")
    parser.add_argument("--virtual", action="store_true", help="compute the times")
    parser.add_argument("--act-as-workers", metavar="ADDRESS", help=argparse.SUPPRESS)
    return parser.parse_args()


# --- the processes of workers -----------------------------------------------------------------------------


async def act_as_workers(address: str, count: int, rate: float, width: int) -> None:
    """Connects workers whose functions are replaced."""
    cluster.join = lambda scene, description: cluster.build()
    cluster.render = lambda scene, seed, first_sample, unit, threads: asleep(unit, rate, width)
    workers = [distributed.Worker(address, nthreads=1, memory_limit=0) for _ in range(count)]
    await asyncio.gather(*workers)
    await asyncio.gather(*(worker.finished() for worker in workers))


def asleep(unit: units.Unit, rate: float, width: int) -> units.Result:
    """A result that takes its time; numbers that cannot be compressed, as those of real sums."""
    seconds = unit.samples / rate
    time.sleep(seconds)
    shape = (CELL_SIZE * len(unit.before), width, 3)
    digits = np.frombuffer(os.urandom(16 * int(np.prod(shape))), np.int64).reshape(*shape, 2) >> 32
    return units.Result(digits, np.full(shape, 4, np.int8), int(unit.samples), 0, [], seconds)


# --- the client -------------------------------------------------------------------------------------------


@contextmanager
def started(*words: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def processor_seconds(process: int) -> float:
    with open(f"/proc/{process}/stat") as file:
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def simulate(options: argparse.Namespace, address: str, scheduler: int) -> None:
    width, height = map(int, options.size.split("x"))
    scene = lajolla.load_dict(SCENE, size=(width, height))
    with distributed.Client(address, set_as_default=False, timeout=60) as client:
        client.wait_for_workers(options.workers, timeout=600)
        rendering = scene.rendering(seconds=options.seconds, cluster=client)
        results: list[units.Result] = []
        put = units.Plan.put

        def count_and_put(plan: units.Plan, unit: units.Unit, result: units.Result) -> units.Samples | None:
            results.append(units.Result(result.digits[:0], result.places[:0], 0, 0, [], result.seconds))
            return put(plan, unit, result)

        units.Plan.put = count_and_put
        before = time.perf_counter(), processor_seconds(os.getpid()), processor_seconds(scheduler)
        rendering.run()
        wall, own, schedulers = (
            after - before
            for after, before in zip(
                (time.perf_counter(), processor_seconds(os.getpid()), processor_seconds(scheduler)),
                before,
                strict=True,
            )
        )
    busy = sum(result.seconds for result in results) / (options.workers * rendering.seconds)
    megabytes = len(results) * rendering.row_bytes / 1e6

    def processor(seconds: float) -> str:
        return f"{100 * seconds / wall:.0f} %, {1000 * seconds / len(results):.1f} ms per unit"

    print(f"workers                {options.workers}, busy for {100 * busy:.1f} % of the time")
    print(f"time                   {rendering.seconds:.1f} s; {wall:.1f} s with the first and last messages")
    print(f"units                  {len(results)}, {len(results) / rendering.seconds:.0f} per second")
    print(f"results                {megabytes:.0f} MB, {megabytes / rendering.seconds:.0f} MB per second")
    print(f"processor of client    {processor(own)}")
    print(f"processor of scheduler {processor(schedulers)}")


def compute(options: argparse.Namespace) -> None:
    """The same with a queue of events: when a worker is done with a unit, it gets another one."""
    width, height = map(int, options.size.split("x"))
    halves = Halves(width, height, (0, 0))
    plan = units.Plan(
        halves, np.zeros(halves.shape, np.uint32), np.full(halves.shape, options.spp, np.uint32)
    )
    row_bytes = 17 * units.TILE_SIZE * width * 3
    longest = max(cluster.UNIT_SECONDS, options.workers * row_bytes / cluster.BYTES_PER_SECOND)
    free_at = [0.0] * options.workers
    events: list[tuple[float, int, units.Unit | None]] = [(0.0, i, None) for i in range(options.workers)] * 2
    heapq.heapify(events)
    nothing = np.zeros((0, 1, 1, 2), np.int64), np.zeros((0, 1, 1), np.int8)
    started = time.process_time()
    done, busy, now = 0, 0.0, 0.0
    while events:
        now, worker, unit = heapq.heappop(events)
        if unit is not None:
            plan.put(unit, units.Result(*nothing, 0, 0, [], unit.samples / options.rate))
            done, busy = done + 1, busy + unit.samples / options.rate
        if now < options.seconds:
            unit = plan.next_unit(1, options.workers, longest, options.seconds - now)
            if unit is not None:
                free_at[worker] = max(now, free_at[worker]) + unit.samples / options.rate
                heapq.heappush(events, (free_at[worker], worker, unit))
    own = time.process_time() - started
    print(f"workers   {options.workers}, busy for {100 * busy / (options.workers * now):.1f} % of the time")
    print(f"time      {now:.1f} s")
    print(f"units     {done}, {done / now:.0f} per second; {1000 * own / done:.2f} ms to decide about one")
    print(f"results   {done * row_bytes / 1e6:.0f} MB, {done * row_bytes / 1e6 / now:.0f} MB per second")


def main() -> None:
    options = arguments()
    if options.virtual:
        compute(options)
        return
    with dask.config.set(cluster.QUIET):
        if options.act_as_workers:
            width = int(options.size.split("x")[0])
            asyncio.run(act_as_workers(options.act_as_workers, options.workers, options.rate, width))
            return
        with ExitStack() as running:
            words = "-m distributed.cli.dask_scheduler --host 127.0.0.1 --port 8799 --no-dashboard".split()
            scheduler = running.enter_context(started(*words))
            address = "tcp://127.0.0.1:8799"
            for first in range(0, options.workers, WORKERS_OF_PROCESS):
                count = min(WORKERS_OF_PROCESS, options.workers - first)
                words = [__file__, "--act-as-workers", address, "--workers", str(count)]
                running.enter_context(started(*words, "--rate", str(options.rate), "--size", options.size))
            simulate(options, address, scheduler.pid)


if __name__ == "__main__":
    main()
