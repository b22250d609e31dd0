"""The notebooks in docs/ run without errors, and are stored with what they show."""

import re
from base64 import b64decode
from importlib.util import find_spec
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode

from lajolla import Image

FOLDER = Path("docs", "notebooks")
NOTEBOOKS = sorted(path.stem for path in (Path(__file__).parent.parent / FOLDER).glob("*.ipynb"))
MOST_BYTES = 300_000
PRIVATE = re.compile(r"(?<![\w.])(?:/\w|~/|[A-Z]:\\)|\b0x[0-9a-f]{6}")  # paths of a machine; addresses

each_notebook = pytest.mark.parametrize("name", NOTEBOOKS)


@pytest.fixture
def stored(repository: Path, name: str) -> NotebookNode:
    notebook = nbformat.read(repository / FOLDER / f"{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    return notebook


def outputs(notebook: NotebookNode) -> list[list[NotebookNode]]:
    """Those of each cell of code."""
    return [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]


def kinds(notebook: NotebookNode) -> list[set[str]]:
    """What each cell of code shows: names of streams, and types of data."""
    return [
        {kind for output in shown for kind in output.get("data", [output.get("name", output.output_type)])}
        for shown in outputs(notebook)
    ]


def texts(notebook: NotebookNode) -> list[str]:
    shown = [output for cell in outputs(notebook) for output in cell]
    return [output.get("text", output.get("data", {}).get("text/plain", "")) for output in shown]


@pytest.mark.skipif(find_spec("pyoidn") is None, reason="Open Image Denoise is not installed")
@each_notebook
def test_notebooks_run(
    name: str, stored: NotebookNode, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With few samples, in a folder from which paths lead to the scenes, and without the user's settings."""
    before = kinds(stored)
    for cell in stored.cells:
        cell.source = re.sub(r"\bspp=(\d+)", lambda m: f"spp={max(2, int(m[1]) // 8)}", cell.source)
        if name != "01-first-picture":
            cell.source = cell.source.replace(", denoise=True", "")
    for variable in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(variable, str(tmp_path / variable))
    (tmp_path / "scenes").symlink_to(repository / "scenes")
    folder = tmp_path / FOLDER
    folder.mkdir(parents=True)
    client = NotebookClient(
        stored, timeout=600, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    client.execute()
    assert kinds(stored) == before  # what is stored is not older than the code
    assert list(folder.iterdir()) == []


@each_notebook
def test_notebooks_are_stored_with_their_outputs(name: str, stored: NotebookNode, repository: Path) -> None:
    assert (repository / FOLDER / f"{name}.ipynb").stat().st_size <= MOST_BYTES
    counts = [cell.execution_count for cell in stored.cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))  # run from the top, once
    shown = [output.get("data", {}) for cell in outputs(stored) for output in cell]
    pictures = [b64decode(data["image/png"]) for data in shown if "image/png" in data]
    assert len(pictures) >= 2 and all(Image.open(picture).array.std() > 0.01 for picture in pictures)


@each_notebook
def test_notebooks_tell_nothing_of_the_machine(name: str, stored: NotebookNode) -> None:
    assert [kind for kind in set().union(*kinds(stored)) if kind in ("error", "stderr")] == []
    assert [text for text in texts(stored) if PRIVATE.search(text)] == []
    assert [cell.metadata for cell in stored.cells if cell.metadata] == []  # such as times of execution


def test_the_list_of_notebooks_is_complete(repository: Path) -> None:
    page = (repository / FOLDER / "README.md").read_text()
    assert re.findall(r"\[([\w-]+)\]\(\1\.ipynb\)", page) == NOTEBOOKS
