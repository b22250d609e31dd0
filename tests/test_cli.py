"""The command line, as its users see it."""

import argparse
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import lajolla
from lajolla import _core, cli, display, image, render_command
from lajolla.arguments import parse, replay_command
from lajolla.render import Progress, StopRules
from lajolla.survey import Finding, survey

SCENE = """\
<scene version="3.0.0">
    <default name="level" value="0.5"/>
    <integrator type="path"><integer name="max_depth" value="3"/></integrator>
    <sensor type="perspective">
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/></film>
        <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="$level"/></emitter>
    <shape type="sphere"><point name="center" x="0" y="0" z="5"/></shape>
</scene>
"""

UNKNOWN = SCENE.replace('type="sphere"', 'type="spere"')  # on line 9

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Every test works in an empty folder with a scene."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.xml").write_text(SCENE)
    return tmp_path


def files() -> set[str]:
    return {path.name for path in Path().iterdir()} - {"room.xml"}


def test_render_writes_exr_and_png_here(capsys: Capture) -> None:
    assert cli.main(["render", "room.xml"]) == 0
    assert files() == {"room.exr", "room.png"}
    assert image.read("room.exr").shape == (12, 16, 3)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "lajolla: wrote room.exr, room.png (4 samples per pixel in " in captured.err


def test_options_and_outputs(capsys: Capture) -> None:
    words = (
        "render room.xml -o a.pfm --output b.jpg --spp 2 --size 8x6 --seed 3 --threads 1 --quiet -D level=2"
    )
    assert cli.main(words.split()) == 0
    assert files() == {"a.pfm", "b.jpg"}
    np.testing.assert_allclose(image.read("a.pfm")[0, 0], 2, rtol=1e-6)
    assert image.read("a.pfm").shape == (6, 8, 3)
    assert capsys.readouterr().err == ""


def test_a_crop_is_part_of_the_whole() -> None:
    assert cli.main("render room.xml -o whole.pfm --quiet --max-depth 2".split()) == 0
    assert cli.main("render room.xml -o part.pfm --quiet --max-depth 2 --crop 4,3,5,6".split()) == 0
    whole, part = image.read("whole.pfm"), image.read("part.pfm")
    assert part.shape == (6, 5, 3)
    np.testing.assert_allclose(part.mean(), whole[3:9, 4:9].mean(), rtol=0.1)


def test_stats(capsys: Capture) -> None:
    assert cli.main("render room.xml --quiet --stats s.json".split()) == 0
    assert cli.main("render room.xml --quiet --stats /dev/stdout".split()) == 0
    for text in (Path("s.json").read_text(), capsys.readouterr().out):
        stats = json.loads(text)
        assert stats["samples"] == 4 * 16 * 12
        assert stats["samples_per_second"] == pytest.approx(stats["samples"] / stats["render_seconds"])
        assert stats["nonfinite_samples"] == 0
        for key in ("load_seconds", "build_seconds", "rays_per_second", "peak_memory_bytes"):
            assert stats[key] > 0


def test_stats_into_a_device_of_a_folder_that_is_not_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: str(path) != "/dev")
    for device in ("/dev/null", "/dev/stdout", "/dev/stderr"):
        assert cli.main(["render", "room.xml", "-o", "a.pfm", "--quiet", "--stats", device]) == 0


def test_an_output_named_twice_is_written_once(capsys: Capture) -> None:
    assert cli.main("render room.xml -o a.pfm -o a.pfm -o ./a.pfm".split()) == 0
    assert "wrote a.pfm (" in capsys.readouterr().err


def test_what_a_format_cannot_hold_is_problem_once(capsys: Capture) -> None:
    assert cli.main("render room.xml -o a.exr -o a.png --half --quiet -D level=1e6".split()) == 0
    error = capsys.readouterr().err
    assert error.startswith("lajolla: warning: a.exr: ")
    assert len(error.splitlines()) == 1


def test_stats_into_a_pipe() -> None:
    os.mkfifo("pipe")
    reader = subprocess.Popen(["cat", "pipe"], stdout=subprocess.PIPE)
    assert cli.main("render room.xml --quiet --stats pipe".split()) == 0
    out, _ = reader.communicate(timeout=30)
    assert json.loads(out)["samples_per_pixel"] == 4


