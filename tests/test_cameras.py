"""Which of a scene's cameras is looked through."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

import lajolla
from lajolla import cli, image
from lajolla.arguments import parse
from lajolla.scene import SceneError, load_description, sensor_names
from lajolla.scene.description import cameras
from lajolla.series import for_each_sensor

FILM = '<film type="hdrfilm"><integer name="width" value="{}"/><integer name="height" value="3"/></film>'
LEFT = f'<sensor type="perspective" id="left">{FILM.format(4)}</sensor>'
MIDDLE = f'<sensor type="orthographic">{FILM.format(5)}</sensor>'
RIGHT = f'<sensor type="perspective" id="right side">{FILM.format(6)}</sensor>'


def written(folder: Path, sensors: str, version: str = "3.0.0") -> Path:
    path = folder / "scene.xml"
    path.write_text(
        f'<scene version="{version}"><integrator type="path"/><emitter type="constant"/>{sensors}</scene>'
    )
    return path


@pytest.mark.parametrize(
    "asked, width",
    [(None, 4), (0, 4), (1, 5), (2, 6), ("1", 5), ("left", 4), ("right side", 6)],
)
def test_one_of_several_is_chosen(asked: str | int | None, width: int, tmp_path: Path) -> None:
    scene = lajolla.load(written(tmp_path, LEFT + MIDDLE + RIGHT), sensor=asked)
    assert scene.width == width and scene.sensors == ("left", "1", "right side")
    assert scene.warnings == []


def test_old_files_show_the_last(tmp_path: Path) -> None:
    assert lajolla.load(written(tmp_path, LEFT + MIDDLE, "0.6.0")).width == 5
    assert lajolla.load(written(tmp_path, LEFT + MIDDLE, "0.6.0"), sensor=0).width == 4


@pytest.mark.parametrize(
    "asked, hint",
    [("3", "the scene's sensors are: left, 1, right side"), ("lefd", 'did you mean "left"'), (7, "7")],
)
def test_a_camera_that_is_not_there(asked: str | int, hint: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError) as caught:
        lajolla.load(written(tmp_path, LEFT + MIDDLE + RIGHT), sensor=asked)
    assert "unknown sensor" in str(caught.value) and hint in str(caught.value)
    with pytest.raises(lajolla.OptionError):
        lajolla.load(written(tmp_path, LEFT), sensor=-1)


BATCH = """<sensor type="batch"><film type="hdrfilm"><integer name="width" value="64"/>
    <integer name="height" value="32"/><rfilter type="box"/></film>{}</sensor>"""
VIEW = '<sensor type="{}" {}><film type="hdrfilm"/></sensor>'


def test_a_batch_is_its_cameras(tmp_path: Path) -> None:
    """Side by side on its film, as in Mitsuba."""
    inner = VIEW.format("perspective", 'id="a"') + VIEW.format("orthographic", "")
    path = written(tmp_path, BATCH.format(inner))
    assert sensor_names(path) == ("a", "1")
    for asked, kind in ((None, "perspective"), ("a", "perspective"), (1, "orthographic")):
        core = load_description(path, sensor=asked).core
        assert core["sensor"]["type"] == kind and core["rfilter"]["type"] == "box"
        assert (core["film"]["width"], core["film"]["height"]) == (32, 32)
    referred = VIEW.format("perspective", 'id="a"') + BATCH.format('<ref id="a"/>')
    assert sensor_names(written(tmp_path, referred)) == ("a",)
    with pytest.raises(SceneError, match="needs sensors inside"):
        load_description(written(tmp_path, BATCH.format("")))


def test_a_window_of_a_batch_is_left_out(tmp_path: Path) -> None:
    windowed = BATCH.replace("<rfilter", '<integer name="crop_offset_x" value="40"/><rfilter')
    description = load_description(written(tmp_path, windowed.format(VIEW.format("perspective", ""))))
    assert description.core["film"]["crop_offset_x"] == 0
    assert [w.message for w in description.warnings] == [
        'the window of the film "hdrfilm" of sensor "batch" is ignored'
    ]


def test_a_batch_in_a_dict() -> None:
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "light": {"type": "constant"},
        "both": {"type": "batch", "one": {"type": "perspective"}, "two": {"type": "perspective", "fov": 20}},
    }
    loaded = lajolla.load_dict(scene, sensor=1, size=(4, 4))
    assert loaded.sensors == ("0", "1") and loaded.render(spp=1).array.min() == 1


def test_a_camera_in_a_shape_is_named(tmp_path: Path) -> None:
    inside = '<shape type="cube"><sensor type="irradiancemeter"/></shape>'
    with pytest.raises(SceneError, match='sensor "irradiancemeter" inside of shape "cube" cannot be used'):
        load_description(written(tmp_path, inside))
    told = " ".join(w.message for w in load_description(written(tmp_path, inside, "0.6.0")).warnings)
    assert 'sensor "irradiancemeter" inside of shape "cube"' in told


def test_a_picture_of_each_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, LEFT + MIDDLE + RIGHT)
    assert cli.main(["check", str(path)]) == 0
    told = capsys.readouterr()
    assert 'the scene has 3 sensors, left, 1, right side; "left" is used' in told.out + told.err
    command = ["render", str(path), "--all-sensors", "--spp", "1", "--quiet"]
    assert cli.main([*command, "-o", "a.exr", "-o", "b.png", "--stats", "s.json"]) == 0
    for name, width in (("left", 4), ("1", 5), ("right_side", 6)):
        assert image.read(f"a-{name}.exr").shape == (3, width, 3)
        assert Path(f"b-{name}.png").is_file() and Path(f"s-{name}.json").is_file()
    assert cli.main(command) == 0
    assert np.all(image.read("scene-left.exr") == 1)
    assert cli.main([*command, "--sensor", "1"]) == 1
    assert cli.main(["render", str(path), "--sensor", "right side", "--spp", "1", "-o", "c.exr"]) == 0
    assert image.read("c.exr").shape[1] == 6


def test_names_of_files_do_not_collide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, LEFT.replace("left", "a b") + RIGHT.replace("right side", "a/b"))
    assert cli.main(["render", str(path), "--all-sensors", "--spp", "1", "-o", "x.exr"]) == 0
    assert sorted(file.name for file in tmp_path.glob("*.exr")) == ["x-0-a_b.exr", "x-1-a_b.exr"]
    (tmp_path / "old").mkdir()
    path = written(tmp_path / "old", '<shape type="cube"/>', "0.5.0")
    command = f"render {path} --all-sensors --size 4x4 --spp 1 -o y.exr"
    assert cli.main(command.split()) == 0 and Path("y.exr").is_file()


def test_numbers_tell_all_files_apart_as_soon_as_any_two_clash() -> None:
    arguments = parse("render scene.xml --all-sensors -o x.exr".split())
    outputs = [each.arguments.outputs[0].name for each in for_each_sensor(arguments, ["a", "a", "0-a"])]
    assert outputs == ["x-0-a.exr", "x-1-a.exr", "x-2-0-a.exr"]


def test_all_outputs_are_checked_before_the_first_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, LEFT + RIGHT)
    Path("x-right_side.exr").mkdir()
    assert cli.main(["render", str(path), "--all-sensors", "--spp", "1", "-o", "x.exr"]) == 1
    assert not Path("x-left.exr").exists()


def test_an_error_names_its_camera_and_spares_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, LEFT.replace('value="4"', 'value="0"') + RIGHT)
    assert cli.main(["render", str(path), "--all-sensors", "--spp", "1", "-o", "x.exr", "--quiet"]) == 1
    assert image.read("x-right_side.exr").shape[1] == 6
    assert capsys.readouterr().err.endswith("lajolla: sensor left failed\n")


def test_streams_and_pipes_keep_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.pfm")
    two = ["render", str(written(tmp_path, LEFT + RIGHT)), "--all-sensors", "--spp", "1", "--quiet"]
    assert cli.main([*two, "-o", "a.pfm", "--stats", "/dev/stdout"]) == 0
    assert capsys.readouterr().out.count('"samples_per_pixel": 1') == 2
    assert cli.main([*two, "-o", "a.pfm", "--stats", "/dev/null"]) == 0
    for words in ("-o pipe.pfm", "-o a.pfm --stats pipe.pfm"):
        assert cli.main([*two, *words.split()]) == 1
        message = "pipe.pfm takes one file; --all-sensors writes 2"
        assert capsys.readouterr().err == f"lajolla: error: {message}\n"
    one = ["render", str(written(tmp_path, LEFT)), "--all-sensors", "--spp", "1", "--quiet"]
    reader = subprocess.Popen(["cat", "pipe.pfm"], stdout=subprocess.PIPE)
    assert cli.main([*one, "-o", "pipe.pfm"]) == 0
    assert reader.communicate(timeout=30)[0].startswith(b"PF")


def test_converted_batches_open_in_mitsuba(tmp_path: Path) -> None:
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    inner = VIEW.format("perspective", 'id="a"') + VIEW.format("orthographic", "")
    path = written(tmp_path, BATCH.format(inner))
    assert cli.main(["convert", str(path), str(tmp_path / "new.xml")]) == 0
    sensors = mitsuba.load_file(str(tmp_path / "new.xml")).sensors()
    assert [tuple(sensor.film().size()) for sensor in sensors] == [(32, 32)] * 2


def test_no_exception_of_python_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever fails before anything is built."""

    class Broken(dict[str, object]):
        def items(self) -> NoReturn:  # type: ignore[override]
            raise ValueError("it fell")

    with pytest.raises(SceneError, match="scene: error: it fell"):
        lajolla.load_dict(Broken(type="scene"))

    monkeypatch.setattr(cameras, "spread", lambda scene, diagnostics: 1 / 0)
    path = written(tmp_path, VIEW.format("perspective", ""))
    for reader in (sensor_names, load_description):
        with pytest.raises(SceneError, match="error: ZeroDivisionError"):
            reader(path)
