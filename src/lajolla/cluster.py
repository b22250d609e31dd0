"""Renders on many machines, through the scheduler and the workers of Dask distributed.

The client cuts the picture into units of work (`units.py`) and adds the exact sums that workers return. These
do not depend on their order, so that the picture is that of one machine, bit for bit, whichever worker takes
which unit and whenever it answers. A unit that is lost or late is given to another worker as well; its first
result counts.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import math
import pickle
import re
import signal
import threading
import time
import warnings
from collections import Counter, OrderedDict
from collections.abc import Callable, Coroutine, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from multiprocessing import resource_tracker
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from lajolla import _core, processor, units
from lajolla.adaptive import TILE_SIZE, Counts
from lajolla.limits import OptionError
from lajolla.messages import ClusterError, ClusterWarning, installing, names_checked, warn
from lajolla.render import Progress, Rendering, available_threads, unobserved
from lajolla.units import Plan, Result, Unit

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")

UNIT_SECONDS = 1.5  # of a unit: long beside the milliseconds of its messages, and no great loss
BYTES_PER_SECOND = 100e6  # of results that a client takes
MOST_BYTES = 2**32  # of results that are on their way
UNITS_AHEAD = (2, 16)  # of each worker, so that none waits for the client: at least, and most of short units
SECONDS_AHEAD = 0.5  # of short units together
MOST_SCENES = 2  # that a worker keeps
MOST_LOSSES = 5  # of workers in a row with the same work, which seems to be the cause
CONNECT_SECONDS = 10.0
POLL_SECONDS = 0.1
LISTING_SECONDS = 1.0  # between questions about the workers

# Dask's settings that leave the processors to rendering: its processes look at themselves a hundred times a
# second, which takes 3 % of one.
QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}

ADDRESS = re.compile(r"local:(?P<count>\d+)|(?:tcp|tls|ucx|wss?)://(?:[^/:\s]+|\[[^]]+\]):\d+")


# --- the side of the workers ------------------------------------------------------------------------------

_scenes: OrderedDict[str, _core.Scene] = OrderedDict()  # that this process has built, by their hashes
_turn = threading.Lock()  # a process renders one unit after the other, with all its threads


class SceneMissing(Exception):
    """This process has not built the scene, or has not kept it."""


def build() -> tuple[str, str]:
    """What the bits of a picture depend on, beside the scene: version and instruction set."""
    return (
        version("lajolla"),
        f"{_core.isa} on {processor.level()}",
    )  # Embree chooses its own by the processor


def join(scene: str, description: bytes) -> tuple[str, str]:
    """Prepares this process for units of a scene. Returns `build()`."""
    with _turn:
        if scene not in _scenes:
            while len(_scenes) >= MOST_SCENES:
                _scenes.popitem(last=False)
            _scenes[scene] = _core.Scene(pickle.loads(description))
    return build()


def render(scene: str, seed: int, first_sample: int, unit: Unit, threads: int) -> Result:
    with _turn:
        if scene not in _scenes:
            raise SceneMissing
        _scenes.move_to_end(scene)
        return units.render(_scenes[scene], seed, first_sample, unit, threads)


def held(description: bytes) -> bytes:
    """The task that keeps a scene in the cluster; where it is lost, Dask repeats this."""
    return description


# --- the side of the client -------------------------------------------------------------------------------


class ClusterRendering(Rendering):
    """A Rendering by the workers of a cluster."""

    def __init__(
        self,
        core: _core.Scene,
        description: Mapping[str, Any],
        *,
        cluster: str | Client,
        mixed: bool,
        threads: int | None,
        **settings: Any,  # noqa: ANN401
    ) -> None:
        if isinstance(cluster, str):
            worker_count(cluster)
        elif not hasattr(cluster, "scheduler_info"):
            raise OptionError(f"cluster must be an address or a distributed.Client, not {cluster!r}")
        super().__init__(core, description, threads=threads or 0, **settings)
        self.cluster = cluster
        self.mixed = mixed
        self.threads_of_each = threads
        self.pool: Pool | None = None
        self.row_bytes = 17 * TILE_SIZE * core.width * (3 + len(core.channels))  # of the result of a unit

    @names_checked
    def run(self, progress: Callable[[Progress], None] | None = None) -> None:
        """Renders until a stop rule is met; calls `progress` in this thread ten times a second at least.

        Raises ClusterError where the cluster cannot be used, or not any more: what has arrived is kept.
        """
        description = pickle.dumps(self.description, pickle.HIGHEST_PROTOCOL)
        with connected(self.cluster, self.threads_of_each) as client:
            self.pool = Pool(client, description, self.threads_of_each, mixed=self.mixed)
            try:
                for counts in self._passes():
                    self._distribute(counts, self.pool, progress or unobserved)
            finally:
                self.pool.close()

    def _even_passes(self, spp: int) -> Iterator[Counts]:
        """One pass, whose units begin small: nobody has to wait for the last unit of each of many passes."""
        if self.accumulator.counts.min() < spp:
            yield np.full(self.halves.shape, spp, np.uint32)

    def _passes_to(self, counts: Counts) -> Iterator[Counts]:
        yield counts

    def _distribute(self, target: Counts, pool: Pool, observe: Callable[[Progress], None]) -> None:
        """One pass: until the halves of cells have these numbers of samples, or no time is left."""
        plan = Plan(self.halves, self.accumulator.counts, target)
        noise = self.noise
        while not plan.finished:
            start = time.perf_counter()
            for unit, result in pool.results():
                if (samples := plan.put(unit, result)) is not None:
                    self._add(samples)
            plan.lost.extend(pool.lost_units())
            plan.lost.extend(pool.late_units(plan))
            if self.seconds < self.rules.seconds:
                self._hand_out(plan, pool)
            elif not pool.is_waiting:
                return
            observe(Progress(self.samples, self.seconds, self.rules, noise))
            if pool.ready:
                self.seconds += time.perf_counter() - start

    def _add(self, samples: units.Samples) -> None:
        self.accumulator.add(
            samples.row,
            samples.sums,
            samples.counts,
            samples.rays,
            samples.nonfinite,
            samples.nonfinite_list,
        )

    def _hand_out(self, plan: Plan, pool: Pool) -> None:
        """Gives units to workers that have little to do."""
        self.threads = max(self.threads, pool.threads)
        longest = max(UNIT_SECONDS, len(pool.ready) * self.row_bytes / BYTES_PER_SECOND)
        for worker in pool.free_places(most_units=max(1, MOST_BYTES // self.row_bytes)):
            seconds_left = self.rules.seconds - self.seconds
            unit = plan.next_unit(worker.threads, pool.threads, longest, seconds_left)
            if unit is None:
                return
            flight = Flight(worker, unit, plan.seconds(unit, worker.threads))
            pool.give(flight, self.seed, self.first_sample)


@dataclass(eq=False)
class Worker:
    """A worker of the scheduler's."""

    address: str
    threads: int
    initial: bool  # whether it was there when the render began
    ready: bool = False  # whether it has built the scene
    flights: list[Flight] = field(default_factory=list)  # in the order in which they were sent


