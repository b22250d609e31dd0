"""Opens a scene in a process of its own and tells what that took: `python hostile_cases.py SCENE`."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Answer:
    """What became of a scene, in how many seconds and bytes beyond those of importing the program."""

    error: str
    warnings: int
    seconds: float
    memory: int


def answer(scene: Path, timeout: float = 60) -> Answer:
    """The answer of a process that opens a scene and renders one sample of it."""
    command = [sys.executable, "-W", "ignore::UserWarning", __file__, str(scene)]  # ours are counted
    result = subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return Answer(**json.loads(result.stdout))


def _peak() -> int:
    """The most memory so far; Linux counts that of the parent in what `getrusage` tells."""
    status = Path("/proc/self/status")
    if status.exists():
        lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return int(lines["VmHWM"].split()[0]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _main(scene: str) -> None:
    import OpenImageIO  # noqa: F401 # it takes a while, as the others do

    import lajolla
    from lajolla.scene import plugins_by_kind

    lajolla.load  # noqa: B018 # imports it
    plugins_by_kind()
    error, warnings = "", 0
    memory, start = _peak(), time.process_time()
    try:
        opened = lajolla.load(scene, size=(8, 8))
        opened.render(spp=1, threads=1)
        warnings = len(opened.warnings)
    except (lajolla.SceneError, lajolla.OptionError) as problem:
        error = str(problem)
    seconds = time.process_time() - start
    print(json.dumps({"error": error, "warnings": warnings, "seconds": seconds, "memory": _peak() - memory}))


if __name__ == "__main__":
    _main(sys.argv[1])
