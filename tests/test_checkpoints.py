"""Checkpoints and merging: any interruption gives the bits of none, and nothing that fits badly is taken."""

from __future__ import annotations

import itertools
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lajolla
from lajolla import checkpoint, cli, image
from lajolla.checkpoint import CheckpointError
from lajolla.identity import ContentHash, differences, sections

SCENE = """\
<scene version="3.0.0">
    <default name="level" value="0.5"/>
    <integrator type="path"><integer name="max_depth" value="4"/></integrator>
    <sensor type="perspective">
        <film type="hdrfilm">
            <integer name="width" value="48"/><integer name="height" value="40"/>
            <string name="pixel_format" value="rgba"/>
        </film>
        <sampler type="independent"><integer name="sample_count" value="16"/></sampler>
    </sensor>
    <shape type="sphere"><point name="center" x="0.3" z="4"/></shape>
    <shape type="sphere">
        <point name="center" x="-1" y="1" z="3"/><float name="radius" value="0.2"/>
        <emitter type="area"><rgb name="radiance" value="$level"/></emitter>
    </shape>
</scene>
"""
KILLS = 20


@pytest.fixture(autouse=True)
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.xml").write_text(SCENE)


def run(words: str) -> int:
    return cli.main([*words.split(), *([] if words.startswith("merge") else ["--quiet"])])


def pixels(name: str) -> np.ndarray:
    return np.dstack([image.read(Path(name)), *image.Image.open(name).channels.values()])


# --- going on


def test_a_checkpoint_may_have_more_samples_than_are_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("render scene.xml --spp 8 --checkpoint a.ckpt -o a.exr") == 0
    assert capsys.readouterr().err == ""
    assert run("render scene.xml --spp 4 --resume a.ckpt -o b.exr") == 0
    message = "warning: a.ckpt has 8 samples per pixel, more than --spp 4; all are used"
    assert message in capsys.readouterr().err
    np.testing.assert_array_equal(pixels("a.exr"), pixels("b.exr"))


def test_a_resumed_render_equals_one_in_one_go() -> None:
    assert run("render scene.xml --spp 9 -o part.exr --checkpoint a.ckpt") == 0
    assert run("render scene.xml --spp 32 -o a.exr --resume a.ckpt") == 0
    assert run("render scene.xml --spp 32 -o b.exr") == 0
    np.testing.assert_array_equal(pixels("a.exr"), pixels("b.exr"))
    assert checkpoint.read(Path("a.ckpt")).ranges == [(0, 32)]


def test_a_checkpoint_can_become_another() -> None:
    assert run("render scene.xml --spp 2 -o a.exr --checkpoint a.ckpt") == 0
    before = Path("a.ckpt").read_bytes()
    assert run("render scene.xml --spp 4 -o a.exr --resume a.ckpt --checkpoint b.ckpt") == 0
    assert Path("a.ckpt").read_bytes() == before
    assert checkpoint.read(Path("b.ckpt")).ranges == [(0, 4)]


WORKER = """
import sys
import lajolla
from lajolla import checkpoint, render
from pathlib import Path

render.POLL_SECONDS = render.PASS_SECONDS = 0.01
scene, file = lajolla.load("scene.xml"), Path("a.ckpt")
rendering = scene.rendering(**eval(sys.argv[1]))
if file.exists():
    checkpoint.resume(rendering, file)
saver = checkpoint.Saver(rendering, file, 0.0)  # writes all the time, so that many kills hit a write
print("ready", flush=True)
rendering.run(lambda progress: saver.write_if_due())
saver.write()
"""


