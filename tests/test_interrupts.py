"""What signals, and streams that take nothing, do to a render: no picture is lost, no traceback is seen."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from process_tools import BLOCKED, can_block

from lajolla import cli, display, image, render_command
from lajolla.interrupts import Patience
from lajolla.render import Progress

SCENE = """<scene version="3.0.0">
    <integrator type="path"/>
    <sensor type="perspective">
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film>
        <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    </sensor>
    <emitter type="constant"/>
    <shape type="sphere"><point name="center" z="5"/><float name="girth" value="1"/></shape>
</scene>"""

# Sends a signal when a module is imported, which is before or while the command line is loaded.
INTERRUPTED_IMPORT = """
import os, sys

class Finder:
    def find_spec(name, *rest):
        if name == {module!r}:
            os.kill(os.getpid(), {number})

sys.meta_path.insert(0, Finder)
sys.argv[1:] = ["render", "room.xml"]
from lajolla.__main__ import main
sys.exit(main())
"""


@pytest.fixture(autouse=True)
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "room.xml").write_text(SCENE)
    monkeypatch.chdir(tmp_path)


def shell(command: str) -> subprocess.CompletedProcess[str]:
    """Runs a shell's command in which `lajolla` is the program; its exit code is printed last."""
    program = f'lajolla() {{ "{sys.executable}" -m lajolla "$@"; echo "$?" >code; }}; '
    return subprocess.run(
        program + command, shell=True, capture_output=True, text=True, timeout=60, check=False
    )


@pytest.mark.parametrize(
    "streams",
    ["2>&-", ">&-", "<&- >&- 2>&-", ">/dev/full 2>/dev/full", "2>&1 | head -n 1", "2>&1 | true"],
)
def test_no_stream_decides_over_the_picture(streams: str) -> None:
    result = shell(f"lajolla render room.xml -o a.exr {streams}")
    assert Path("code").read_text().strip() == "0"
    assert image.read("a.exr").mean() > 0
    assert "Traceback" not in result.stderr + result.stdout


@pytest.mark.parametrize("command", ["--help", "list", "check room.xml"])
@pytest.mark.parametrize("streams", [">/dev/full", ">&-"])
def test_results_that_go_nowhere_are_an_error(command: str, streams: str) -> None:
    result = shell(f"lajolla {command} {streams}")
    assert Path("code").read_text().strip() == "1"
    assert [line for line in result.stderr.splitlines() if line.startswith("lajolla: error: ")]
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize("module", ["argparse", "numpy", "lajolla._core"])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_start_is_one_line(module: str, number: signal.Signals) -> None:
    code = INTERRUPTED_IMPORT.format(module=module, number=int(number))
    hears = {"preexec_fn": lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)}
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, **hears)
    assert result.returncode == 128 + number
    assert result.stderr == "lajolla: interrupted; nothing was written\n"


def interrupting(action: Callable[..., object]) -> Callable[..., object]:
    """An action during which there is a signal."""

    def interrupted(*arguments: object, **settings: object) -> object:
        os.kill(os.getpid(), signal.SIGINT)
        return action(*arguments, **settings)

    return interrupted


@pytest.mark.usefixtures("as_from_a_terminal")
def test_saving_waits_for_the_picture(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(image, "write", interrupting(image.write))
    assert cli.main("render room.xml -o a.exr --quiet".split()) == 130
    assert image.read("a.exr").mean() > 0
    assert "lajolla: saving; press Ctrl-C again to quit without saving" in capfd.readouterr().err


@pytest.mark.usefixtures("as_from_a_terminal")
def test_a_signal_between_rendering_and_saving_loses_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli.Patience, "save", interrupting(cli.Patience.save))
    assert cli.main("render room.xml -o a.exr --quiet".split()) == 130
    assert image.read("a.exr").mean() > 0


def test_impatience_is_answered_before_the_save_too(capfd: pytest.CaptureFixture[str]) -> None:
    patience = Patience("the picture")
    for number in (signal.SIGTERM, signal.SIGINT):
        patience(number, None)
    assert capfd.readouterr().err == "lajolla: stopping; press Ctrl-C again to quit without saving\n"
    assert patience.interrupt is not None and patience.interrupt.exit_code == 143


@pytest.mark.usefixtures("as_from_a_terminal")
def test_an_interrupted_conversion_is_complete_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "_write_export", interrupting(cli._write_export))
    assert cli.main("convert room.xml new.xml".split()) == 130
    assert Path("new.xml").is_file()
    assert capfd.readouterr().err.endswith("lajolla: interrupted; wrote new.xml\n")


