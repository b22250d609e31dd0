"""How tests start programs, and where those are that the build made."""

import subprocess
from pathlib import Path

import pytest

from lajolla import _core

# As the launcher starts Python: Ctrl-C waits until somebody hears it.
BLOCKED = ["env", "--block-signal=INT"]


def can_block() -> bool:
    """Whether `env` is one that blocks signals."""
    return subprocess.run([*BLOCKED, "true"], capture_output=True, check=False).returncode == 0


def build_folder() -> Path:
    """Where CMake built the extension module that runs, or what it is a copy of."""
    module = Path(_core.__file__).resolve()
    folders = [folder for folder in module.parents if (folder / "CMakeCache.txt").is_file()]
    if not folders:
        root = Path(__file__).resolve().parent.parent
        folders = [cache.parent for cache in sorted(root.glob("build/*/CMakeCache.txt"))]
    if not folders:
        pytest.skip("there is no build folder")
    return folders[0]
