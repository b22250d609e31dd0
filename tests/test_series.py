"""Several renders of one command: frames, and the jobs of a file."""

import shlex
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import lajolla
from lajolla import cli, image
from lajolla.arguments import UsageError, parse
from lajolla.option_values import frames
from lajolla.series import for_each_frame, jobs_of

SCENE = """\
<scene version="3.0.0">
    <default name="level" value="1"/>
    <integrator type="path"/>
    <sensor type="perspective">
        <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="2"/></film>
        <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
    </sensor>
    <emitter type="constant"><rgb name="radiance" value="$level"/></emitter>
</scene>
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("sky.xml").write_text(SCENE)
    return tmp_path


def run(words: str) -> int:
    return cli.main([*shlex.split(words), "--quiet"])


def level(path: str) -> float:
    return round(float(image.read(path).mean()), 5)


# --- frames


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("7", [7]),
        ("1-3", [1, 2, 3]),
        ("0-10:5,7", [0, 5, 10, 7]),
        ("-2-1", [-2, -1, 0, 1]),
        ("1,1-2", [1, 2]),
    ],
)
def test_frames(text: str, expected: list[int]) -> None:
    assert list(frames(text)) == expected


@pytest.mark.parametrize("text", ["", "x", "3-1", "1-3:0", "1-", "1-9999999999", "0-99999999"])
def test_frames_that_there_are_not(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(f"render sky.xml --frames={text} -o a.pfm") == 1
    assert "frames" in capsys.readouterr().err


def test_frames_have_their_names_and_parameters() -> None:
    words = "render sky.xml --frames 0-4:2 -D level=1..3 -o a.pfm -o {frame:02}-{frame}.pfm --stats s.json"
    assert run(words) == 0
    found = {path.name for path in Path().glob("*.pfm")}
    assert found == {f"a-{n:04}.pfm" for n in (0, 2, 4)} | {f"{n:02}-{n}.pfm" for n in (0, 2, 4)}
    assert [level(f"a-{n:04}.pfm") for n in (0, 2, 4)] == [1, 2, 3]
    assert Path("s-0004.json").is_file()
    assert run("render sky.xml --frames 5 -D level={frame}") == 0
    assert level("sky-0005.exr") == 5


def test_names_without_frames_are_literal() -> None:
    assert run("render sky.xml -o {frame}.pfm -D level=2") == 0
    assert level("{frame}.pfm") == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--frames 1-2 -o {fram}.pfm", "there is no {fram}; did you mean 'frame'?"),
        ("--frames 1-2 -o - --format pfm", "standard output takes one file; --frames writes 2"),
        ("--frames 1-2 --pixel 1,1", "--frames cannot be combined with --pixel"),
        ("--keep-going -o a.pfm", "--keep-going needs --frames"),
        ("--skip-existing", "--skip-existing needs a picture"),
    ],
)
def test_mistakes(words: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(f"render sky.xml {words}") == 1
    assert message in capsys.readouterr().err
    assert not list(Path().glob("*.pfm"))


def test_an_error_ends_a_series_unless_it_keeps_going(capsys: pytest.CaptureFixture[str]) -> None:
    words = "render sky.xml --frames 1-3 -o a-{frame}.pfm -D level={frame}..0 "
    assert run(words) == 1  # "1..0" is no number
    assert capsys.readouterr().err.count("failed") == 1
    assert run(words + "--keep-going") == 1
    assert capsys.readouterr().err.count("failed") == 3


def test_existing_pictures_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("render sky.xml --frames 1-2 -o a.pfm") == 0
    assert "warning: all frames are equal" in capsys.readouterr().err
    Path("a-0001.pfm").unlink()
    assert run("render sky.xml --frames 1-2 -o a.pfm -D level=4 --skip-existing") == 0
    assert level("a-0001.pfm") == 4 and level("a-0002.pfm") == 1


def test_an_interrupted_frame_is_not_written() -> None:
    """Otherwise --skip-existing would take it for a finished one."""
    words = "render sky.xml --frames 1-9 -o a.pfm --spp 100000000 --checkpoint c.ckpt --every 0.1s"
    command = [sys.executable, "-m", "lajolla", *words.split()]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while process.poll() is None and not Path("c-0001.ckpt").exists():
            time.sleep(0.05)
        process.terminate()
        _, error = process.communicate(timeout=60)
    assert process.returncode == 128 + 15
    assert error.splitlines()[-1] == "lajolla: interrupted; nothing was written of frame 1 and those after it"
    assert not list(Path().glob("*.pfm"))


def test_a_scene_from_standard_input_has_frames() -> None:
    command = [sys.executable, "-m", "lajolla", *"render - --frames 1-2 -o a.pfm -D level={frame}".split()]
    result = subprocess.run(command, input=SCENE, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert [level("a-0001.pfm"), level("a-0002.pfm")] == [1, 2]


# --- files of jobs

JOBS = """\
spp = 2
size = "3x1"
[parameters]
level = 2

