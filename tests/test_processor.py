"""Which build of the core runs, and that all of them draw the same picture."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import lajolla
from lajolla import processor
from lajolla.processor import LEVELS, LevelError, builds, choose, core_folders

ALL = list(LEVELS)
FLAGS = {
    level: {flag for below in ALL[: i + 1] for flag in LEVELS[below].split()} for i, level in enumerate(ALL)
}


@pytest.mark.parametrize("level", ALL)
def test_the_best_level_that_runs_is_chosen(level: str) -> None:
    assert choose(ALL, FLAGS[level]) == level
    assert choose(["x86-64-v2"], FLAGS[level]) == "x86-64-v2"


def test_one_feature_less_is_a_level_less() -> None:
    assert choose(ALL, FLAGS["x86-64-v4"] - {"avx512vl"}) == "x86-64-v3"
    assert choose(ALL, FLAGS["x86-64-v4"] - {"fma"}) == "x86-64-v2"


def test_a_level_that_is_named_is_taken() -> None:
    for level in ALL:
        assert choose(ALL, FLAGS["x86-64-v4"], level) == level


@pytest.mark.parametrize(
    "levels, flags, wanted, message",
    [
        (ALL, "x86-64-v4", "avx2", "LAJOLLA_ISA=avx2: this installation has x86-64-v2 x86-64-v3 x86-64-v4"),
        (ALL[:1], "x86-64-v4", "x86-64-v3", "LAJOLLA_ISA=x86-64-v3: this installation has x86-64-v2"),
        ([], "x86-64-v4", "x86-64-v3", "LAJOLLA_ISA=x86-64-v3: this installation has a single build"),
        (
            ALL,
            "x86-64-v2",
            "x86-64-v3",
            "this processor does not have abm avx avx2 bmi1 bmi2 f16c fma movbe xsave",
        ),
        (
            ALL[1:],
            "x86-64-v2",
            "",
            "lajolla needs a processor of at least x86-64-v3; this one does not have abm",
        ),
    ],
)
def test_what_cannot_run_is_told(levels: list[str], flags: str, wanted: str, message: str) -> None:
    with pytest.raises(LevelError, match=message):
        choose(levels, FLAGS[flags], wanted)


def test_builds_are_found_in_every_folder_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processor, "processor_flags", lambda: FLAGS["x86-64-v3"])
    monkeypatch.delenv("LAJOLLA_ISA", raising=False)
    package = [str(tmp_path / "sources"), str(tmp_path / "installed")]
    assert core_folders(package) == []
    folders = [tmp_path / "installed" / "levels" / level for level in reversed(ALL)]
    for folder in folders:
        folder.mkdir(parents=True)
    assert list(builds(package)) == ALL
    assert core_folders(package) == [str(folders[1])]
    monkeypatch.setenv("LAJOLLA_ISA", "x86-64-v2")
    assert core_folders(package) == [str(folders[2])]


def test_the_processor_of_this_machine_has_flags() -> None:
    if sys.platform == "linux" and os.uname().machine == "x86_64":
        assert {"fpu", "sse2"} <= (processor.processor_flags() or set())


def test_of_an_unknown_processor_the_lowest_level_is_taken() -> None:
    """As under an emulator, where /proc/cpuinfo is that of another architecture."""
    assert choose(ALL, None) == ALL[0]
    assert choose(ALL, None, ALL[2]) == ALL[2]


@pytest.mark.parametrize("state", ["wheel", "editable"])
def test_builds_of_ci_have_the_same_levels(repository: Path, state: str) -> None:
    """Settings of pyproject.toml that a condition adds to, instead of replacing all of them."""
    from scikit_build_core.settings.skbuild_read_settings import SettingsReader

    def defined(env: dict[str, str]) -> dict[str, object]:
        reader = SettingsReader.from_file(repository / "pyproject.toml", state=state, env=env)
        return {name: str(value) for name, value in reader.settings.cmake.define.items()}

    assert defined({"CI": "true"}) == {**defined({}), "LAJOLLA_WERROR": "TRUE"}
    assert defined({})["LAJOLLA_ISA"] == ("all" if state == "wheel" else "native")


def test_the_build_makes_the_levels_that_the_package_knows(repository: Path) -> None:
    assert f"set(levels {' '.join(ALL)})" in (repository / "cmake" / "isa.cmake").read_text()


def run(code: str, *, level: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "LAJOLLA_ISA": level}
    return subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )


def test_the_program_tells_when_a_level_is_not_there() -> None:
    command_line = "import sys; from lajolla.cli import main; sys.exit(main(['list']))"
    result = run(command_line, level="x86-64-v9")
    assert result.returncode == 1
    assert result.stderr.startswith("lajolla: error: LAJOLLA_ISA=x86-64-v9: this installation has ")
    assert result.stderr.count("\n") == 1


RENDER = """
import hashlib, lajolla
from lajolla import _core
print(_core.isa)
for name in ("cornell-box", "materials", "mis", "smoke"):
    scene = lajolla.load(f"{folder}/{{name}}.xml", size=(45, 34))
    print(name, hashlib.sha256(scene.render(spp=4, seed=1).array.tobytes()).hexdigest())
"""


def test_all_levels_draw_the_same_picture(repository: Path) -> None:
    there = list(builds(lajolla.__path__))
    levels = there[: there.index(choose(there, processor.processor_flags())) + 1] if there else []
    if len(levels) < 2:
        pytest.skip(
            "this installation has one build of the core (-C cmake.define.LAJOLLA_ISA=all makes more)"
        )
    pictures = set()
    for level in levels:
        result = run(RENDER.format(folder=repository / "scenes"), level=level)
        assert result.returncode == 0, result.stderr
        isa, *hashes = result.stdout.splitlines()
        assert isa == level and len(hashes) == 4
        pictures.add(tuple(hashes))
    assert len(pictures) == 1
