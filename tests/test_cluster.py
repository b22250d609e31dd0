"""Renders on clusters: the same bits whatever happens to workers, and one message for what cannot go on."""

from __future__ import annotations

import io
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from statistics_tools import generator

import lajolla
from lajolla import _core, checkpoint, cli, cluster, units
from lajolla.adaptive import Halves
from lajolla.render import Progress

distributed = pytest.importorskip("distributed", reason="the package 'distributed' is not installed")

SCENE: dict[str, Any] = {
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 6},
    "sensor": {
        "type": "perspective",
        "film": {"type": "hdrfilm", "width": 90, "height": 70, "rfilter": {"type": "gaussian"}},
        "sampler": {"type": "independent", "sample_count": 16},
    },
    "light": {"type": "constant", "radiance": 0.5},
    "floor": {"type": "rectangle", "to_world": np.diag([4, 4, 1, 1]).tolist()},
    "ball": {"type": "sphere", "center": [0, 0, 5], "radius": 1, "bsdf": {"type": "roughdielectric"}},
}
WORKERS = 3


@pytest.fixture(scope="module")
def scene() -> lajolla.Scene:
    return lajolla.load_dict(SCENE)


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    """A scheduler with worker processes of one thread, on loopback; those that end are started again."""
    with (
        distributed.LocalCluster(
            n_workers=WORKERS,
            threads_per_worker=1,
            memory_limit=None,
            dashboard_address=":0",
            silence_logs=logging.CRITICAL,
        ) as workers,
        distributed.Client(workers, set_as_default=False) as client,
    ):
        yield client


def same(a: lajolla.Image, b: lajolla.Image) -> bool:
    return a.array.tobytes() == b.array.tobytes()


# --- units


def test_units_add_up_in_any_order(scene: lajolla.Scene) -> None:
    """Units of random sizes, some of which have two results, of halves with different numbers of samples."""
    rng = generator("units")
    halves = Halves(scene.width, scene.height, scene.core.crop_offset)
    before = rng.integers(0, 3, halves.shape).astype(np.uint32)
    target = before + rng.integers(0, 40, halves.shape).astype(np.uint32)
    expected, together = (_core.Render(scene.core, 1, 2) for _ in range(2))
    for render in (expected, together):
        render.advance(before, 2)
    expected.advance(target, 2)
    plan = units.Plan(halves, before, target)
    made = []
    while (unit := plan.next_unit(1, 2, 1.5, np.inf)) is not None:
        made.append(unit)
        row = plan.rows[unit.row]
        row.cost, plan.rendered, plan.thread_seconds = rng.uniform(1e-5, 1e-4), 1.0, 1e-5
    assert len(made) > 2 * len(plan.rows)
    for unit in rng.permutation(np.array([*made, *made[::3]], dtype=object)):
        samples = plan.put(unit, units.render(scene.core, 1, 2, unit, 1))
        if samples is not None:
            together.add(*vars(samples).values())
    assert plan.finished
    np.testing.assert_array_equal(together.counts, np.maximum(before, target))
    np.testing.assert_array_equal(together.image(), expected.image())
    assert np.array_equal(together.rays, expected.rays)


def test_results_after_a_gap_wait_together(scene: lajolla.Scene) -> None:
    halves = Halves(scene.width, 16, scene.core.crop_offset)
    plan = units.Plan(halves, np.zeros(halves.shape, np.uint32), np.full(halves.shape, 9, np.uint32))
    made = [plan.next_unit(1, 1, 1.5, np.inf) for _ in range(9)]
    results = [units.render(scene.core, 1, 0, unit, 1) for unit in made]
    for index in (5, 2, 3, 8, 4):
        assert plan.put(made[index], results[index]) is None
    assert {first: end for first, (end, _) in plan.rows[0].later.items()} == {2: 6, 8: 9}
    assert plan.put(made[1], results[1]) is None
    first = plan.put(made[0], results[0])
    assert first is not None
    assert first.counts.min() == first.counts.max() == 6
    assert plan.put(made[0], results[0]) is None