@dataclass(eq=False)
class Flight:
    """Work that was sent to a worker, and has no answer: a unit, or to build the scene."""

    worker: Worker
    unit: Unit | None
    seconds: float = 0.0  # that it should take; not a number if unknown
    sent: float = field(default_factory=time.perf_counter)
    late: bool = False


class Pool:
    """The workers of a scheduler, and what they have to do."""

    def __init__(self, client: Client, description: bytes, threads: int | None, *, mixed: bool) -> None:
        self.client = client
        self.threads_of_each = threads
        self.mixed = mixed
        self.scene = hashlib.sha256(description).hexdigest()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")
            self.description = client.submit(held, description, key=f"lajolla-{self.scene}")
        self.workers: dict[str, Worker] = {}
        self.flights: dict[object, Flight] = {}  # by their futures
        self.lost: list[Unit] = []
        self.losses: Counter[tuple[int, int] | None] = Counter()  # of workers, by row and number of the unit
        self.arrived: SimpleQueue[tuple[Any, Any]] = SimpleQueue()  # futures and their results or exceptions
        self.listing: Future[Mapping[str, int]] | None = None  # of all workers and their threads
        self.listed = -math.inf
        self.told = False  # that there are no workers

    def close(self) -> None:
        if self.client.status == "running":
            self.client.cancel([*self.flights, self.description])

    @property
    def ready(self) -> list[Worker]:
        return [worker for worker in self.workers.values() if worker.ready]

    @property
    def threads(self) -> int:
        """Of all workers that are ready."""
        return sum(worker.threads for worker in self.ready)

    @property
    def is_waiting(self) -> bool:
        """Whether units are expected soon."""
        return any(flight.unit is not None and not flight.late for flight in self.flights.values())

    def free_places(self, most_units: int) -> Iterator[Worker]:
        """Workers that can take one more unit, those with the fewest first."""
        least, most = UNITS_AHEAD
        for load in range(most):
            for worker in self.ready:
                waiting = sum(flight.seconds for flight in worker.flights)
                wanted = load < least or waiting < SECONDS_AHEAD
                reliable = not any(flight.late for flight in worker.flights)
                if len(worker.flights) == load and wanted and reliable and len(self.flights) < most_units:
                    yield worker

    def give(self, flight: Flight, seed: int, first_sample: int) -> None:
        self._send(flight, render, self.scene, seed, first_sample, flight.unit, flight.worker.threads)

    def results(self) -> Iterator[tuple[Unit, Result]]:
        """What has arrived; waits a little for it. Raises ClusterError."""
        self._list_workers()
        with suppress(Empty):
            future, answer = self.arrived.get(timeout=POLL_SECONDS)
            while True:
                if (flight := self.flights.pop(future, None)) is not None:  # else its worker was gone
                    flight.worker.flights.remove(flight)
                    if isinstance(answer, Result) and flight.unit is not None:
                        del self.losses[flight.unit.row, flight.unit.number]
                        yield flight.unit, answer
                    else:
                        self._note(flight, answer)
                future, answer = self.arrived.get_nowait()
        if self.client.status != "running":
            raise ClusterError("the scheduler is gone")

    def lost_units(self) -> list[Unit]:
        """Those that have to be given to another worker."""
        lost, self.lost = self.lost, []
        return lost

    def late_units(self, plan: Plan) -> Iterator[Unit]:
        """Those that take much longer than they should: for each flight once."""
        now = time.perf_counter()
        for worker in self.workers.values():
            expected = 0.0  # until the answer
            for flight in worker.flights:
                if flight.unit is None:
                    continue
                expected += plan.seconds(flight.unit, worker.threads)
                if not flight.late and now - flight.sent > 3 * expected + 2:
                    flight.late = True
                    yield flight.unit

    def _send(self, flight: Flight, function: Callable[..., object], *arguments: object) -> None:
        future = self.client.submit(function, *arguments, workers=[flight.worker.address], pure=False)
        self.flights[future] = flight
        flight.worker.flights.append(flight)
        self._in_loop(self._fetch(future))

    async def _fetch(self, future: Any) -> None:  # noqa: ANN401
        try:
            self.arrived.put((future, await future))
        except (Exception, asyncio.CancelledError) as problem:
            self.arrived.put((future, problem))

    def _in_loop(self, call: Coroutine[Any, Any, T]) -> Future[T]:
        """Runs a coroutine in the client's event loop."""
        loop: Any = self.client.loop
        return asyncio.run_coroutine_threadsafe(call, loop.asyncio_loop)

    def _list_workers(self) -> None:
        """Asks for the workers from time to time, without waiting for the answer."""
        now = time.perf_counter()
        if self.listing is None and now - self.listed > LISTING_SECONDS:
            scheduler: Any = self.client.scheduler
            self.listing = self._in_loop(scheduler.ncores())
        if self.listing is None or not self.listing.done():
            return
        answer, self.listing, self.listed = self.listing, None, now
        if answer.exception() is not None:  # if the scheduler is gone, the client's status tells it
            return
        threads_of = answer.result()
        initial = not self.workers and not self.told
        for address in set(self.workers) - set(threads_of):
            self._drop(self.workers.pop(address))
        for address in set(threads_of) - set(self.workers):
            self.workers[address] = Worker(address, self.threads_of_each or threads_of[address], initial)
            self._invite(self.workers[address])
        if not self.workers and not self.told:
            warn(ClusterWarning("the scheduler has no workers; waiting for some"))
        self.told = not self.workers

    def _invite(self, worker: Worker) -> None:
        worker.ready = False
        self._send(Flight(worker, None), join, self.scene, self.description)

    def _note(self, flight: Flight, answer: object) -> None:
        """What is no result: a worker has built the scene, or is gone, or its work raised an exception."""
        from distributed import KilledWorker

        worker, unit = flight.worker, flight.unit
        if isinstance(answer, SceneMissing):
            self.lost += [unit] if unit else []
            self._invite(worker)
        elif isinstance(answer, KilledWorker | CancelledError | asyncio.CancelledError):
            self._lose(flight)
        elif not isinstance(answer, Exception):
            self._welcome(worker, answer)
        elif unit is None:
            self._refuse(worker, f"cannot build the scene: {type(answer).__name__}: {answer}")
        else:
            raise ClusterError(f"worker {worker.address}: {type(answer).__name__}: {answer}")

    def _welcome(self, worker: Worker, build_there: Any) -> None:  # noqa: ANN401
        """A worker has built the scene: uses it if its build gives the bits of this one."""
        self.losses[None] = 0
        version_here, isa_here = build()
        version_there, isa_there = build_there
        if version_there != version_here:
            self._refuse(worker, f"has lajolla {version_there}, and this is {version_here}")
        elif isa_there != isa_here and not self.mixed:
            self._refuse(
                worker,
                f"renders with {isa_there}, and this process with {isa_here}, which changes the last bits of "
                f"pictures: LAJOLLA_ISA selects one that all have; --mixed (mixed=True) permits it",
            )
        else:
            worker.ready = True

    def _refuse(self, worker: Worker, reason: str) -> None:
        """An error if the worker was there from the beginning; others only take no part."""
        message = f"worker {worker.address} {reason}"
        if worker.initial:
            raise ClusterError(message)
        warn(ClusterWarning(f"{message}; it is not used"))

    def _drop(self, worker: Worker) -> None:
        """A worker is gone."""
        for future, flight in list(self.flights.items()):
            if flight.worker is worker:
                del self.flights[future]
                self._lose(flight)

    def _lose(self, flight: Flight) -> None:
        work = None if flight.unit is None else (flight.unit.row, flight.unit.number)
        self.losses[work] += 1
        if self.losses[work] > MOST_LOSSES:
            raise ClusterError(
                f"{MOST_LOSSES} workers ended at the same work; they may have too little memory"
            )
        if flight.unit is not None:
            self.lost.append(flight.unit)


