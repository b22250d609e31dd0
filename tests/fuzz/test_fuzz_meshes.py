"""The mesh readers under libFuzzer, AddressSanitizer and UndefinedBehaviorSanitizer; see read_mesh.cpp."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from mesh_files import SERIALIZED_SAMPLE, samples_of

FOLDER = Path(__file__).parent
CORE = FOLDER.parents[1] / "core"
SANITIZERS = "-fsanitize=fuzzer,address,undefined,float-cast-overflow"
FLAGS = ["-std=c++20", "-O1", "-g1", SANITIZERS, "-fno-sanitize-recover=all", f"-I{CORE}"]
NEEDED = "needs clang 16 or newer with libFuzzer (Debian: clang-16 libclang-rt-16-dev)"
SECONDS = 4
# What the readers take, and where their faults of the past are; "inflated" is within "serialized".
SEEDS = {
    "obj": samples_of("obj"),
    "ply": samples_of("ply"),
    "serialized": samples_of("serialized"),
    "inflated": tuple(SERIALIZED_SAMPLE),
}


def clang(folder: Path) -> str | None:
    """A compiler that can build such a program."""
    (folder / "empty.cpp").write_text(
        'extern "C" int LLVMFuzzerTestOneInput(const char *, long) { return 0; }'
    )
    for name in ("clang++", *(f"clang++-{version}" for version in range(22, 15, -1))):
        command = [name, "-std=c++20", SANITIZERS, "empty.cpp", "-o", "empty"]
        if shutil.which(name) and not subprocess.run(command, cwd=folder, capture_output=True).returncode:
            return name
    return None


@pytest.fixture(scope="module")
def read_mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program, built once for all processes that run tests, and anew when a source has changed."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    sources = [FOLDER / "read_mesh.cpp", *sorted((CORE / "meshio").glob("*.cpp"))]
    headers = [*(CORE / "meshio").glob("*.h"), *(CORE / "base").glob("*.h")]
    contents = b"".join(path.read_bytes() for path in [*sources, *sorted(headers)])
    program = folder / f"read_mesh-{hashlib.sha256(contents).hexdigest()[:16]}"
    with (folder / "read_mesh.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not program.exists():
            compiler = clang(folder)
            if compiler is None:
                pytest.skip(NEEDED)
            subprocess.run([compiler, *FLAGS, *map(str, sources), "-lz", "-o", str(program)], check=True)
    return program


def run(program: Path, folder: Path, reader: str, *words: str) -> None:
    """Runs the program in a folder, which gets the input that fails."""
    command = [str(program), f"--reader={reader}", "-timeout=5", "-rss_limit_mb=1024", "-verbosity=0", *words]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace")
    assert result.returncode == 0, f"the input is in {folder}\n{result.stderr[-8000:]}"


@pytest.mark.parametrize("reader", SEEDS)
def test_mesh_readers(reader: str, read_mesh: Path, tmp_path: Path, fuzz_minutes: float | None) -> None:
    """From right files on, towards code that was not run before."""
    seeds = tmp_path / "seeds"
    seeds.mkdir()
    for i, data in enumerate(SEEDS[reader]):
        (seeds / str(i)).write_bytes(data)
    seconds = SECONDS if fuzz_minutes is None else int(60 * fuzz_minutes)
    start = "-seed=1" if fuzz_minutes is None else "-seed=0"  # 0: another one in every run
    run(read_mesh, tmp_path, reader, "seeds", start, f"-max_total_time={seconds}")


@pytest.mark.parametrize("reader", SEEDS)
def test_faults_of_the_past(reader: str, read_mesh: Path, tmp_path: Path) -> None:
    known = sorted(str(path) for path in (FOLDER / "corpus" / reader).glob("*"))
    assert known
    run(read_mesh, tmp_path, reader, *known)
