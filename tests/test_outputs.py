"""Where files go: through links, into pipes and devices, under names of any bytes; nothing is left behind."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from reader_tools import messages

from lajolla import image, picture_formats, whole_files
from lajolla.scene import convert, load_description
from lajolla.scene.formats.voxels import vol_bytes

NAME = os.fsdecode(b"caf\xe9")  # latin-1, which is not UTF-8
PICTURE = np.full((2, 3, 3), 0.5, np.float32)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("ending", picture_formats.ENDINGS)
def test_a_pipe_gets_the_bytes_of_the_file(ending: str) -> None:
    pipe, file = Path("pipe" + ending), Path("file" + ending)
    os.mkfifo(pipe)
    received: list[bytes] = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()))
    reader.start()
    for path in (pipe, file):
        image.write(path, PICTURE)
    reader.join(timeout=30)
    assert pipe.is_fifo()
    assert len(received[0]) == len(file.read_bytes())
    assert sorted(os.listdir()) == sorted([pipe.name, file.name])


def test_devices_survive() -> None:
    Path("null.exr").symlink_to("/dev/null")
    Path("full.exr").symlink_to("/dev/full")
    image.write(Path("null.exr"), PICTURE)
    assert Path("/dev/null").is_char_device()
    with pytest.raises(image.ImageError, match="cannot be written: No space left"):
        image.write(Path("full.exr"), PICTURE)
    assert Path("/dev/full").is_char_device()


def test_the_name_that_is_given_tells_the_format() -> None:
    Path("stored.png").write_text("old")
    Path("picture.exr").symlink_to("stored.png")
    Path("new.pfm").symlink_to("not-there-yet.pfm")
    for name in ("picture.exr", "new.pfm"):
        image.write(Path(name), PICTURE)
        assert Path(name).is_symlink()
    assert Path("stored.png").read_bytes().startswith(b"\x76\x2f\x31\x01")  # OpenEXR
    assert Path("not-there-yet.pfm").read_bytes().startswith(b"PF")


def test_a_loop_of_links_is_refused() -> None:
    Path("a.exr").symlink_to("b.exr")
    Path("b.exr").symlink_to("a.exr")
    with pytest.raises(image.ImageError, match=r"a\.exr: is a link that leads to itself"):
        image.check_output("a.exr")


def test_what_a_killed_process_left_is_removed() -> None:
    code = """
import os, signal
from pathlib import Path
from lajolla import image, picture_formats, whole_files
with whole_files.replacing(Path("a.npy")) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", code], timeout=60, check=False)
    Path(".other.npy").write_text("not ours")
    assert len(os.listdir()) == 2
    image.write(Path("b.npy"), PICTURE)
    assert len(os.listdir()) == 3  # another file's is not touched
    with whole_files.replacing(Path("a.npy")) as ours:
        ours.write_text("being written")
        image.write(Path("a.npy"), PICTURE)
        assert ours.exists()
    assert sorted(os.listdir()) == [".other.npy", "a.npy", "b.npy"]


def left_by(process: object) -> Path:
    """The name of a temporary file for a.npy that another process would have."""
    with whole_files.replacing(Path("a.npy")) as ours:
        ours.write_text("")
    return Path(ours.name.replace(str(os.getpid()), str(process), 1))


def dead_process() -> int:
    child = subprocess.Popen(["true"])
    child.wait()
    return child.pid


def test_what_cannot_be_removed_does_not_matter() -> None:
    left_by(dead_process()).mkdir()  # as another user's file in a folder like /tmp
    left_by(10**30).touch()
    left_by("x").touch()
    image.write(Path("a.npy"), PICTURE)
    assert Path("a.npy").stat().st_size > 0


def test_process_ids_of_other_containers_mean_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    link = os.readlink
    space = "/proc/self/ns/pid"
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr(os, "readlink", lambda path: "pid:[1]" if path == space else link(path))
        theirs = left_by(dead_process())
    theirs.write_text("being written")
    ours = left_by(dead_process())
    ours.write_text("abandoned")
    image.write(Path("a.npy"), PICTURE)
    assert theirs.exists() and not ours.exists()


@pytest.mark.parametrize("ending", picture_formats.ENDINGS)
def test_names_of_any_bytes(ending: str) -> None:
    os.mkdir(NAME)
    image.write(Path(NAME, NAME + ending), PICTURE)
    assert os.listdir(NAME) == [NAME + ending]
    if ending not in picture_formats.MATRIX:
        np.testing.assert_allclose(image.read(Path(NAME, NAME + ending)), 0.5, atol=0.01)


