"""Fixtures for all tests."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def shared_scenes() -> Path:
    """The folder of public scenes beside the checkout; a test without it is skipped, but fails in CI."""
    folder = ROOT.parent / "shared" / "scenes"
    if not folder.is_dir():
        message = "the public scenes (../shared/scenes beside the checkout) are not here"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return folder
