"""Runs notebooks and stores them with their outputs, without times and versions, which change in every run.

python docs/notebooks/store.py [NAME ...]    # such as 01-first-picture; default: all
"""

import sys
from collections.abc import Sequence
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parent


def store(path: Path) -> None:
    """Raises CellExecutionError if a cell fails; the file then stays as it is."""
    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, kernel_name="python3", record_timing=False, resources=place).execute()
    notebook.metadata.language_info = {"name": "python"}
    nbformat.write(notebook, path)


def main(names: Sequence[str]) -> None:
    """Stores the notebooks of these names, or all."""
    for name in names or sorted(path.stem for path in FOLDER.glob("*.ipynb")):
        print(name, flush=True)
        store(FOLDER / f"{name}.ipynb")


if __name__ == "__main__":
    main(sys.argv[1:])
