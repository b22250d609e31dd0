"""Whatever a scene gives a plugin, there is a scene or one message with its place, and never a traceback."""

from __future__ import annotations

import resource
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plugin_tools import plugin_entry, scene_with

import lajolla
from lajolla import image
from lajolla.scene import plugins_by_kind
from lajolla.scene.formats.voxels import vol_bytes

NOTHING = object()
EXTREMES = (0, -1, 1e-30, 3e38, -3e38, float("nan"), float("inf"), 2**31, 2**63)
OTHERS = (
    "",
    "word",
    "1, 2",
    True,
    [1, 2, 3],
    [[1, 2], [3, 4]],
    np.zeros(0),
    np.eye(4),
    np.zeros((4, 4)),
    None,
)
OBJECTS = (
    {"type": "rgb", "value": [0.1, 0.2, 0.3]},
    {"type": "checkerboard"},
    {"type": "diffuse"},
    {"type": "isotropic"},
    {"type": "constvolume"},
    {"type": "sphere"},
    {"type": "path"},
)
VALUES = (NOTHING, *EXTREMES, *OTHERS, *OBJECTS)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "a.txt").write_text("\n".join(f"{i} 0 0 0.1" for i in range(5)))
    (folder / "a.vol").write_bytes(vol_bytes(np.ones((2, 2, 2, 1), np.float32)))
    image.write(folder / "a.exr", np.full((2, 2, 3), 0.5))
    return folder


def variations(kind: str, name: str) -> Iterator[dict[str, Any]]:
    """The plugin as it should be, then with each of its parameters missing, of another type, and extreme."""
    plugin = plugins_by_kind()[kind][name.lower()]
    entry = plugin_entry(kind, name)
    yield entry
    for field in {f.name for f in plugin.fields} | entry.keys() - {"type"}:
        for value in VALUES:
            kept = {key: given for key, given in entry.items() if key != field}
            yield kept if value is NOTHING else {**kept, field: value}


KINDS = [kind for kind in plugins_by_kind() if kind not in ("scene", "subsurface")]


@pytest.mark.parametrize("kind", KINDS)
def test_every_parameter_of_every_plugin(kind: str, files: Path) -> None:
    refused = opened = 0
    for plugin in plugins_by_kind()[kind].values():
        for entry in variations(kind, plugin.name):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")  # NumPy's
                    warnings.simplefilter("ignore", lajolla.SceneWarning)
                    lajolla.load_dict(scene_with(kind, entry), base_path=files)
                opened += 1
            except lajolla.SceneError as problem:
                assert str(problem).startswith("scene"), (entry, str(problem))
                assert problem.message.strip(), entry
                cause = problem.__cause__
                assert cause is None or isinstance(cause, ValueError | MemoryError), (entry, repr(cause))
                refused += 1
            except Exception as problem:
                pytest.fail(f"{kind} {entry}: {problem!r}")
    assert refused and opened


SMALL = """<scene version="3.0.0">
    <integrator type="path"/><sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="8"/><integer name="height" value="8"/>
    </film></sensor>
    <emitter type="constant"/><shape type="sphere"/>
</scene>"""


@pytest.mark.parametrize("output", ["a.npy", "a.exr"])
@pytest.mark.parametrize("megabytes", [30, 80, 160, 240, 330, 390, 450])
def test_too_little_memory_is_one_message(megabytes: int, output: str, tmp_path: Path) -> None:
    (tmp_path / "room.xml").write_text(SMALL)
    limit = (resource.RLIMIT_AS, (megabytes * 1_000_000,) * 2)
    result = subprocess.run(
        [sys.executable, "-m", "lajolla", *"render room.xml --quiet --threads 1 -o".split(), output],
        cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(*limit),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    told = [line for line in result.stderr.splitlines() if "error: " in line]
    assert (result.returncode, len(told)) in ((0, 0), (1, 1)), result.stderr
    assert all("not enough memory" in line or output in line for line in told)
    assert "Traceback" not in result.stderr