@pytest.mark.parametrize("rules", ["dict(spp=400)", "dict(noise=0.02, adaptive=True)"])
def test_killed_at_any_moment(rules: str) -> None:
    """A render that is killed again and again, and resumed, has the bits of one that was not."""
    moments = random.Random(7)
    command = [sys.executable, "-W", "ignore", "-c", WORKER, rules]
    kills = 0
    for _ in range(KILLS // 2):
        worker = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert worker.stdout is not None and worker.stdout.readline() == "ready\n"
        try:
            worker.wait(moments.uniform(0, 0.15))
        except subprocess.TimeoutExpired:
            worker.send_signal(signal.SIGKILL)
            kills += 1
        worker.communicate()
        if Path("a.ckpt").exists():
            checkpoint.read(Path("a.ckpt"))
    assert kills >= KILLS // 4
    subprocess.run(command, check=True, capture_output=True, timeout=120)
    expected = lajolla.load("scene.xml").rendering(**eval(rules))
    expected.run()
    saved = checkpoint.read(Path("a.ckpt"))
    np.testing.assert_array_equal(saved.counts, expected.accumulator.counts)
    np.testing.assert_array_equal(saved.image().array, expected.image().array)
    if not kills:  # rays of tiles that a kill cut off are not counted
        np.testing.assert_array_equal(saved.rays, expected.accumulator.rays)


def test_an_interrupted_render_leaves_a_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    """By SIGTERM, as a test run in the background may ignore SIGINT."""
    monkeypatch.setattr("lajolla.render.POLL_SECONDS", 0.001)

    def interrupt(self: checkpoint.Saver) -> None:
        if self.rendering.accumulator.counts.min() >= 2:
            os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(checkpoint.Saver, "write_if_due", interrupt)
    assert run("render scene.xml --spp 30000 -o a.exr --checkpoint a.ckpt") == 143
    counts = checkpoint.read(Path("a.ckpt")).counts
    assert 2 <= counts.min() < 30_000


# --- refusals


def saved(words: str = "") -> Path:
    assert run(f"render scene.xml --spp 2 -o a.exr --checkpoint a.ckpt {words}") == 0
    return Path("a.ckpt")


@pytest.mark.parametrize(
    ("options", "difference"),
    [
        ("--seed 5", "sampler.seed is 0 and 5"),
        ("--size 20x20", "film.height is 40 and 20, film.width is 48 and 20"),
        ("--max-depth 7", "integrator.max_depth is 4 and 7"),
        ("-D level=0.7", "emitters differ"),
        ("--integrator depth", "integrator.field is not given and depth"),
        ("--sampler independent", "sampler.type is sobol and independent"),
    ],
)
def test_another_render_is_refused(options: str, difference: str, capsys: pytest.CaptureFixture[str]) -> None:
    saved()
    before = Path("a.ckpt").read_bytes()
    assert run(f"render scene.xml --spp 4 -o b.exr --resume a.ckpt {options}") == 1
    told = capsys.readouterr().err
    assert told.startswith("lajolla: error: a.ckpt: does not belong to this render: ") and difference in told
    assert Path("a.ckpt").read_bytes() == before and not Path("b.exr").exists()


def test_another_content_of_a_file_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    image.write(Path("t.png"), np.full((4, 4, 3), 0.5))
    textured = SCENE.replace(
        '<point name="center" x="0.3" z="4"/>',
        '<point name="center" x="0.3" z="4"/><bsdf type="diffuse"><texture name="reflectance" type="bitmap">'
        '<string name="filename" value="t.png"/></texture></bsdf>',
    )
    Path("scene.xml").write_text(textured)
    saved()
    image.write(Path("t.png"), np.full((4, 4, 3), 0.6))
    assert run("render scene.xml --spp 4 -o b.exr --resume a.ckpt") == 1
    assert "textures differ" in capsys.readouterr().err


def test_another_version_or_instruction_set_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    saved()
    monkeypatch.setattr(lajolla.processor, "level", lambda: "abacus")
    assert run("render scene.xml --spp 4 -o b.exr --resume a.ckpt") == 1
    told = rf"lajolla\.instruction_set is {lajolla._core.isa} on .* and {lajolla._core.isa} on abacus"
    assert re.search(told, capsys.readouterr().err)
    monkeypatch.undo()


def test_an_existing_checkpoint_is_not_overwritten(capsys: pytest.CaptureFixture[str]) -> None:
    before = saved().read_bytes()
    assert run("render scene.xml --spp 4 -o b.exr --checkpoint a.ckpt") == 1
    assert "already exists; continue it with --resume" in capsys.readouterr().err
    assert Path("a.ckpt").read_bytes() == before


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.7, 0.999])
def test_half_a_file_is_refused(share: float, capsys: pytest.CaptureFixture[str]) -> None:
    data = saved().read_bytes()
    Path("a.ckpt").write_bytes(data[: int(share * len(data))])
    assert run("render scene.xml --spp 4 -o b.exr --resume a.ckpt") == 1
    assert capsys.readouterr().err == "lajolla: error: a.ckpt: is not a checkpoint, or is damaged\n"


def test_damaged_bytes_are_refused_or_harmless() -> None:
    """Whatever is changed, there is one message, or the checkpoint is read."""
    data = saved().read_bytes()
    rng = np.random.default_rng(3)
    for _ in range(150):
        broken = bytearray(data)
        for place in rng.integers(0, len(data), rng.integers(1, 4)):
            broken[place] = rng.integers(256)
        Path("b.ckpt").write_bytes(broken)
        try:
            checkpoint.read(Path("b.ckpt"))
        except CheckpointError as error:
            assert str(error).startswith("b.ckpt: ")


