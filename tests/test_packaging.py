"""A wheel with Embree and TBB inside: an environment with nothing else renders the same image.

The wheel is made from the core that the checkout is tested with, because a wheel for distribution
(`packaging/wheel`) takes minutes to compile. Everything after compilation is the same.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import numpy as np
import pytest
from process_tools import build_folder

import lajolla
from lajolla import _core

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("dpkg-query") is None,
    reason="licences are looked up with dpkg, and auditwheel is for Linux",
)

BOTH = """
import sys
import numpy as np

def ours():
    import lajolla
    image = lajolla.load("scenes/cornell-box.xml", size=(32, 32), spp=4).render(seed=1).array
    print(*sorted({line.split()[-1] for line in open("/proc/self/maps") if ".so" in line}), sep="\\n")
    return np.array(image)

def theirs():
    import mitsuba
    mitsuba.set_variant("scalar_rgb")
    scene = mitsuba.cornell_box()
    scene["sensor"]["film"]["width"] = scene["sensor"]["film"]["height"] = 32
    return np.array(mitsuba.render(mitsuba.load_dict(scene), spp=4, seed=1))

images = {name: globals()[name]() for name in sys.argv[2:]}
np.savez(sys.argv[1], **images)
"""


def run(*command: object, folder: Path, **variables: str) -> str:
    """The output of a command that must succeed."""
    environment = {"HOME": str(folder), "LANG": "C.UTF-8", **variables}
    result = subprocess.run(
        [str(word) for word in command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def plain_wheel(repository: Path, folder: Path) -> Path:
    """A wheel of the sources and of the core that runs now, as `pip wheel` makes it."""
    folder.mkdir()
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    run(*pip, "-C", "wheel.cmake=false", "-w", folder, repository, folder=folder, PATH=path)
    (pure,) = folder.glob("lajolla-*.whl")
    run(sys.executable, "-m", "wheel", "unpack", pure, folder=folder)
    pure.unlink()
    (tree,) = folder.glob("lajolla-*")
    run("cmake", "--install", build_folder(), "--prefix", tree, folder=folder, PATH=path)
    for module in tree.glob("lajolla/_core_testing*"):
        module.unlink()
    run(sys.executable, "-m", "wheel", "pack", tree, folder=folder)
    (pure,) = folder.glob("lajolla-*.whl")
    tag = f"cp{sys.version_info[0]}{sys.version_info[1]}"
    tags = ["--python-tag", tag, "--abi-tag", tag, "--platform-tag", "linux_x86_64"]
    run(sys.executable, "-m", "wheel", "tags", "--remove", *tags, pure, folder=folder)
    (wheel,) = folder.glob("lajolla-*.whl")
    return wheel


def licence(library: str) -> str:
    """NAME=FILE for a library that the core of this process uses."""
    with open("/proc/self/maps") as maps:
        path = next(line.split()[-1] for line in maps if f"/lib{library}" in line)
    package = run("dpkg-query", "-S", f"*/{Path(path).name}", folder=Path("/")).split(":")[0]
    return f"{library}=/usr/share/doc/{package}/copyright"


def clean_environment(wheel: Path, folder: Path) -> Path:
    """The Python of a new environment with the wheel. Its dependencies are looked up in ours."""
    venv.create(folder, symlinks=True)
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "pip", "-q", "--python", python, "install", "--no-deps", wheel, folder=folder)
    (packages,) = folder.glob("lib/python3*/site-packages")
    (packages / "dependencies.pth").write_text(sysconfig.get_path("platlib"))
    return python


def test_a_wheel_needs_nothing_of_the_system(repository: Path, tmp_path: Path) -> None:
    for tool in ("auditwheel", "wheel"):
        pytest.importorskip(tool)
    _core.Scene  # noqa: B018  # loads Embree, whose licence is looked up
    plain = plain_wheel(repository, tmp_path / "plain")
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    repair = repository / "packaging" / "repair"
    run(repair, plain, tmp_path, licence("embree"), licence("tbb"), folder=tmp_path, PATH=path)
    (wheel,) = tmp_path.glob("lajolla-*.whl")
    assert "-manylinux_2_" in wheel.name
    names = zipfile.ZipFile(wheel).namelist()
    for licenced in ("LICENSE", "embree/copyright", "tbb/copyright", "nanobind/LICENSE", "robin_map/LICENSE"):
        assert any(name.endswith(f".dist-info/licenses/{licenced}") for name in names), licenced

    python = clean_environment(wheel, tmp_path / "environment")
    scene = repository / "scenes" / "cornell-box.xml"
    ours = lajolla.load(scene, size=(32, 32), spp=4).render(seed=1).array
    options = ["--size", "32x32", "--spp", "4", "--seed", "1", "-o", tmp_path / "image.exr"]
    run(python.parent / "lajolla", "render", scene, *options, folder=tmp_path)
    np.testing.assert_array_equal(lajolla.Image.open(tmp_path / "image.exr").array, ours)

    # In one process with Mitsuba, which has an Embree and threads of its own, in either order.
    first, second = tmp_path / "first.npz", tmp_path / "second.npz"
    loaded = run(python, "-c", BOTH, first, "ours", "theirs", folder=repository).splitlines()
    run(python, "-c", BOTH, second, "theirs", "ours", folder=repository)
    with np.load(first) as before, np.load(second) as after:
        np.testing.assert_array_equal(before["ours"], ours)
        np.testing.assert_array_equal(after["ours"], ours)
        # Mitsuba's threads add in any order.
        np.testing.assert_allclose(before["theirs"], after["theirs"], rtol=1e-5)

    # What else ours need is on every Linux: auditwheel gives no such name to other wheels.
    ours_loaded = [path for path in loaded if "embree" in path or "libtbb" in path]
    assert len(ours_loaded) == 2 and all("/lajolla.libs/" in path for path in ours_loaded), ours_loaded