def test_units_take_as_long_as_they_should(scene: lajolla.Scene) -> None:
    """Rows whose samples cost different times, and workers with different numbers of threads."""
    halves = Halves(64, 64, (0, 0))
    plan = units.Plan(halves, np.zeros(halves.shape, np.uint32), np.full(halves.shape, 2**20, np.uint32))
    seconds = []
    for step in range(400):
        threads = 1 + step % 3
        unit = plan.next_unit(threads, 6, 1.5, np.inf)
        seconds.append(plan.seconds(unit, threads))
        row = plan.rows[unit.row]
        row.cost = 1e-6 * (1 + unit.row)
        plan.rendered += unit.samples
        plan.thread_seconds += unit.samples * row.cost
    assert 0.99 * 1.5 <= min(seconds[200:]) <= max(seconds[200:]) <= 1.51
    given = [float(row.given.mean()) for row in plan.rows]
    assert max(given) < 2 * min(given)
    assert plan.seconds(plan.next_unit(1, 6, 1.5, 0.2), 1) <= 0.11  # little time is left


# --- renders


def test_the_picture_is_that_of_one_machine(scene: lajolla.Scene, client: Any) -> None:  # noqa: ANN401
    expected = scene.render(seed=3)
    progress: list[Progress] = []
    rendering = scene.rendering(seed=3, cluster=client)
    rendering.run(progress.append)
    assert same(rendering.image(), expected)
    assert 1 <= rendering.threads <= WORKERS  # all that were ready
    assert progress[-1].fraction == 1


def test_errors_are_estimated_as_on_one_machine(scene: lajolla.Scene, client: Any) -> None:  # noqa: ANN401
    for options in ({"noise": 0.03}, {"spp": 20, "adaptive": True}):
        assert same(scene.render(**options, cluster=client), scene.render(**options))


def test_no_unit_begins_when_the_time_is_over(scene: lajolla.Scene, client: Any) -> None:  # noqa: ANN401
    rendering = scene.rendering(seconds=1, cluster=client)
    rendering.run()
    assert 1 <= rendering.seconds < 30  # the machine may be busy
    assert rendering.samples > 1


def test_workers_that_end_and_workers_that_hang(client: Any) -> None:  # noqa: ANN401
    scene = lajolla.load_dict(SCENE, spp=2000)
    expected = scene.render()
    rendering = scene.rendering(cluster=client)
    client.run(exec, "import lajolla.cluster")  # so that both are ready before the render is over
    workers = client.run(os.getpid)
    killed, frozen, *_ = workers
    left = [(signal.SIGKILL, killed), (signal.SIGSTOP, frozen)]

    def is_busy(worker: str) -> bool:
        flights = rendering.pool.flights.values()
        return any(flight.unit is not None and flight.worker.address == worker for flight in flights)

    def observe(progress: Progress) -> None:
        if progress.fraction > 0.1 and left and is_busy(left[-1][1]):
            number, worker = left.pop()
            os.kill(workers[worker], number)

    try:
        rendering.run(observe)
        assert not left
        assert any(flight.late for flight in rendering.pool.flights.values())  # of the frozen one
    finally:
        os.kill(workers[frozen], signal.SIGCONT)
    assert same(rendering.image(), expected)


def test_an_interrupted_render_goes_on_elsewhere(client: Any, tmp_path: Path) -> None:  # noqa: ANN401
    scene = lajolla.load_dict(SCENE, spp=50)
    rendering = scene.rendering(cluster=client)

    def interrupt(progress: Progress) -> None:
        if progress.samples > 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        rendering.run(interrupt)
    assert 5 < rendering.samples < 50
    checkpoint.of_rendering(rendering).write(tmp_path / "a.npz")
    there, here = scene.rendering(cluster=client), scene.rendering()
    for other in (there, here):
        checkpoint.resume(other, tmp_path / "a.npz")
        other.run()
    assert same(there.image(), here.image())
    assert same(here.image(), scene.render())


# --- refusals


