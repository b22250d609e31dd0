"""All sources are formatted and lint-free."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from lajolla import _core


def run_tool(name: str, *arguments: str, folder: Path, **variables: str) -> None:
    """Runs a formatter or linter, from this environment if it is there; without the tool, only CI fails."""
    beside = Path(sys.prefix) / "bin" / name
    tool = str(beside) if beside.exists() else shutil.which(name)
    if tool is None:
        message = f"{name} is not installed"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    environment = {**os.environ, **variables}
    command = [tool, *arguments]
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def test_python_is_lint_free(repository: Path) -> None:
    run_tool("ruff", "check", "--output-format", "concise", folder=repository)


def test_python_is_formatted(repository: Path) -> None:
    run_tool("ruff", "format", "--check", folder=repository)


def test_python_types_agree(repository: Path, tmp_path: Path) -> None:
    """Also with those of the core, which the build writes beside it, or beside the folders of its levels."""
    core = Path(_core.__file__).resolve().parent
    stubs = next(path for path in (core / "_core.pyi", core.parent / "_core.pyi") if path.is_file())
    (tmp_path / "lajolla").mkdir()
    shutil.copy(stubs, tmp_path / "lajolla")
    run_tool("mypy", folder=repository, MYPYPATH=str(tmp_path))


def test_what_types_are_not_checked_is_told_in_one_place(repository: Path) -> None:
    sources = (repository / "src").rglob("*.py")
    assert [path.name for path in sources if "type: ignore" in path.read_text()] == []  # see pyproject.toml


def test_cpp_is_formatted(repository: Path) -> None:
    files = [path for folder in ("core", "tests") for path in (repository / folder).rglob("*")]
    sources = sorted(str(path) for path in files if path.suffix in {".h", ".cpp"})
    run_tool("clang-format", "--dry-run", "-Werror", *sources, folder=repository)


def test_elementary_functions_are_our_own(repository: Path) -> None:
    """Those of C libraries round differently from one processor or library to the next.

    Colours of files are converted in double precision, which hides that.
    """
    foreign = re.compile(r"std::(exp|expm1|log|log1p|pow|sin|cos|tan|tanh|asin|acos|atan|atan2|cbrt)\(")
    core = repository / "core"
    found = [
        f"{path.relative_to(repository)}:{number}"
        for path in sorted(core.rglob("*"))
        if path.suffix in {".h", ".cpp"} and path.parent.name not in ("images", "meshio")
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if foreign.search(line)
    ]
    assert found == []
