"""README.md and docs/extending.md tell the truth: what they show runs, compiles, and is said."""

import itertools
import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from lajolla import image

QUICK = {"render": ["--size", "24x16", "--spp", "1"]}  # appended: the last of equal options counts
MISTAKES = {'type="roughconductor"': 'type="roughconducter"', '<ref id="glass"/>': '<ref id="glas"/>'}


@pytest.fixture(scope="module")
def readme(repository: Path) -> str:
    return (repository / "README.md").read_text()


@pytest.fixture(scope="module")
def extending(repository: Path) -> str:
    return (repository / "docs" / "extending.md").read_text()


@pytest.fixture
def clone(repository: Path, tmp_path: Path) -> Path:
    """A folder from which README's paths lead to the scenes, and where pictures may be left."""
    (tmp_path / "scenes").symlink_to(repository / "scenes")
    return tmp_path


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def commands(text: str) -> list[list[str]]:
    """The words after ./lajolla of every command shown."""
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    words = [shlex.split(line, comments=True) for line in lines]
    assert all(line[0] == "./lajolla" for line in words)
    return [line[1:] for line in words]


def test_commands_run(readme: str, clone: Path) -> None:
    """In the order shown, in small: later ones use the pictures of earlier ones."""
    # `test` and `docs` are the launcher's, and `view` ends when it is told to (test_viewer.py).
    own = [words for words in commands(readme) if words[0] not in ("test", "docs", "view")]
    assert own
    for words in own:
        quick = [] if "--help" in words else QUICK.get(words[0], [])
        command = [sys.executable, "-m", "lajolla", *words, *quick]
        result = subprocess.run(command, cwd=clone, capture_output=True, text=True, check=False)
        assert result.returncode == 0, f"{words}: {result.stderr}"
        names = [name for flag, name in itertools.pairwise(words) if flag in ("-o", "--diff")]
        outputs = [name.replace("{frame}", "1") for name in names]
        assert all((clone / name).is_file() for name in outputs)
    assert (clone / "cornell-box.exr").is_file() and (clone / "cornell-box.png").is_file()


@pytest.mark.parametrize("page", ["rendering", "outputs", "denoising", "comparing"])
def test_commands_of_docs_run(page: str, repository: Path, clone: Path) -> None:
    """In the order shown, in small, with the Cornell box as scene.xml."""
    scene = (repository / "scenes" / "cornell-box.xml").read_text()
    (clone / "scene.xml").write_text(scene)
    angle = '<default name="angle" value="0"/><sensor'
    (clone / "turntable.xml").write_text(scene.replace("<sensor", angle, 1))
    image.write(clone / "noisy.exr", np.ones((8, 8, 3)))
    text = (repository / "docs" / f"{page}.md").read_text()
    lines = [line for block in blocks(text, "sh") for line in block.splitlines()]
    shown = [words[1:] for line in lines if (words := shlex.split(line, comments=True))[:1] == ["lajolla"]]
    assert shown
    for words in shown:
        command = [sys.executable, "-m", "lajolla", *words, *QUICK.get(words[0], [])]
        result = subprocess.run(command, cwd=clone, capture_output=True, text=True, check=False)
        assert result.returncode == 0, f"{words}: {result.stderr}"


def test_python_runs(readme: str, clone: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(clone)
    examples = blocks(readme, "python")
    assert examples
    for example in examples:
        exec(compile(example, "README.md", "exec"), {})
    assert (clone / "small.exr").is_file() and (clone / "ball.png").is_file()


def test_messages_are_what_the_reader_says(readme: str, repository: Path, clone: Path) -> None:
    """README makes its mistakes in the Cornell box."""
    scene = (repository / "scenes" / "cornell-box.xml").read_text()
    said = []
    for right, wrong in MISTAKES.items():
        assert right in scene
        (clone / "scene.xml").write_text(scene.replace(right, wrong))
        command = [sys.executable, "-m", "lajolla", "check", "scene.xml"]
        result = subprocess.run(command, cwd=clone, capture_output=True, text=True, check=False)
        said.append(result.stdout + result.stderr)
    shown = blocks(readme, "text")
    assert len(shown) == len(MISTAKES)
    for message in shown:
        assert any(message in text for text in said), message


@pytest.mark.parametrize("lobe", ["in lanes", "for one path"])
def test_the_bsdf_to_add_compiles(
    lobe: str, readme: str, extending: str, repository: Path, tmp_path: Path
) -> None:
    """With the include and the name in the list that both documents show."""
    model, include, listed, one_path = blocks(extending, "cpp")
    if lobe == "for one path":
        start = model.index("    template <class Float>\n    struct Lobe")
        model = model[:start] + one_path + "};\n\n} // namespace lajolla\n"
    assert blocks(readme, "cpp") == [include, listed] and "Minnaert, Null>;" in listed
    assert listed.split("<")[0] in (repository / "core" / "scatter" / "bsdfs.h").read_text()
    header = (repository / "core" / "scatter" / "bsdfs.h").read_text()
    assert ", Null>;" in header
    changed = header.replace(", Null>;", ", Minnaert, Null>;")

    (tmp_path / "scatter").mkdir()
    (tmp_path / "scatter" / "minnaert.h").write_text(model)
    source = tmp_path / "bsdfs.cpp"
    source.write_text(include + changed.replace("#pragma once", ""))
    warnings = ["-Wall", "-Wextra", "-Wconversion", "-Wno-psabi", "-Werror"]
    folders = [f"-I{tmp_path}", f"-I{repository / 'core'}"]
    command = [compiler(repository), "-std=c++20", "-fsyntax-only", *warnings, *folders, str(source)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def compiler(repository: Path) -> str:
    """The one of the checkout's build, or $CXX, or c++."""
    cache = repository / "build" / "release" / "CMakeCache.txt"
    found = (
        re.search(r"^CMAKE_CXX_COMPILER:\w+=(.+)$", cache.read_text(), re.MULTILINE)
        if cache.is_file()
        else None
    )
    path = found.group(1) if found else shutil.which(os.environ.get("CXX", "c++"))
    if path is None:
        pytest.skip("there is no C++ compiler")
    return path


@pytest.mark.parametrize(
    "name",
    "README.md CHANGELOG.md CONTRIBUTING.md docs docs/book docs/notebooks bench/README.md "
    "scenes/README.md".split(),
)
def test_links_lead_somewhere(repository: Path, name: str) -> None:
    start = repository / name
    for page in sorted(start.glob("*.md")) if start.is_dir() else [start]:
        text = page.read_text()
        targets = re.findall(r"\]\(([^)#\s]+)", text) + re.findall(r'src="([^"]+)"', text)
        missing = [t for t in targets if "://" not in t and not (page.parent / t).exists()]
        assert missing == [], page.name


def test_version_is_in_the_changelog(repository: Path) -> None:
    assert f"## {version('lajolla')}\n" in (repository / "CHANGELOG.md").read_text()
