"""The launcher, with an interpreter that only tells how it was called: where it builds, how it hands over."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from process_tools import can_block

PYTHON = """#!/bin/sh
case $1 in
-c) exit 0 ;;
esac
echo "$0 $*"
"""
NEEDED = "core/base/vec.h cmake/isa.cmake CMakeLists.txt pyproject.toml"
READ_ONLY = 'mount --bind "$1" "$1" && mount -o remount,ro,bind "$1" && shift && exec "$@"'


@pytest.fixture
def checkout(tmp_path: Path, repository: Path) -> Path:
    """A checkout with little in it."""
    folder = tmp_path / "checkout"
    for name in NEEDED.split():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    shutil.copy(repository / "lajolla", folder)
    return folder


def cache(checkout: Path) -> Path:
    """The folder in which the launcher builds what it may not build in the checkout."""
    number = subprocess.run(["cksum"], input=os.fsencode(checkout), capture_output=True, check=True)
    return checkout.parent / "cache" / "lajolla" / number.stdout.split()[0].decode()


def make_environment(home: Path, checkout: Path, python: str = PYTHON) -> None:
    """What a set-up leaves in a folder."""
    program = home / ".venv" / "bin" / "python"
    program.parent.mkdir(parents=True)
    program.write_text(python)
    program.chmod(0o755)
    (home / ".venv" / "lajolla-made").write_text(f"{checkout}\n")
    (home / ".venv" / "lajolla-built").touch()


def launch(checkout: Path, *words: str, read_only: bool = False) -> subprocess.CompletedProcess[str]:
    command = [str(checkout / "lajolla"), *words]
    if read_only and os.geteuid() == 0:  # who may write everywhere
        command = ["unshare", "-m", "sh", "-c", READ_ONLY, "sh", str(checkout), *command]
    elif read_only:
        checkout.chmod(0o555)
    environment = {**os.environ, "XDG_CACHE_HOME": str(checkout.parent / "cache")}
    result = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    checkout.chmod(0o755)
    if read_only and ("mount" in result.stderr or "unshare" in result.stderr):
        pytest.skip("a read-only file system cannot be made here")
    return result


@pytest.mark.parametrize("read_only", [False, True], ids=["writable", "read-only"])
def test_what_is_built_in_the_checkout_is_used(checkout: Path, read_only: bool) -> None:
    make_environment(checkout, checkout)
    result = launch(checkout, "render", "a b.xml", read_only=read_only)
    assert (result.stdout, result.stderr) == (f"{checkout}/.venv/bin/python -m lajolla render a b.xml\n", "")


def test_a_read_only_checkout_is_built_in_the_cache(checkout: Path) -> None:
    home = cache(checkout)
    make_environment(home, checkout)
    (checkout / "core" / "base" / "vec.h").touch()
    os.utime(home / ".venv" / "lajolla-built", (0, 0))
    result = launch(checkout, "list", read_only=True)
    assert result.stdout == f"{home}/.venv/bin/python -m lajolla list\n", result.stderr
    assert "lajolla: building" in result.stderr
    log = (home / "build" / "setup.log").read_text()
    assert "-m pip --disable-pip-version-check --no-input -v install --no-build-isolation " in log
    assert f"-Cbuild-dir={home}/build/release -e .\n" in log
    assert sorted(os.listdir(checkout)) == ["CMakeLists.txt", "cmake", "core", "lajolla", "pyproject.toml"]
    assert launch(checkout, "list", read_only=True).stderr == ""  # it is built now


def test_docs_install_their_packages_once(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KATEX", "/anywhere")  # instead of a system package
    make_environment(checkout, checkout)
    result = launch(checkout, "docs", "a b")
    assert result.stdout == f"{checkout}/.venv/bin/python {checkout}/docs/site/build.py a b\n", result.stderr
    assert "-e .[docs]\n" in (checkout / "build" / "setup.log").read_text()
    assert launch(checkout, "docs").stderr == ""
    assert not (checkout / ".venv" / "lajolla-tested").exists()  # they are not all of the tests' packages


@pytest.mark.skipif(not can_block(), reason="env has no --block-signal")
def test_interrupts_wait_until_python_hears_them(checkout: Path) -> None:
    tells = "if sys.argv[1] == '-m': print(signal.pthread_sigmask(signal.SIG_BLOCK, []))"
    make_environment(checkout, checkout, f"#!{sys.executable}\nimport signal, sys\n{tells}\n")
    assert launch(checkout, "list").stdout == "{<Signals.SIGINT: 2>}\n"


def test_a_failed_build_shows_its_log(checkout: Path) -> None:
    fails = '#!/bin/sh\n[ "$1" = -c ] && exit 0\necho "[3/7] Building"\necho "vec.h: error"\nexit 1\n'
    make_environment(checkout, checkout, fails)
    os.utime(checkout / ".venv" / "lajolla-built", (0, 0))
    result = launch(checkout, "list")
    assert result.returncode == 1
    assert "vec.h: error\n" in result.stderr
    assert result.stderr.endswith("lajolla: error: the build failed\n")


def test_a_build_ends_where_termination_is_ignored(checkout: Path) -> None:
    """What shows its steps ends with it, and does not keep a pipe open, whatever happens to signals."""
    make_environment(checkout, checkout)
    os.utime(checkout / ".venv" / "lajolla-built", (0, 0))
    result = subprocess.run(
        [checkout / "lajolla", "list"], capture_output=True, text=True, timeout=20, check=True,
        preexec_fn=lambda: signal.signal(signal.SIGTERM, signal.SIG_IGN),
    )  # fmt: skip
    assert result.stderr == "lajolla: building what changed\n"


def test_an_interrupted_build_is_one_line(checkout: Path) -> None:
    waits = '#!/bin/sh\n[ "$1" = -c ] && exit 0\necho "[3/7] Building"\nsleep 30\n'
    make_environment(checkout, checkout, waits)
    os.utime(checkout / ".venv" / "lajolla-built", (0, 0))
    process = subprocess.Popen(
        [checkout / "lajolla", "list"], stderr=subprocess.PIPE, text=True, start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    assert process.stderr is not None
    told = process.stderr.readline()
    while not (log := checkout / "build" / "setup.log").exists() or "Building" not in log.read_text():
        assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    _, rest = process.communicate(timeout=20)
    assert process.returncode == 130
    assert (told, rest) == ("lajolla: building what changed\n", "lajolla: interrupted\n")
