"""What a start of the program costs: only what a command needs is loaded, and the core is asked once."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from lajolla import _core

HEAVY = ("numpy", "OpenImageIO", "rich", "scipy", "lajolla._core", "lajolla.scene")

LOADED = """
import sys
{code}
print(*(name for name in {names!r} if name in sys.modules))
"""

RUN = """
import lajolla.cli
try:
    lajolla.cli.main({words!r})
except SystemExit as end:
    assert not end.code
"""

LOAD_TWICE = """
from lajolla import _core

calls = 0
schema = _core.schema

def counted():
    global calls
    calls += 1
    return schema()

_core.schema = counted
import lajolla

scene = {"type": "scene", "light": {"type": "constant"}, "sensor": {"type": "perspective"}}
lajolla.load_dict(scene, size=(2, 2), integrator="path", max_depth=3)
lajolla.load_dict(scene, size=(2, 2))
list(lajolla.catalog.listing("integrator", None))
print(calls)
"""


def last_line(code: str, folder: Path) -> str:
    """The last line that a program of its own prints."""
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()[-1]


def loaded(code: str, names: tuple[str, ...], folder: Path) -> list[str]:
    """Which of these modules a program has loaded when it ends."""
    return last_line(LOADED.format(code=code, names=names), folder).split()


@pytest.mark.parametrize("code", ["import lajolla", "import lajolla.cli"])
def test_imports_are_light(code: str, tmp_path: Path) -> None:
    assert loaded(code, HEAVY, tmp_path) == []


@pytest.mark.parametrize("words", [["--help"], ["render", "--help"]], ids=" ".join)
def test_help_loads_nothing(words: list[str], tmp_path: Path) -> None:
    assert loaded(RUN.format(words=words), HEAVY, tmp_path) == []


def test_the_version_is_the_cores_too(tmp_path: Path) -> None:
    assert loaded(RUN.format(words=["--version"]), HEAVY, tmp_path) == ["lajolla._core"]


def test_mistakes_on_the_command_line_load_nothing(tmp_path: Path) -> None:
    assert loaded("import lajolla.cli\nassert lajolla.cli.main(['rendre']) == 1", HEAVY, tmp_path) == []


def test_a_render_loads_no_progress_bar_without_a_terminal(tmp_path: Path) -> None:
    (tmp_path / "room.xml").write_text('<scene version="3.0.0"><sensor type="perspective"/></scene>')
    words = "render room.xml --spp 1 --size 2x2 -o room.npy".split()
    assert loaded(RUN.format(words=words), ("OpenImageIO", "rich", "scipy"), tmp_path) == []
    assert (tmp_path / "room.npy").exists()


def test_the_core_is_asked_for_its_schema_once(tmp_path: Path) -> None:
    assert last_line(LOAD_TWICE, tmp_path) == "1"


def test_the_core_is_asked_once_about_a_bsdf(monkeypatch: pytest.MonkeyPatch) -> None:
    import lajolla

    asked: list[str] = []
    transmissive = _core.transmissive

    def counted(entry: dict) -> bool:
        asked.append(entry["type"])
        return transmissive(entry)

    monkeypatch.setattr(_core, "transmissive", counted)
    paint = {"type": "twosided", "inner": {"type": "plastic"}}
    balls = {f"ball{i}": {"type": "sphere", "bsdf": {"type": "ref", "id": "shared"}} for i in range(5)}
    lajolla.load_dict({"type": "scene", "shared": paint, "sensor": {"type": "perspective"}, **balls})
    assert asked == ["plastic"]


def test_plugins_nobody_asks_for_are_not_put_together(tmp_path: Path) -> None:
    code = """
import lajolla
from lajolla.scene import plugins_by_kind

lajolla.load_dict({"type": "scene", "sensor": {"type": "perspective"}}, size=(2, 2))
print(sum(len(plugins.made) for plugins in plugins_by_kind().values()))
"""
    assert int(last_line(code, tmp_path)) <= 8


def test_help_is_there_before_anybody_waits(tmp_path: Path) -> None:
    def seconds() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-m", "lajolla", "--help"], cwd=tmp_path, capture_output=True, check=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    assert min(seconds() for _ in range(3)) < 0.35


def test_names_of_the_package_are_found_when_asked_for() -> None:
    import lajolla

    assert set(lajolla.__all__) <= set(dir(lajolla))
    assert all(hasattr(lajolla, name) for name in dir(lajolla))
    with pytest.raises(AttributeError, match="'lajolla' has no attribute 'lod'"):
        _ = lajolla.lod