def test_pixel(capsys: Capture) -> None:
    assert cli.main("render room.xml --pixel 0,0".split()) == 0
    assert cli.main("render room.xml --pixel 0,0 --sample 3".split()) == 0
    assert files() == set()
    for line in capsys.readouterr().out.splitlines():
        np.testing.assert_allclose([float(word) for word in line.split()], 0.5, rtol=1e-6)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            "",
            "a command is required: render, view, batch, denoise, check, convert, compare, merge, list, "
            "completion",
        ),
        ("rendr room.xml", "unknown command 'rendr'; did you mean 'render'?"),
        ("room.xml", "did you mean: lajolla render room.xml"),
        ("test", "./lajolla test"),
        ("render", "required: SCENE"),
        ("render room.xml --sp 3", "unknown option '--sp'; did you mean --spp?"),
        ("render room.xml more", "unknown argument 'more'"),
        ("render room.xml --spp 0", "argument --spp: spp must be in 1 to 1073741824, not 0"),
        ("render room.xml --spp many", "'many' is not a whole number"),
        ("render room.xml --size 10", "'10' is not WIDTHxHEIGHT"),
        ("render room.xml --crop 1,2,3", "'1,2,3' is not X,Y,WIDTH,HEIGHT"),
        ("render room.xml --crop 10,0,10,10", "reaches outside of the film, 16 x 12"),
        ("render room.xml --max-depth -2", "max_depth must be in -1 to"),
        ("render room.xml --integrator ao --strategy light", "the integrator 'ao' has no strategy"),
        ("render room.xml --integrator ao --footprint cone", "the integrator 'ao' has no footprint"),
        ("render room.xml --exposure inf", "not a number from -100 to 100"),
        ("render room.xml -D level", "'level' is not NAME=VALUE"),
        ("render room.xml --sample 1", "--sample needs --pixel"),
        ("render room.xml --sampler halton", "invalid choice: 'halton'"),
        ("render room.xml -o a --format jpgg", "no picture format 'jpgg'; did you mean 'jpg'?"),
        ("render room.xml -o -", "a picture on standard output needs --format"),
        ("render room.xml -o - --stats -", "cannot both go to standard output"),
        ("render - --spp 1", "name it with -o"),
        ("check --all -", "- is no folder"),
        ("completion csh", "invalid choice: 'csh'"),
        ("convert room.xml - --pack", "--pack writes meshes beside OUT; standard output has no room"),
        ("compare - -", "standard input holds one picture, not both"),
        ("convert room.xml ./room.xml", "room.xml is the scene itself"),
        ("render room.xml --pixel 0,0 --sample 99999999999", "sample must be in 0 to"),
        ("render room.xml --threads 100000", "threads must be in 1 to 1024"),
        ("render room.xml --seed 99999999999", "seed must be in 0 to 4294967295, not 99999999999"),
        ("render room.xml --size 99999999x1", "size must be in 1 to 65536, not 99999999"),
        ("render room.xml --pixel 16,0", "pixel 16,0 is outside of the picture, 16 x 12"),
        ("render room.xml --integrator pth", "unknown integrator 'pth'; did you mean 'path'?"),
        (
            "render room.xml -o a.psd",
            "a.psd: the format follows from the file's ending, which is one of .exr",
        ),
        ("render room.xml -o missing/a.exr", "does not exist"),
        ("render room.xml --stats missing/s.json", "does not exist"),
        ("render missing.xml", "missing.xml"),
        ("view missing.xml --no-browser", "missing.xml"),
        ("view room.xml --port 99999", "port must be in 0 to 65535"),
        ("view room.xml --compare missing.exr", "missing.exr: no such file"),
        ("check missing.xml", "missing.xml"),
        ("compare a.exr room.xml", "a.exr: no such file"),
        ("compare /dev/null room.xml", "/dev/null: not a file"),
        ("compare room.xml room.xml", "room.xml: cannot be read as a picture"),
        ("compare a.exr b.exr --diff d.exr", "PNG, JPEG or the like"),
        ("list bsfd", "unknown kind 'bsfd' of plugins; did you mean 'bsdf'?"),
        ("list bsdf difuse", "unknown bsdf 'difuse'; did you mean 'diffuse'?"),
    ],
)
def test_mistakes_get_one_clear_message(words: str, message: str, capsys: Capture) -> None:
    assert cli.main(words.split()) == 1
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.out == ""
    assert "Traceback" not in captured.err
    assert files() == set()


@pytest.mark.parametrize(
    "words",
    [
        *("check {}", "render {}", "convert {} a.xml", "compare {} {}", "convert room.xml {}"),
        *("render room.xml -o {}.png", "compare room.xml room.xml --diff {}.png"),
    ],
)
def test_too_long_names_are_shown_in_part(words: str, capsys: Capture) -> None:
    assert cli.main(words.format("x" * 5000, "x" * 5000).split()) == 1
    shown = capsys.readouterr().err
    assert f"{'x' * 77}...: " in shown and "File name too long\n" in shown and len(shown) < 200