def test_other_instruction_sets_are_refused(
    scene: lajolla.Scene,
    client: Any,  # noqa: ANN401
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    version, isa = cluster.build()
    monkeypatch.setattr(cluster, "build", lambda: (version, "another"))
    with pytest.raises(lajolla.ClusterError, match=rf"worker tcp://.* renders with {isa}.* with another"):
        scene.render(spp=1, cluster=client)
    assert same(scene.render(spp=1, cluster=client, mixed=True), scene.render(spp=1))
    monkeypatch.setattr(cluster, "build", lambda: ("0.0.1", isa))
    with pytest.raises(lajolla.ClusterError, match=r"worker tcp://.* has lajolla .*, and this is 0\.0\.1"):
        scene.render(spp=1, cluster=client, mixed=True)


@pytest.mark.parametrize(
    "address", ["local:0", "local:", "host:8786", "tcp://host", "tcp://a:b:1", "http://a:1", "local:2000"]
)
def test_addresses_that_cannot_be(scene: lajolla.Scene, address: str) -> None:
    with pytest.raises(lajolla.OptionError, match="is no cluster, such as tcp://host:8786 or local:4"):
        scene.rendering(cluster=address)


def test_a_scheduler_that_is_not_there(scene: lajolla.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 0.3)
    with pytest.raises(lajolla.ClusterError, match=r"no scheduler answers at tcp://127\.0\.0\.1:1: "):
        scene.render(cluster="tcp://127.0.0.1:1")


def test_without_the_package(scene: lajolla.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(lajolla.ClusterError, match="-m pip install distributed"):
        scene.render(cluster="local:2")


def test_processes_that_do_not_start(scene: lajolla.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """They import the script that starts them, as those of Python's multiprocessing do."""

    def fail(**options: object) -> None:
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr(distributed, "LocalCluster", fail)
    with pytest.raises(lajolla.ClusterError, match='in a script, render below if __name__ == "__main__":'):
        scene.render(cluster="local:2")


CLUSTER = """\
import time
from distributed import LocalCluster
options = {"threads_per_worker": 1, "processes": False, "protocol": "tcp", "dashboard_address": ":0"}
with LocalCluster(1, **options) as cluster:
    print(cluster.scheduler_address, flush=True)
    time.sleep(60)
"""


@pytest.fixture
def logged() -> Iterator[io.StringIO]:
    """What Dask logs."""
    stream = io.StringIO()
    handler, logger = logging.StreamHandler(stream), logging.getLogger("distributed")
    logger.addHandler(handler)
    yield stream
    logger.removeHandler(handler)


def test_a_scheduler_that_ends(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    logged: io.StringIO,
) -> None:
    """What has arrived is in the picture and in the checkpoint, and one message says what happened."""
    monkeypatch.chdir(tmp_path)
    Path("a.xml").write_text(
        '<scene version="3.0.0"><integrator type="path"/><sensor type="perspective">'
        '<film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/></film>'
        '</sensor><emitter type="constant"/><shape type="sphere"/></scene>'
    )
    with subprocess.Popen([sys.executable, "-c", CLUSTER], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        add, added = cluster.ClusterRendering._add, []

        def add_and_kill(self: cluster.ClusterRendering, samples: units.Samples) -> None:
            add(self, samples)
            added.append(time.perf_counter())
            if len(added) == 20:
                process.kill()

        monkeypatch.setattr(cluster.ClusterRendering, "_add", add_and_kill)
        words = f"render a.xml --spp 1000000 -o a.exr --checkpoint a.npz --cluster {address}".split()
        assert cli.main(words) == 1
    assert time.perf_counter() - added[19] < 10
    message = capsys.readouterr().err
    assert "error: the scheduler is gone" in message
    assert "wrote a.exr (" in message
    assert logged.getvalue() == ""
    saved = checkpoint.read(Path("a.npz"))
    assert saved.counts.min() > 0
    np.testing.assert_array_equal(lajolla.Image.open("a.exr").array, saved.image().array)
