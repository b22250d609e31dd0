"""Fixtures for all tests."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """The option of the tests in fuzz/."""
    parser.addoption(
        "--fuzz-minutes",
        type=float,
        metavar="MINUTES",
        help="how long each test in tests/fuzz looks for faults, with other inputs in every run; "
        "without this, each tries a few, always the same ones",
    )


@pytest.fixture
def fuzz_minutes(request: pytest.FixtureRequest) -> float | None:
    """How long to look for faults; None: only with what is always the same."""
    return request.config.getoption("fuzz_minutes")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """What "-n auto" means: a process for each core, but none beside this one for tests that are chosen."""
    chosen = config.args_source is pytest.Config.ArgsSource.ARGS or config.option.keyword
    if not chosen:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    config.option.dist = "no"
    return 0


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the checkout."""
    return ROOT


def shared(name: str) -> Path:
    """A folder beside the checkout; a test without it is skipped, but fails in CI."""
    folder = ROOT.parent / "shared" / name
    if not folder.is_dir():
        message = f"the public {name} (../shared/{name} beside the checkout) are not here"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    return folder


@pytest.fixture(scope="session")
def shared_scenes() -> Path:
    """The folder of public scenes."""
    return shared("scenes")


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """The folder of small inputs that once failed."""
    return shared("cases")


@pytest.fixture
def as_from_a_terminal() -> Iterator[None]:
    """A shell starts its background jobs with SIGINT ignored; a terminal's programs hear it."""
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, previous)