# --- connections ------------------------------------------------------------------------------------------


def worker_count(address: str) -> int | None:
    """The number of workers of an address such as local:4; None if it is that of a scheduler.

    Raises OptionError for anything else.
    """
    found = ADDRESS.fullmatch(address)
    if found is None or (found["count"] is not None and not 1 <= int(found["count"]) <= 1024):
        raise OptionError(
            f"{address!r} is no cluster, such as tcp://host:8786 or local:4 (1 to 1024 workers)"
        )
    return int(found["count"]) if found["count"] else None


@contextmanager
def connected(cluster: str | Client, threads: int | None) -> Iterator[Client]:
    """A client of a scheduler, or of new workers on this machine. Raises ClusterError and OptionError."""
    count = worker_count(cluster) if isinstance(cluster, str) else None
    try:
        import distributed
    except ImportError:
        raise ClusterError(f"a cluster needs the package distributed: {installing('distributed')}") from None
    if not isinstance(cluster, str):
        yield cluster
    elif count is not None:
        with _workers_here(count, threads or max(1, available_threads() // count)) as client:
            yield client
    else:
        with distributed.utils.silence_logging_cmgr(logging.CRITICAL), _scheduler_at(cluster) as client:
            yield client


@contextmanager
def _scheduler_at(address: str) -> Iterator[Client]:
    """A client of a scheduler. Raises ClusterError."""
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as problem:
        raise ClusterError(f"no scheduler answers at {address}: {problem}") from None
    try:
        yield client
    finally:
        client.close(timeout=CONNECT_SECONDS)


@contextmanager
def _workers_here(count: int, threads: int) -> Iterator[Client]:
    """Processes of this machine; Ctrl-C is for this one alone."""
    import dask
    from distributed import Client, LocalCluster

    resource_tracker.ensure_running()  # otherwise the first process starts it, which unblocks signals
    with dask.config.set(QUIET):
        previous = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=threads,
                memory_limit=None,
                dashboard_address=":0",  # any free port
                silence_logs=logging.CRITICAL,
            )
        except RuntimeError as problem:
            raise ClusterError(
                f"the processes do not start: {problem} They import the script that starts them: "
                f'in a script, render below if __name__ == "__main__":'
            ) from None
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, previous)
        with cluster, Client(cluster, set_as_default=False) as client:
            yield client