[[job]]
scene = "sky.xml"
output = ["a.pfm", "out/a.exr"]
half = true

[[job]]
scene = "sky.xml"
parameters = {level = [4, 8.5]}
output = "b-{level}.pfm"

[[job]]
scene = "sky.xml"
frames = "1-3"
parameters = {level = "1..2"}
output = "c{frame:03}.pfm"
"""


def test_jobs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "out").mkdir()
    Path("jobs.toml").write_text(JOBS)
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    assert run("batch ../jobs.toml --threads 1") == 0
    monkeypatch.chdir(folder)
    expected = {"a.pfm": 2, "b-4.pfm": 4, "b-8.5.pfm": 8.5, "c001.pfm": 1, "c002.pfm": 1.5, "c003.pfm": 2}
    assert {path.name: level(path.name) for path in Path().glob("*.pfm")} == expected
    assert image.read("a.pfm").shape == (1, 3, 3) and Path("out/a.exr").is_file()


def test_the_commands_of_jobs_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    Path("jobs.toml").write_text(JOBS)
    assert cli.main(["batch", "jobs.toml", "--dry-run"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert lines[2] == "lajolla render sky.xml -D level=8.5 --spp=2 --size=3x1 --output=b-8.5.pfm"
    for line in lines:
        parse(shlex.split(line)[1:])
    assert not list(Path().glob("*.pfm"))


def test_options_of_jobs_that_begin_with_no(capsys: pytest.CaptureFixture[str]) -> None:
    job = "scene = 'sky.xml'\noutput = 'a.pfm'\nview = true\nadaptive = false\n"
    for value, word in (("true", " --no-browser"), ("false", "")):
        Path("jobs.toml").write_text(f"{job}no-browser = {value}")
        assert cli.main(["batch", "jobs.toml", "--dry-run"]) == 0
        line = "lajolla render sky.xml --output=a.pfm --view --no-adaptive" + word
        assert capsys.readouterr().out.strip() == line
    Path("jobs.toml").write_text(f"{job}no-adaptive = true")
    assert cli.main(["batch", "jobs.toml", "--dry-run"]) == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('scene = "sky.xml"\nssp = 2', "there is no option \"ssp\"; did you mean 'spp'?"),
        ('scene = "sky.xml"\noutput = "a.pfm"\nspp = true', "'true' is not a whole number"),
        ('scene = "sky.xml"\noutput = "a.pfm"\nspp = -1', "spp"),
        ('scene = "sky.xml"\nspp = {a = 1}', '"spp" is a text or a number'),
        ('scene = "sky.xml"\nhalf = 3', '"half" is true or false, not 3'),
        ('scene = "sky.xml"\noutput = "{levle}.pfm"\nparameters = {level = 1}', "did you mean 'level'?"),
        ('scene = "sky.xml"\noutput = "{level:03}.pfm"\nparameters = {level = 1.5}', "no whole number"),
        ('scene = "sky.xml"\nparameters = 3', "parameters are a table"),
        ("scene = 'sky.xml'\noutput = 'a.pfm'\nframes = [1, 2]", '"frames" takes one value, not [1, 2]'),
        ("scene = 'sky.xml'\noutput = 'a.pfm'\nkeep-going = true", 'there is no option "keep-going"'),
        ("scene = 'sky.xml'\noutput = 'a.pfm'\nno-adaptive = true", "did you mean 'adaptive'?"),
        ("scene = 'sky.xml'\noutput = 'a.pfm'\nparameters = {level = []}", '"level" has no values'),
        ("scene = 'sky.xml'\noutput = []", "needs a picture: output ="),
        (
            "[[job]]\nscene = 'sky.xml'\noutput = 'a.pfm'\n[[job]]\nscene = 'sky.xml'\noutput = 'x/../a.pfm'",
            "job 2",
        ),
        ("spp = 3\noutput = 'a.pfm'", 'needs a scene: scene = "FILE"'),
        ("spp = ", "Invalid value"),
        ("job = 3", "[[job]]"),
        (
            "[[job]]\nscene = 'sky.xml'\noutput = 'a.pfm'\n[[job]]\nscene = 'sky.xml'\noutput = 'a.pfm'",
            "a.pfm is",
        ),
        (
            "[[job]]\nscene = 'sky.xml'\noutput = 'a.pfm'\n[[job]]\nspp = 3\nscene = 'sky.xml'\nfoo = 3",
            "job 2: there is no",
        ),
        (
            "scene = 'sky.xml'\nparameters = {level = [1, 2]}\noutput = 'a.pfm'",
            "is written by job 1, level=1 and job 1, level=2",
        ),
        ("scene = 'sky.xml'\nparameters = {level = [1, 2]}", "needs a picture: output ="),
        (
            "[[job]]\nscene = 'sky.xml'\noutput = 'a.pfm'\n[[job]]\nscene = 'no.xml'\noutput = 'b.pfm'",
            "jobs.toml: job 2: no.xml: no such file",
        ),
    ],
)
def test_mistakes_in_jobs(text: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("jobs.toml").write_text(text)
    assert run("batch jobs.toml") == 1
    assert message in capsys.readouterr().err
    assert not list(Path().glob("*.pfm"))


def test_files_that_are_no_jobs(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("missing.toml", "."):
        with pytest.raises(UsageError, match="cannot be read"):
            jobs_of(Path(name))
    Path("bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(UsageError, match="bytes"):
        jobs_of(Path("bytes.toml"))


def test_frames_of_several_sensors(folder: Path) -> None:
    sensors = '<sensor type="perspective" id="a"/><sensor type="perspective" id="b"/>'
    Path("two.xml").write_text(SCENE.replace("<emitter", sensors + "<emitter"))
    assert run("render two.xml --frames 1-2 --all-sensors -o x.pfm --size 2x2 --spp 1") == 0
    assert len({path.name for path in Path().glob("x*.pfm")}) == 6


# --- unchanged files

MESH = """\
<shape type="ply">
    <string name="filename" value="a.ply"/><transform name="to_world"><translate z="5"/></transform>
    <bsdf type="diffuse">
        <texture name="reflectance" type="bitmap"><string name="filename" value="t.png"/></texture>
    </bsdf>