SCENE = """<?xml version="1.0" encoding="latin-1"?>
<scene version="3.0.0">
    <integrator type="volpath"/><sensor type="perspective"/>
    <emitter type="envmap"><string name="filename" value="caf\xe9.exr"/></emitter>
    <shape type="obj">
        <string name="filename" value="caf\xe9.obj"/>
        <bsdf type="diffuse">
            <texture type="bitmap" name="reflectance"><string name="filename" value="caf\xe9.png"/></texture>
        </bsdf>
    </shape>
    <shape type="linearcurve">
        <string name="filename" value="caf\xe9.txt"/>
        <bsdf type="diffuse"><spectrum name="reflectance" filename="caf\xe9.spd"/></bsdf>
    </shape>
    <shape type="cube">
        <transform name="to_world"><translate z="5"/></transform>
        <medium name="interior" type="heterogeneous">
            <volume name="sigma_t" type="gridvolume"><string name="filename" value="caf\xe9.vol"/></volume>
        </medium>
    </shape>
</scene>"""


@pytest.fixture
def latin(tmp_path: Path) -> Path:
    """A folder and a scene with names in latin-1, and its files."""
    folder = tmp_path / NAME
    folder.mkdir()
    image.write(folder / f"{NAME}.exr", PICTURE)
    image.write(folder / f"{NAME}.png", PICTURE)
    (folder / f"{NAME}.obj").write_text("v 0 0 5\nv 1 0 5\nv 0 1 5\nvt 0 0\nf 1/1 2/1 3/1\n")
    (folder / f"{NAME}.txt").write_text("0 0 5 1\n0 1 5 1\n")
    (folder / f"{NAME}.spd").write_text("400 0.5\n700 0.5\n")
    (folder / f"{NAME}.vol").write_bytes(vol_bytes(np.ones((2, 2, 2, 1), np.float32)))
    scene = folder / f"{NAME}.xml"
    scene.write_bytes(SCENE.encode("latin-1"))
    return scene


def test_scenes_whose_files_have_any_names(latin: Path) -> None:
    assert messages(load_description(latin), latin.parent) == []


def test_what_xml_cannot_name_is_copied_when_a_scene_is_converted(latin: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "lajolla", "convert", str(latin), f"{NAME}.xml"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0
    assert result.stderr.endswith("files in caf?-files\n") and Path("caf?-files").is_dir()
    assert messages(load_description(tmp_path / f"{NAME}.xml"), tmp_path) == []


def test_files_that_xml_cannot_name_are_copied_once(tmp_path: Path) -> None:
    """And not at all where their content is packed anyway."""
    image.write(tmp_path / f"{NAME}.png", np.ones((2, 2, 3), np.float32))
    (tmp_path / f"{NAME}.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    texture = (
        '<texture type="bitmap" name="reflectance"><string name="filename" value="caf\xe9.png"/></texture>'
    )
    ball = f'<shape type="sphere"><bsdf type="diffuse">{texture}</bsdf></shape>'
    mesh = '<shape type="obj"><string name="filename" value="caf\xe9.obj"/></shape>'
    path = tmp_path / "scene.xml"
    path.write_text(f'<scene version="3.0.0"><sensor type="perspective"/>{ball}{ball}{mesh}</scene>', "utf-8")
    assert [Path(name).suffix for name in convert(path, tmp_path / "new.xml").files] == [".png", ".obj"]
    packed = convert(path, tmp_path / "new.xml", pack=True).files
    assert [Path(name).suffix for name in packed] == [".png", ".ply"]
    assert packed["new-files/0.png"] == (tmp_path / f"{NAME}.png").read_bytes()


FULL_DISK = """
mount -t tmpfs -o size=16k none disk && cp old.npy disk/a.npy && mkdir left
"$1" -m lajolla render room.xml --size 64x64 --spp 1 -o disk/a.npy >told 2>&1
echo $? >code
"$1" -c "$2" >>told 2>&1
cp disk/a.npy left && ls -A disk >names
"""
UNPACKED = [ending for ending in picture_formats.ENDINGS if ending not in (".webp", ".jxl")]
# A disk that is full only when the picture is saved: before rendering there is a look at the space.
SAVE = f"""
from pathlib import Path
import numpy as np
from lajolla import image
noise = np.random.default_rng(0).random((128, 128, 3), np.float32)
for ending in {UNPACKED}:
    try:
        image.write(Path("disk/a" + ending), noise)
    except image.ImageError as problem:
        print("error:", problem)
"""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can make a small file system")
def test_a_full_disk_costs_no_picture() -> None:
    Path("disk").mkdir()
    Path("room.xml").write_text('<scene version="3.0.0"><sensor type="perspective"/></scene>')
    image.write(Path("old.npy"), PICTURE)
    command = ["unshare", "-m", "sh", "-c", FULL_DISK, "sh", sys.executable, SAVE]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    if not Path("code").exists():
        pytest.skip(f"no small file system can be made here: {result.stderr.strip()}")
    told = Path("told").read_text()
    errors = [line for line in told.splitlines() if "error: " in line]
    assert Path("code").read_text() == "1\n"
    assert len(errors) == 1 + len(UNPACKED) and "disk/a.npy: no space left" in errors[0], told
    for line, ending in zip(errors[1:], UNPACKED, strict=True):
        assert line.startswith(f"error: disk/a{ending}: ") and not line.endswith("None"), told
    assert Path("names").read_text() == "a.npy\n"
    assert Path("left", "a.npy").read_bytes() == Path("old.npy").read_bytes()