@pytest.mark.usefixtures("as_from_a_terminal")
def test_no_callback_can_drop_an_interrupt(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    @contextmanager
    def progress_display(**settings: object) -> Iterator[display.Observer]:
        def observe(progress: Progress) -> None:
            if progress.samples >= 1:
                with suppress(BaseException):
                    os.kill(os.getpid(), signal.SIGINT)

        yield observe

    monkeypatch.setattr(render_command, "progress_display", progress_display)
    assert cli.main("render room.xml -o a.exr --spp 4096".split()) == 130
    error = capfd.readouterr().err
    samples = re.search(r"interrupted; wrote a.exr \(([\d.]+) of 4096 samples per pixel", error)
    assert samples and 1 <= int(samples[1]) < 4096


@pytest.mark.parametrize(
    ("command", "missing"),
    [("render room.xml -o a.exr --quiet", "the picture"), ("convert room.xml new.xml", "the scene")],
)
def test_who_does_not_wait_is_let_go(command: str, missing: str) -> None:
    code = f"""
import os, signal, sys, time
from lajolla import cli, image

def slow(*arguments, **settings):
    for _ in range(2):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.3)

image.write = cli._write_export = slow
sys.exit(cli.main({command.split()}))
"""
    words = [sys.executable, "-c", code]
    result = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 143
    assert f"interrupted; {missing} may not be there" in result.stderr
    assert "Traceback" not in result.stderr


def test_an_interrupt_in_the_second_sensor_does_not_deny_the_first() -> None:
    code = """
import os, signal, sys
from lajolla import cli, render_command

def load(arguments, load=render_command.load):
    if arguments.sensor == 1:
        os.kill(os.getpid(), signal.SIGTERM)
    return load(arguments)

render_command.load = load
sys.exit(cli.main("render room.xml --all-sensors -o a.pfm --quiet".split()))
"""
    sensor = '<sensor type="perspective"/>'
    Path("room.xml").write_text(SCENE.replace("<emitter", sensor + "<emitter"))
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 143
    assert [path.name for path in Path().glob("*.pfm")] == ["a-0.pfm"]
    assert "lajolla: interrupted; nothing was written of sensor 1 and those after it" in result.stderr


BUSY = SCENE.replace('"sample_count" value="4"', '"sample_count" value="256"').replace("8", "32")
MOMENTS = 10


@pytest.mark.skipif(not can_block(), reason="env has no --block-signal")
@pytest.mark.usefixtures("as_from_a_terminal")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda n: n.name)
def test_no_moment_is_a_bad_one(number: signal.Signals) -> None:
    """From before Python has started until after the picture was saved, which took the place of another."""
    Path("room.xml").write_text(BUSY)
    command = [*BLOCKED, sys.executable, "-m", "lajolla", *"render room.xml -o a.exr --threads 1".split()]
    start = time.monotonic()
    subprocess.run(command, capture_output=True, check=True, timeout=120)
    duration = time.monotonic() - start
    codes = []
    for moment in range(MOMENTS):
        image.write(Path("a.exr"), np.ones((2, 3, 3), np.float32))
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        time.sleep(duration * moment / (MOMENTS - 1))
        process.send_signal(number)
        _, told = process.communicate(timeout=60)
        codes.append(process.returncode)
        assert "Traceback" not in told and "Error" not in told, told
        assert process.returncode in (0, -number, 128 + number)
        written = "wrote a.exr" in told
        shape = image.read("a.exr").shape
        assert shape == (32, 32, 3) if written else shape in ((2, 3, 3), (32, 32, 3)), told
    assert len([code for code in codes if code]) >= MOMENTS // 2
    subprocess.run(command, capture_output=True, check=True, timeout=120)
    assert sorted(os.listdir()) == ["a.exr", "room.xml"]


@pytest.mark.usefixtures("as_from_a_terminal")
def test_an_interrupted_pass_keeps_its_finished_tiles(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Passes have 1, 1, 2, 4, ... samples: the one that is cut off has as many as all before it."""
    monkeypatch.setattr("lajolla.render.POLL_SECONDS", 0)

    @contextmanager
    def progress_display(**settings: object) -> Iterator[display.Observer]:
        def observe(progress: Progress) -> None:
            if 4 < progress.samples < 8:
                os.kill(os.getpid(), signal.SIGINT)

        yield observe

    monkeypatch.setattr(render_command, "progress_display", progress_display)
    assert cli.main("render room.xml -o a.exr --spp 4096 --size 400x400".split()) == 130
    told = r"interrupted; wrote a.exr \(([\d.]+) of 4096 samples per pixel \(4 to 8\) in"
    found = re.search(told, capfd.readouterr().err)
    assert found is not None and 4 < float(found[1]) < 8
    assert image.read("a.exr").shape == (400, 400, 3)