</shape>
"""
TRIANGLE = """\
ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
-1 -1 0
{x} -1 0
0 1 0
3 0 1 2
"""


def test_unchanged_files_are_read_once() -> None:
    Path("mesh.xml").write_text(SCENE.replace("<emitter", MESH + "<emitter"))
    Path("a.ply").write_text(TRIANGLE.format(x=1))
    image.write_encoded(Path("t.png"), np.full((2, 2, 3), 128, np.uint8))

    def parts(scene: lajolla.Scene) -> tuple[object, object]:
        core = scene.description.core
        return core["shapes"][0]["mesh"], core["textures"][0]["image"]

    with pytest.warns(lajolla.SceneWarning, match="texture coordinates"):
        first = lajolla.load("mesh.xml")
    with pytest.warns(lajolla.SceneWarning, match="texture coordinates"):
        second = lajolla.load("mesh.xml", parameters={"level": 2}, reuse=first)
    assert all(a is b for a, b in zip(parts(first), parts(second), strict=True))
    np.testing.assert_array_equal(2 * first.render().array, second.render().array)
    Path("a.ply").write_text(TRIANGLE.format(x=1.25))
    with pytest.warns(lajolla.SceneWarning, match="texture coordinates"):
        third = lajolla.load("mesh.xml", reuse=second)
    assert parts(third)[0] is not parts(first)[0] and parts(third)[1] is parts(first)[1]


def test_frames_are_what_they_are_alone() -> None:
    words = "render sky.xml --frames 3 -o alone.pfm -D level={frame}"
    assert run(words) == 0
    arguments = parse("render sky.xml --frames 1-3 -o all.pfm -D level={frame}".split())
    assert [each.name for each in for_each_frame(arguments)] == ["frame 1", "frame 2", "frame 3"]
    assert run("render sky.xml --frames 1-3 -o all.pfm -D level={frame}") == 0
    assert Path("alone-0003.pfm").read_bytes() == Path("all-0003.pfm").read_bytes()


def test_consecutive_scenes_share_what_is_equal(monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture is that of a scene that shares nothing."""
    ball = """<shape type="sphere"><point name="center" x="$x" y="0" z="5"/>
        <bsdf type="diffuse"><rgb name="reflectance" value="$red, 0.5, 0.5"/></bsdf></shape>
        <shape type="cube"><transform name="to_world"><translate x="2" z="8"/></transform></shape>"""
    names = '<default name="x" value="0"/><default name="red" value="0.5"/><default name="fov" value="40"/>'
    scene = SCENE.replace("<emitter", ball + "<emitter").replace("<default", names + "<default")
    Path("ball.xml").write_text(
        scene.replace('type="perspective">', 'type="perspective"><float name="fov" value="$fov"/>')
    )
    built: list[object] = []
    make = lajolla._core.Scene

    def counted(description: object) -> object:
        built.append(description)
        return make(description)

    monkeypatch.setattr("lajolla.loaded_scene._core.Scene", counted)
    previous = lajolla.load("ball.xml", spp=4)
    for parameters in ({"fov": 50}, {"red": 0.9}, {"x": 1}, {"level": 3}, {"fov": 20, "x": -1, "red": 0.1}):
        previous = lajolla.load("ball.xml", spp=4, parameters=parameters, reuse=previous)
        assert len(built) == 1
        alone = make(previous.description.core)
        render = lajolla._core.Render(alone)
        render.advance(4)
        np.testing.assert_array_equal(previous.render().array, render.image())
    lajolla.load("ball.xml", spp=4, integrator="direct", reuse=previous)
    Path("ball.xml").write_text(scene.replace("</scene>", '<shape type="cube"/></scene>'))
    lajolla.load("ball.xml", spp=4, reuse=previous)
    assert len(built) == 2