def test_broken_scene_shows_the_place(capsys: Capture) -> None:
    Path("room.xml").write_text(SCENE.replace('type="sphere"', 'type="sphree"'))
    assert cli.main(["render", "room.xml", "--strict"]) == 1
    assert "room.xml:9:" in capsys.readouterr().err


def test_a_refusal_of_the_core_shows_the_place(capsys: Capture) -> None:
    Path("room.xml").write_text(
        SCENE.replace('type="sphere"', 'type="cylinder"').replace(
            "</shape>", ('<float name="radius" value="0"/></shape>')
        )
    )
    assert cli.main(["render", "room.xml"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("room.xml:9:5: error: ")
    assert "radius above zero" in error


def test_check(capsys: Capture) -> None:
    assert cli.main(["check", "room.xml"]) == 0
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert lines["picture"] == "16 x 12, 4 samples per pixel"
    assert lines["shapes"] == "1"
    assert lines["warnings"] == "0"


def test_check_all(capsys: Capture) -> None:
    folder = Path("scenes")
    folder.mkdir()
    (folder / "part.xml").write_text('<scene version="3.0.0"><emitter type="constant"/></scene>')
    sensor = '<integrator type="path"/><sensor type="perspective"/>'
    (folder / "whole.xml").write_text(
        f'<scene version="3.0.0"><include filename="part.xml"/>{sensor}<emitter type="laser"/></scene>'
    )
    (folder / "other.xml").write_text("<robot/>")
    (folder / "remark.xml").write_text("<?xml version='1.0'?><!-- no <scene> --><!-- at all --><robot/>")
    (folder / "library.xml").write_text("<COLLADA><scene/></COLLADA>")
    os.mkfifo(folder / "pipe.xml")
    (folder / "folder.xml").mkdir()
    assert cli.main(["check", "--all", "scenes"]) == 0
    capsys.readouterr()
    (folder / "broken.xml").write_text('<scene version="3.0.0"><sensr type="perspective"/></scene>')
    assert cli.main(["check", "--all", "scenes"]) == 1
    assert [line.split()[:3] for line in capsys.readouterr().out.splitlines()] == [
        ["scene", "opened", "warnings"],
        ["broken.xml", "no", "1:24:"],
        ["whole.xml", "yes", "1"],
        ["2", "scenes:", "1"],
    ]
    assert cli.main(["check", "--all", "scenes", "--strict"]) == 1
    assert capsys.readouterr().out.splitlines()[2].split()[:2] == ["whole.xml", "no"]
    (folder / "UTF-16.XML").write_text((folder / "whole.xml").read_text(), "utf-16")
    (folder / "two\nlines.xml").write_text("<!-- a -->\n<!-- b -->" + (folder / "whole.xml").read_text())
    cli.main(["check", "--all", "scenes"])
    rows = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    assert ["UTF-16.XML", "yes"] in rows and ["two\\nlines.xml", "yes"] in rows
    assert cli.main(["check", "--all", "room.xml"]) == 1
    assert "room.xml is no folder" in capsys.readouterr().err


def test_fragments_are_no_scenes(tmp_path: Path) -> None:
    """What is only there to be included is not listed, whether it opens by itself or not."""
    camera = '<sensor type="perspective"/>'
    texts = {
        "whole.xml": f'{camera}<shape type="cube"/><include filename="parts\\Metal.XML"/>',
        "wrapper.xml": '<default name="x" value="gold"/><include filename="whole.xml"/>'
        '<include filename="parts/bsdf-$x.xml"/>',
        "parts/metal.xml": '<bsdf type="conductor"/>',
        "parts/bsdf-gold.xml": '<ref id="nowhere"/>',
        "parts/other.xml": '<shape type="cube"/>',
    }
    (tmp_path / "all" / "parts").mkdir(parents=True)
    for name, content in texts.items():
        (tmp_path / "all" / name).write_text(f'<scene version="0.6.0">{content}</scene>')
    found = survey(tmp_path / "all", lajolla.load)
    assert [finding.path.name for finding in found] == ["other.xml", "whole.xml", "wrapper.xml"]


def test_whole_scenes_that_fail_are_listed(tmp_path: Path) -> None:
    """Unless a scene that opens is made with them, not only with one of the same name in another folder."""
    part = '<scene version="3.0.0"><sensor type="perspective"/></scene>'
    whole = part.replace("</scene>", '<shape type="cube"><ref id="none"/></shape></scene>')
    texts = {
        "a/scene.xml": whole,
        "b/wrapper.xml": '<scene version="3.0.0"><include filename="scene.xml"/></scene>',
        "b/scene.xml": part,
        "c/scene.xml": part,
        "d/whole.xml": whole,
        "d/wrapper.xml": '<scene version="3.0.0"><include filename="whole.xml"/></scene>',
        "e/parts/base.xml": part.replace("</scene>", '<include filename="parts/rest.xml"/></scene>'),
        "e/parts/rest.xml": '<scene version="3.0.0"><emitter type="constant"/></scene>',
        "e/wrapper.xml": '<scene version="3.0.0"><include filename="parts/base.xml"/></scene>',
    }
    folder = tmp_path / "all"
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    found = {str(f.path.relative_to(folder)): f.error for f in survey(folder, lajolla.load)}
    assert list(found) == [
        *("a/scene.xml", "b/wrapper.xml", "c/scene.xml", "d/whole.xml", "d/wrapper.xml", "e/wrapper.xml")
    ]
    assert [name for name, error in found.items() if error] == ["a/scene.xml", "d/whole.xml", "d/wrapper.xml"]


def test_neighbouring_parameters_stand_for_one_text(tmp_path: Path) -> None:
    parameters = "".join(f"$p{i}" for i in range(40))
    texts = {
        "a.xml": f'<include filename="part{parameters}-end.xml"/>',
        f"part{'x' * 100}-end.xml": '<shape type="cube"/>',
        f"part{'x' * 100}-and.xml": '<shape type="cube"/>',  # takes forever where each may be any text
    }
    (tmp_path / "all").mkdir()
    for name, content in texts.items():
        (tmp_path / "all" / name).write_text(f'<scene version="3.0.0">{content}</scene>')
    found = [finding.path.name for finding in survey(tmp_path / "all", lajolla.load)]
    assert found == ["a.xml", f"part{'x' * 100}-and.xml"]


def test_many_parameters_apart_are_matched_quickly() -> None:
    (folder := Path("all")).mkdir()
    texts = {
        "a.xml": f'<include filename="{"$p-a" * 14}b.xml"/>',
        "-a" * 60 + ".xml": '<shape type="cube"/>',  # a regular expression tries all ways to place 14 pieces
        "X-a" * 14 + "-yB.XML": '<shape type="cube"/>',  # other text where the last piece should begin
        "X-A" * 14 + "b.xml": '<shape type="cube"/>',
    }
    for name, content in texts.items():
        (folder / name).write_text(f'<scene version="3.0.0">{content}</scene>')
    found = {finding.path.name for finding in survey(folder, lajolla.load)}
    assert found == {*texts} - {"X-A" * 14 + "b.xml"}


def test_one_scene_does_not_end_a_survey() -> None:
    Path("a.xml").write_text("<scene/>")

    def open_scene(path: Path) -> lajolla.Scene:
        if path.name == "a.xml":
            raise ZeroDivisionError("by nothing\nat all")
        return SimpleNamespace(warnings=[])  # type: ignore[return-value]

    assert survey(Path(), open_scene) == [
        Finding(Path("a.xml"), error="ZeroDivisionError: by nothing"),
        Finding(Path("room.xml")),
    ]


def test_compare(capsys: Capture) -> None:
    image.write(Path("a.pfm"), np.full((2, 3, 3), 2.0))
    image.write(Path("b.pfm"), np.full((2, 3, 3), 1.0))
    assert cli.main("compare a.pfm b.pfm --diff d.png".split()) == 0
    rows = {line[:12].strip(): line[12:].split() for line in capsys.readouterr().out.splitlines()}
    assert rows["mean ratio"] == ["2"] * 3
    assert rows["RMSE"] == ["1"] * 3
    assert image.read("d.png")[0, 0].tolist() == [1, 0, 0]


def test_list(capsys: Capture) -> None:
    assert cli.main(["list"]) == 0
    everything = capsys.readouterr().out
    for kind in ("bsdf", "texture", "emitter", "shape", "sensor", "film", "rfilter", "sampler", "integrator"):
        assert f"{kind}\n" in everything
    assert cli.main(["list", "bsdf"]) == 0
    assert "  diffuse " in capsys.readouterr().out
    assert cli.main(["list", "bsdf", "diffuse"]) == 0
    assert "reflectance" in capsys.readouterr().out


def interrupting_display(signum: signal.Signals) -> Callable[..., object]:
    """A progress display that sends a signal to this process when four samples are done."""

    @contextmanager
    def progress_display(**settings: object) -> Iterator[display.Observer]:
        def observe(progress: Progress) -> None:
            if progress.samples >= 4:
                os.kill(os.getpid(), signum)

        yield observe

    return progress_display


@pytest.mark.usefixtures("as_from_a_terminal")
@pytest.mark.parametrize(("signum", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_render_saves_what_is_there(
    signum: signal.Signals, code: int, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(render_command, "progress_display", interrupting_display(signum))
    assert cli.main("render room.xml --spp 1000000 --stats s.json".split()) == code
    assert files() == {"room.exr", "room.png", "s.json"}
    samples = json.loads(Path("s.json").read_text())["samples_per_pixel"]
    assert 4 <= samples < 1_000_000
    assert f"({samples:.4g} of 1000000 samples per pixel" in capsys.readouterr().err


def test_interrupted_before_the_first_pass(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*arguments: object, **settings: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(render_command, "load", interrupted)
    assert cli.main("render room.xml".split()) == 130
    assert files() == set()
    assert capsys.readouterr().err == "lajolla: interrupted; nothing was written\n"


def test_one_bad_output_does_not_lose_the_others(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    write = image.write

    def failing(path: Path, *rest: object, **settings: object) -> None:
        if path.suffix == ".exr":
            raise image.ImageError(f"{path}: no space left on the disk")
        write(path, *rest, **settings)

    monkeypatch.setattr(image, "write", failing)
    assert cli.main(["render", "room.xml", "--quiet"]) == 1
    assert files() == {"room.png"}
    assert "room.exr: no space left" in capsys.readouterr().err


def test_progress_lines(capsys: Capture) -> None:
    observe = display.line_observer(pixels=1000)
    for samples in range(101):
        observe(Progress(samples, float(samples), StopRules(spp=100)))
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 9
    assert lines[1] == "lajolla: 20 % (20/100 spp, 1 ksamples/s, 1 min 20 s left)"


def test_nonfinite_samples_are_reported_with_a_replay(capsys: Capture) -> None:
    shared = "render room.xml -D level=2 --size 8x6 --crop 1,2,3,4 --seed 4 --max-depth 3"
    arguments = parse(f"{shared} -o a.exr --spp 99".split())
    accumulator = SimpleNamespace(nonfinite=2, nonfinite_list=[(3, 5, 7), (3, 5, 8)])
    render_command._report_nonfinite(SimpleNamespace(accumulator=accumulator), arguments)
    replay = f"lajolla {shared} --pixel 3,5 --sample 7"
    error = capsys.readouterr().err
    assert "2 samples were not finite" in error
    assert replay in error
    repeated = parse(replay.split()[1:])
    assert isinstance(repeated, argparse.Namespace)
    assert replay_command(repeated, 3, 5, 7) == replay


def test_the_replay_command_of_a_cropped_render_runs(capsys: Capture) -> None:
    arguments = parse("render room.xml --crop 4,3,5,6 -o a.pfm --quiet".split())
    replay = replay_command(arguments, 8, 8, 0)
    assert cli.main(replay.split()[1:]) == 0
    capsys.readouterr()
    assert cli.main("render room.xml --crop 4,3,5,6 -o a.pfm --quiet --spp 1".split()) == 0
    assert cli.main(replay.split()[1:]) == 0
    values = [float(word) for word in capsys.readouterr().out.split()]
    np.testing.assert_allclose(values, image.read("a.pfm")[5, 4], rtol=1e-5)


def run(*words: str, **settings: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lajolla", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, **settings)


def test_help_and_version() -> None:
    shown = run("--help")
    assert shown.returncode == 0
    for command in ("render", "check", "compare", "list", "./lajolla test"):
        assert command in shown.stdout
    assert run("--version").stdout == f"lajolla {version('lajolla')} ({_core.isa})\n"


def test_a_closed_pipe_is_no_traceback() -> None:
    pipeline = f"{sys.executable} -m lajolla list | head -n 1"
    result = subprocess.run(pipeline, shell=True, capture_output=True, text=True, timeout=60, check=False)
    assert result.stderr == ""
    assert len(result.stdout.splitlines()) == 1


def test_list_shows_what_is_required(capsys: Capture) -> None:
    assert cli.main(["list", "texture", "regular"]) == 0
    assert "830" not in capsys.readouterr().out
    assert cli.main(["list", "sensor", "perspective"]) == 0
    assert "default if neither is given" in capsys.readouterr().out


# --- for programs


def test_check_as_json(capsys: Capture) -> None:
    Path("room.xml").write_text(UNKNOWN)
    assert cli.main(["check", "room.xml", "--json"]) == 0
    captured = capsys.readouterr()
    facts = json.loads(captured.out)
    assert (facts["scene"], facts["width"], facts["height"], facts["error"]) == ("room.xml", 16, 12, None)
    assert facts["samples_per_pixel"] == 4 and facts["counts"]["shapes"] == 1 and facts["memory_bytes"] >= 0
    message = 'unknown shape "spere"; "sphere" is used'
    place = {"file": "room.xml", "line": 9, "column": 18}
    assert facts["warnings"] == [{"message": message, **place, "count": 1}]
    assert captured.err == ""


def test_a_refusal_as_json(capsys: Capture) -> None:
    Path("room.xml").write_text(UNKNOWN)
    assert cli.main(["check", "room.xml", "--json", "--strict"]) == 1
    captured = capsys.readouterr()
    refusal = json.loads(captured.out)["error"]
    assert (refusal["file"], refusal["line"], refusal["column"]) == ("room.xml", 9, 18)
    assert captured.err.startswith("room.xml:9:18: error: ")
    assert cli.main("check room.xml --json --crop 0,0,99,99".split()) == 1
    assert "reaches outside" in json.loads(capsys.readouterr().out)["error"]["message"]


def test_a_folder_as_json(capsys: Capture) -> None:
    Path("other.xml").write_text(SCENE.replace("</scene>", "<robot/></scene>"))
    assert cli.main(["check", "--all", ".", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["folder"], found["opened"], found["failed"]) == (".", 1, 1)
    assert [scene["scene"] for scene in found["scenes"]] == ["other.xml", "room.xml"]
    assert "robot" in found["scenes"][0]["error"] and found["scenes"][1]["error"] is None


def test_a_comparison_as_json(capsys: Capture) -> None:
    """What no number of JSON is becomes null."""
    image.write(Path("a.pfm"), np.full((2, 3, 3), (2.0, 1.0, 0.5)))
    image.write(Path("b.pfm"), np.full((2, 3, 3), (1.0, 0.0, 0.5)))
    assert cli.main("compare a.pfm b.pfm --json".split()) == 0
    found = json.loads(capsys.readouterr().out, parse_constant=lambda name: pytest.fail(name))
    assert found["mean_ratio"] == [2, None, 1]
    assert found["rmse"] == [1, 1, 0]
    assert set(found) == {"a", "b", "mean_ratio", "rmse", "relative_mse", "excluded_pixels"}


def test_json_is_documented(repository: Path, capsys: Capture) -> None:
    """docs/json.md has every key, and no other."""
    Path("room.xml").write_text(UNKNOWN)
    image.write(Path("a.pfm"), np.ones((2, 3, 3)))
    shown: list[str] = []
    for words in ("check room.xml", "check room.xml --strict", "check --all .", "compare a.pfm a.pfm"):
        cli.main([*words.split(), "--json"])
        shown += re.findall(r'"(\w+)":', capsys.readouterr().out)
    assert cli.main("render room.xml --quiet --stats -".split()) == 0
    shown += re.findall(r'"(\w+)":', capsys.readouterr().out)
    counts = set(json.loads(_checked(capsys))["counts"])
    documented = re.findall(r"^\| `(\w+)` \|", (repository / "docs" / "json.md").read_text(), re.MULTILINE)
    assert set(shown) - counts == set(documented)


def _checked(capsys: Capture) -> str:
    assert cli.main(["check", "room.xml", "--json"]) == 0
    return capsys.readouterr().out


# --- standard streams


def piped(*words: str, data: bytes = SCENE.encode()) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "lajolla", *words]
    return subprocess.run(command, input=data, capture_output=True, timeout=60, check=False)


def test_from_standard_input_to_standard_output() -> None:
    """The picture is that of the file, messages are elsewhere, and nothing is left behind."""
    assert run("render", "room.xml", "-o", "a.png", "--quiet").returncode == 0
    result = piped("render", "-", "-o", "-", "--format", "png", "--spp", "4")
    assert result.returncode == 0, result.stderr
    assert image.Image.open(result.stdout).array.shape == (12, 16, 3)
    np.testing.assert_array_equal(image.read(result.stdout), image.read("a.png"))
    assert b"wrote standard output (4 samples per pixel" in result.stderr
    assert files() == {"a.png"}


def test_files_of_a_scene_on_standard_input_are_here(folder: Path) -> None:
    image.write(Path("sky.pfm"), np.full((2, 4, 3), 3.0))
    sky = '<emitter type="envmap"><string name="filename" value="sky.pfm"/></emitter>'
    scene = SCENE.replace('<emitter type="constant"><rgb name="radiance" value="$level"/></emitter>', sky)
    result = piped("render", "-", "-o", "a.pfm", "--quiet", data=scene.encode())
    assert result.returncode == 0, result.stderr
    np.testing.assert_allclose(image.read("a.pfm")[0, 0], 3, rtol=1e-5)
    two = scene.replace("</scene>", '<sensor type="perspective" id="b"/></scene>').replace(
        '<sensor type="perspective">', '<sensor type="perspective" id="a">'
    )
    words = "render - -o s.pfm --all-sensors --spp 1 --size 2x2 --quiet".split()
    assert piped(*words, data=two.encode()).returncode == 0
    assert {"s-a.pfm", "s-b.pfm"} <= files()
    assert piped("convert", "-", "new.xml", data=scene.encode()).returncode == 0
    assert "sky.pfm" in Path("new.xml").read_text()


def test_mistakes_on_standard_input_have_a_place() -> None:
    result = piped("check", "-", "--strict", data=UNKNOWN.encode())
    assert result.returncode == 1
    assert result.stderr.startswith(b"<stdin>:9:18: error: ")
    assert result.stdout == b""


def test_a_full_standard_output_loses_no_other_picture() -> None:
    command = [sys.executable, "-m", "lajolla", *"render room.xml -o - -o b.png --format png --quiet".split()]
    with open("/dev/full", "wb") as full:
        result = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, timeout=60, check=False)
    assert result.returncode == 1
    wrote, error = result.stderr.splitlines()
    assert wrote.startswith(b"lajolla: wrote b.png (")
    assert error == b"lajolla: error: standard output: cannot be written: No space left on device"
    assert files() == {"b.png"}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("-o a.png --half", "lajolla: warning: --half is for .exr files only\n"),
        ("-o a.hdr --compression piz", "lajolla: warning: --compression is for .exr files only\n"),
        ("-o a.exr --exposure 1", "lajolla: warning: --exposure is for PNG, JPEG and the like only\n"),
        ("-o a.exr -o a.png --exposure 1 --half", ""),
    ],
)
def test_options_that_change_nothing_are_told(words: str, told: str, capsys: Capture) -> None:
    assert cli.main(f"render room.xml --quiet {words}".split()) == 0
    assert capsys.readouterr().err == told


@pytest.mark.parametrize(
    "words",
    [
        *("render room.xml -o - --format png", "render room.xml -o a.png --stats -", "compare a.png b.png"),
        *("render room.xml --pixel 0,0", "check room.xml", "convert room.xml -", "list", "completion bash"),
    ],
)
def test_a_closed_standard_output_is_found_first(words: str) -> None:
    """Without rendering anything, which would be lost."""
    command = shlex.join([sys.executable, "-m", "lajolla", *words.split()]) + " >&-"
    result = subprocess.run(command, shell=True, stderr=subprocess.PIPE, timeout=60, check=False)
    assert result.returncode == 1
    assert result.stderr == b"lajolla: error: standard output is closed, and the result belongs there\n"
    assert files() == set()


def test_a_picture_on_standard_input_is_compared() -> None:
    image.write("a.pfm", np.full((2, 3, 3), 0.5))
    result = piped("compare", "-", "a.pfm", data=Path("a.pfm").read_bytes())
    assert result.returncode == 0 and result.stdout == piped("compare", "a.pfm", "a.pfm").stdout
    assert piped("compare", "a.pfm", "-").stderr.startswith(b"lajolla: error: <stdin>: cannot be read")


def test_a_converted_scene_on_standard_output() -> None:
    """It is the text of the file, with messages elsewhere; what needs more files is refused."""
    named = SCENE.replace("<shape", '<shape id="Kugel-\N{LATIN SMALL LETTER A WITH DIAERESIS}"')
    Path("room.xml").write_text(named, encoding="utf-8")
    assert run("convert", "room.xml", "new.xml").returncode == 0
    for result in (
        piped("convert", "-", "-", data=named.encode()),
        piped("convert", "room.xml", "/dev/stdout"),
    ):
        assert result.returncode == 0, result.stderr
        assert result.stdout == Path("new.xml").read_bytes()
        assert result.stderr == b"lajolla: wrote standard output\n"
    mesh = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    mesh += (
        "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    )
    Path("\udcff.ply").write_text(mesh)  # a name that XML cannot hold, so that the mesh is copied
    text = SCENE.replace(
        "</scene>", '<shape type="ply"><string name="filename" value="\xff.ply"/></shape></scene>'
    )
    result = piped("convert", "-", "-", data=text.encode())
    assert result.returncode == 1 and result.stdout == b""
    assert b"name a file instead of standard output" in result.stderr
    assert files() == {"new.xml", "\udcff.ply"}


def test_no_picture_goes_to_a_terminal(monkeypatch: pytest.MonkeyPatch, capsys: Capture) -> None:
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    assert cli.main("render room.xml -o - --format png".split()) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "standard output is a terminal" in captured.err


def test_a_format_for_names_without_one() -> None:
    assert cli.main("render room.xml -o a -o b.png -o c.part --format JPG --quiet --spp 1".split()) == 0
    starts = {name: Path(name).read_bytes()[:2] for name in ("a", "b.png", "c.part")}
    assert starts == {"a": b"\xff\xd8", "b.png": b"\x89P", "c.part": b"\xff\xd8"}
    assert cli.main("render room.xml --format tif --quiet --spp 1".split()) == 0
    assert files() == {"a", "b.png", "c.part", "room.tif"}


# --- messages


def test_warnings_are_problem_once(capsys: Capture) -> None:
    Path("room.xml").write_text(UNKNOWN)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert cli.main("render room.xml -o a.npy --spp 1 --quiet".split()) == 0
        assert cli.main("convert room.xml new.xml".split()) == 0
        assert cli.main("check --all .".split()) == 0
    assert not caught
    assert capsys.readouterr().err.count("spere") == 4  # twice in each message
    assert run("render", "room.xml", "-o", "a.npy", "--spp", "1", "--quiet").stderr.count("warning") == 1


@pytest.mark.parametrize(
    ("environment", "terminal", "expected"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"NO_COLOR": "1"}, True, False),
        ({"NO_COLOR": ""}, True, True),
        ({"FORCE_COLOR": "1"}, False, True),
        ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, True, False),
        ({"TERM": "dumb"}, True, False),
    ],
)
def test_colours_are_for_terminals(
    environment: dict[str, str], terminal: bool, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    stream = SimpleNamespace(isatty=lambda: terminal)
    assert display.shows_colours(stream) is expected  # type: ignore[arg-type]


def test_severity_and_caret_are_coloured(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    Path("room.xml").write_text(UNKNOWN)
    assert cli.main(["render", "room.xml", "--strict"]) == 1
    lines = capsys.readouterr().err.splitlines()
    red, plain = "\x1b[1;31m", "\x1b[0m"
    assert lines[0].startswith(f"room.xml:9:18: {red}error{plain}: ")
    assert lines[2] == " " * 17 + f"{red}^{plain}"
    assert cli.main(["render", "room.xml", "-o", "a.psd"]) == 1
    assert capsys.readouterr().err.startswith(f"lajolla: {red}error{plain}: a.psd: ")
    assert cli.main(["check", "room.xml"]) == 0
    assert "\x1b[1;33mwarning\x1b[0m" in capsys.readouterr().out


# --- help and completion


@pytest.mark.parametrize("command", ["", "render", "check", "convert", "compare", "list", "completion"])
def test_help_is_whole(command: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names keep their capitals, everything is explained, examples are parsed, and lines fit."""
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        cli.main([command, "--help"] if command else ["--help"])
    text = capsys.readouterr().out
    assert "mitsuba 3" not in text and "examples:" in text
    assert max(map(len, text.splitlines())) <= 112
    for line in re.findall(r"^  lajolla (.*)$", text, re.MULTILINE):
        words = shlex.split(re.split(r"\s{2,}| [<>|]", line)[0])
        if "--help" not in words:
            parse(words)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "tcsh"])
def test_completion(shell: str, capsys: Capture) -> None:
    assert cli.main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for word in ("compare", "max-depth", "volpath", "roughconductor", "reinhard", "webp"):
        assert word in script, word
    if shutil.which(shell):
        assert subprocess.run([shell, "-n"], input=script, text=True, check=False).returncode == 0


def test_bash_completes(capsys: Capture) -> None:
    if not shutil.which("bash"):
        pytest.skip("there is no bash")
    assert cli.main(["completion", "bash"]) == 0
    Path("script").write_text(capsys.readouterr().out)

    def completed(*words: str) -> list[str]:
        line = f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}"
        code = f'source ./script; {line}; _shtab_lajolla; echo "${{COMPREPLY[@]}}"'
        shown = subprocess.run(["bash", "-c", code], capture_output=True, text=True, check=True)
        return shown.stdout.split()

    assert completed("lajolla", "co") == ["convert", "compare", "completion"]
    assert completed("lajolla", "render", "--max") == ["--max-depth"]
    assert completed("lajolla", "render", "--integrator", "volpathm") == ["volpathmis"]
    assert completed("lajolla", "list", "bs") == ["bsdf"]


# --- the sampler


def test_the_sampler_is_chosen_on_the_command_line() -> None:
    """Every sampler of a scene means the same; independent points have to be asked for."""
    Path("other.xml").write_text(SCENE.replace('"independent"', '"multijitter"'))
    for name, words in (
        ("a", "room.xml"),
        ("b", "other.xml"),
        ("c", "room.xml --sampler sobol"),
        ("d", "room.xml --sampler independent"),
    ):
        assert cli.main(f"render {words} -o {name}.npy --quiet".split()) == 0
    a, b, c, d = (np.load(f"{name}.npy") for name in "abcd")
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(a, c)
    assert not np.array_equal(a, d)
    replay = replay_command(parse("render room.xml --sampler independent".split()), 1, 2, 3)
    assert "--sampler independent" in replay