def altered(**changes: Any) -> None:  # noqa: ANN401
    """Changes facts or arrays of a.ckpt."""
    with np.load("a.ckpt") as archive:
        arrays = {name: archive[name] for name in archive.files}
    facts = json.loads(str(arrays["facts"]))
    facts |= {name: value for name, value in changes.items() if name in facts}
    arrays["facts"] = np.array(json.dumps(facts))
    arrays |= {name: value for name, value in changes.items() if name not in facts}
    np.savez("b.npz", **arrays)
    shutil.move("b.npz", "a.ckpt")


@pytest.mark.parametrize(
    "changes",
    [
        {"format": 99},
        {"width": 47},
        {"width": -1},
        {"height": 10**9},
        {"channels": []},
        {"channels": 5},
        {"film": {"colour": 1}},
        {"identity": 3},
        {"ranges": [[0]]},
        {"ranges": []},
        {"nonfinite_list": [[1]]},
        {"seconds": "long"},
        {"counts": np.zeros((1, 1, 2), np.uint32)},
        {"counts": np.zeros((5, 6, 2), np.float32)},
        {"digits": np.zeros((40, 48, 4, 2), np.float64)},
        {"places": np.full((40, 48, 4), 100, np.int8)},
        {"facts": np.array("{")},
        {"something": np.zeros(3)},
        {"counts": np.full((5, 6, 2), 7, np.uint32)},
        {"counts": np.zeros((5, 6, 2), np.uint32)},
        {"digits": np.full((40, 48, 4, 2), 2**63 - 1)},
        {"nonfinite_list": [[-1, 2, 3]]},
        {"seconds": float("nan")},
        {"aovs": ["variance"]},
        {"ranges": [[0, 4], [2, 1]]},
        {"changes": np.zeros((5, 6, 2))},
        {"width": 60_000, "height": 60_000},
    ],
)
def test_nonsense_is_refused(changes: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    saved()
    altered(**changes)
    assert run("merge a.ckpt -o b.exr") == 1
    message = capsys.readouterr().err
    assert message.startswith("lajolla: error: a.ckpt: is ") and message.count("\n") == 1


def test_a_file_that_unpacks_to_more_than_it_is_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with zipfile.ZipFile("a.ckpt", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("facts.npy", bytes(1 << 24))
    assert run("merge a.ckpt -o b.exr") == 1
    assert "damaged" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["none.ckpt", ".", "scene.xml"])
def test_what_is_no_checkpoint(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(f"render scene.xml --spp 4 -o b.exr --resume {name} --checkpoint c.ckpt") == 1
    assert capsys.readouterr().err.startswith(f"lajolla: error: {name}: ")


@pytest.mark.parametrize(
    "words",
    [
        "render scene.xml -o a.npz --checkpoint a.npz",
        "render scene.xml -o a.exr --stats ./a.exr",
        "render scene.xml -o scene.xml --format exr",
        "merge a.ckpt -o a.ckpt --format exr",
        "merge a.ckpt --checkpoint b.exr -o b.exr",
    ],
)
def test_two_files_of_one_name_are_refused(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    before = saved().read_bytes()
    assert run(words) == 1
    assert "is named for two files" in capsys.readouterr().err
    assert Path("a.ckpt").read_bytes() == before and Path("scene.xml").read_text() == SCENE


@pytest.mark.parametrize(
    "words",
    [
        "render scene.xml --every 5s",
        "render scene.xml --checkpoint -",
        "render scene.xml --pixel 1,1 --checkpoint b.ckpt",
        "render scene.xml --pixel 1,1 --first-sample 5",
        "render scene.xml --pixel 1,1 --noise 5%",
        "merge a.ckpt a.ckpt -o b.exr",
    ],
)
def test_options_that_make_no_sense_are_refused(words: str) -> None:
    saved()
    assert run(words) == 1
    assert sorted(os.listdir()) == ["a.ckpt", "a.exr", "scene.xml"]


def test_samples_up_to_the_last_one() -> None:
    last = 2**30 - 1
    words = f"render scene.xml --time 0.2s --first-sample {last} -o a.exr"
    assert run(f"{words} --checkpoint a.ckpt") == 0
    assert run(f"{words} --resume a.ckpt") == 0
    assert checkpoint.read(Path("a.ckpt")).ranges == [(last, last + 1)]


def test_an_error_while_rendering_loses_no_samples(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(self: checkpoint.Saver) -> None:
        if self.rendering.samples >= 2:
            raise ArithmeticError("no reason")

    monkeypatch.setattr(checkpoint.Saver, "write_if_due", failing)
    assert run("render scene.xml --spp 4096 -o a.exr --checkpoint a.ckpt") == 1
    assert "error: ArithmeticError: no reason" in capsys.readouterr().err
    assert pixels("a.exr").shape == (40, 48, 4) and checkpoint.read(Path("a.ckpt")).counts.min() >= 1


def test_a_folder_that_cannot_be_written_is_told_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("render scene.xml --spp 4 -o b.exr --checkpoint none/a.ckpt") == 1
    assert "/none does not exist" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_loses_neither_the_old_checkpoint_nor_the_picture(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = saved().read_bytes()

    def full(file: Any, **arrays: np.ndarray) -> None:  # noqa: ANN401
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    monkeypatch.setattr("lajolla.render.POLL_SECONDS", 0.001)
    assert run("render scene.xml --spp 64 -o b.exr --resume a.ckpt --every 0.001s") == 1
    told = capsys.readouterr().err
    assert "warning: a.ckpt: cannot be written: No space left on device" in told
    *_, wrote, error = told.splitlines()
    assert wrote.startswith("lajolla: wrote b.exr (64 samples per pixel")
    assert error == "lajolla: error: a.ckpt: cannot be written: No space left on device"
    assert Path("a.ckpt").read_bytes() == before and pixels("b.exr").shape == (40, 48, 4)
    assert sorted(os.listdir()) == ["a.ckpt", "a.exr", "b.exr", "scene.xml"]


# --- merging


def test_merged_parts_equal_the_whole() -> None:
    for name, first, count in (("a", 0, 3), ("b", 3, 8), ("c", 11, 5)):
        words = f"--spp {count} --first-sample {first} -o {name}.exr --checkpoint {name}.ckpt"
        assert run(f"render scene.xml {words}") == 0
    assert run("render scene.xml --spp 16 -o whole.exr") == 0
    for order in itertools.permutations("abc"):
        assert run(f"merge {' '.join(f'{name}.ckpt' for name in order)} -o merged.exr") == 0
        np.testing.assert_array_equal(pixels("merged.exr"), pixels("whole.exr"))
    assert run("merge c.ckpt a.ckpt --checkpoint ac.ckpt") == 0
    assert checkpoint.read(Path("ac.ckpt")).ranges == [(0, 3), (11, 16)]
    assert run("merge ac.ckpt b.ckpt --checkpoint abc.ckpt -o merged.exr") == 0
    np.testing.assert_array_equal(pixels("merged.exr"), pixels("whole.exr"))
    assert run("render scene.xml --spp 20 -o more.exr --resume abc.ckpt") == 0
    assert run("render scene.xml --spp 20 -o whole.exr") == 0
    np.testing.assert_array_equal(pixels("more.exr"), pixels("whole.exr"))


def test_overlaps_gaps_and_strangers_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for name, words in {
        "a": "--spp 8",
        "b": "--spp 8 --first-sample 6",
        "c": "--spp 2 --first-sample 20",
        "d": "--spp 2 --first-sample 30 --seed 3",
        "e": "--spp 64 --adaptive",
    }.items():
        assert run(f"render scene.xml {words} -o {name}.exr --checkpoint {name}.ckpt") == 0
    told = capsys.readouterr
    assert run("merge a.ckpt b.ckpt -o m.exr") == 1
    assert "b.ckpt: has samples 6 to 7, which others have too" in told().err
    assert run("merge a.ckpt d.ckpt -o m.exr") == 1
    assert "d.ckpt: does not belong to a.ckpt: sampler.seed is 3 and 0" in told().err
    assert run("merge a.ckpt e.ckpt -o m.exr") == 1
    assert "e.ckpt: " in told().err
    assert run("merge a.ckpt c.ckpt --checkpoint ac.ckpt") == 0
    assert run("render scene.xml --spp 32 -o m.exr --resume ac.ckpt") == 1
    assert "has samples 0 to 7 and 20 to 21, and this render takes samples from 0 on" in told().err
    assert run("merge a.ckpt") == 1
    assert "name a picture to write with -o" in told().err
    assert not Path("m.exr").exists()


# --- hashes of scenes


def test_equal_contents_have_equal_hashes_and_others_differ() -> None:
    values: list[Any] = [
        1, 1.0, True, "1", None, [], [1], [1, 2], [[1], 2], {}, {"a": 1}, {"a": 2}, {"b": 1},
        np.zeros(2), np.zeros(2, np.float32), np.zeros((2, 1)), np.ones(2), [0.0, 0.0],
    ]  # fmt: skip
    digests = [ContentHash().digest(value) for value in values]
    assert len(set(digests)) == len(values)
    assert digests == [ContentHash().digest(value) for value in values]
    assert ContentHash().digest({"a": 1, "b": 2}) == ContentHash().digest({"b": 2, "a": 1})


def test_differences_are_named() -> None:
    a = sections({"shapes": list(range(9999)), "integrator": {"type": "path", "max_depth": 3}})
    b = sections({"shapes": list(range(9998)), "integrator": {"type": "path", "max_depth": 4}})
    assert differences(a, a) == []
    assert differences(a, b) == ["integrator.max_depth is 3 and 4", "shapes differ"]