def test_folders_of_frames_and_folders_with_braces(folder: Path) -> None:
    odd = folder / "{x}"
    odd.mkdir()
    for frame in (1, 2):
        (odd / f"f{frame}").mkdir()
    (odd / "sky.xml").write_text(SCENE)
    text = 'scene = "sky.xml"\nframes = "1-2"\noutput = ["f{frame}/a.pfm", "{{}}-{frame}.pfm"]'
    (odd / "jobs.toml").write_text("\ufeff" + text, encoding="utf-8")
    assert run("batch {x}/jobs.toml") == 0
    found = {str(path.relative_to(odd)) for path in odd.rglob("*.pfm")}
    assert found == {"f1/a.pfm", "f2/a.pfm", "{}-1.pfm", "{}-2.pfm"}


def test_an_error_in_a_frame_of_a_job_does_not_end_the_others(capsys: pytest.CaptureFixture[str]) -> None:
    job = 'scene = "sky.xml"\nframes = "0-2"\noutput = "a.pfm"\nparameters = {level = "{frame}"}'
    Path("jobs.toml").write_text(job.replace('"{frame}"', '"{frame}x"'))
    assert run("batch jobs.toml --keep-going") == 1
    error = capsys.readouterr().err
    assert [f"job 1, frame {frame} failed" in error for frame in range(3)] == [True] * 3
