"""Seconds and memory to load a big mesh, beside the mitsuba package.

    python bench/meshes.py [--triangles 1000000] [--runs 5] [FORMAT ...]

Makes a displaced sphere with normals and texture coordinates and writes it as obj, ply (binary) and
serialized. Each load is timed in a process of its own, from the call that reads the file until one ray has
been traced; a small mesh before it loads libraries and compiles Mitsuba's kernels. Runs alternate, so that a
busy machine slows all; medians count, for Mitsuba those of its faster variant. `kept` is what the process has
grown by once the scene is there, `peak` the most it had grown by in between, both in bytes per triangle;
`arrays` are those of our mesh, without Embree's tree. Linux only.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import struct
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from oracle import default_variant  # noqa: E402

FORMATS = ("obj", "ply", "serialized")
Array = np.ndarray
Mesh = dict[str, Array]
Measured = dict[str, float]


def displaced_sphere(triangles: int) -> Mesh:
    """About so many triangles between meridians and parallels, with waves of two sizes."""
    rows = max(2, round((triangles / 2) ** 0.5))
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, rows + 1), indexing="ij")
    theta, phi = np.pi * (0.02 + 0.96 * v), 2 * np.pi * u
    radius = 1 + 0.1 * np.sin(9 * theta) * np.cos(7 * phi) + 0.005 * np.sin(150 * theta) * np.sin(140 * phi)
    unit = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    points = radius[..., None] * unit
    normals = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corner = np.arange(rows * (rows + 1)).reshape(rows, rows + 1)[:, :-1].ravel()
    below, right = corner + rows + 1, 1
    faces = np.stack([corner, below, below + right, corner, below + right, corner + right], -1)
    return {
        "points": points.reshape(-1, 3).astype("<f4"),
        "normals": normals.reshape(-1, 3).astype("<f4"),
        "uvs": np.stack([u, v], -1).reshape(-1, 2).astype("<f4"),
        "faces": faces.reshape(-1, 3).astype("<u4"),
    }


def obj_bytes(mesh: Mesh) -> bytes:
    """The mesh as a Wavefront OBJ file with six decimals, as most programs write."""

    def lines(keyword: str, values: Array) -> str:
        line = keyword + " %.6f" * values.shape[1] + "\n"
        return line * len(values) % tuple(values.ravel().tolist())

    face = "f" + " %d/%d/%d" * 3 + "\n"
    corners = np.repeat(mesh["faces"].ravel() + 1, 3).tolist()
    vertices = lines("v", mesh["points"]) + lines("vt", mesh["uvs"]) + lines("vn", mesh["normals"])
    return (vertices + face * len(mesh["faces"]) % tuple(corners)).encode()


def ply_bytes(mesh: Mesh) -> bytes:
    """The mesh as a binary PLY file."""
    table = np.hstack([mesh["points"], mesh["normals"], mesh["uvs"]])
    faces = np.empty(len(mesh["faces"]), [("count", "u1"), ("at", "<i4", 3)])
    faces["count"], faces["at"] = 3, mesh["faces"]
    properties = "".join(f"property float {name}\n" for name in "x y z nx ny nz u v".split())
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(table)}\n{properties}"
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    return header.encode() + table.tobytes() + faces.tobytes()


def serialized_bytes(mesh: Mesh) -> bytes:
    """The mesh in Mitsuba's compressed format, version 4."""
    head = struct.pack("<I", 0x1003) + b"mesh\0" + struct.pack("<QQ", len(mesh["points"]), len(mesh["faces"]))
    data = head + b"".join(mesh[name].tobytes() for name in ("points", "normals", "uvs", "faces"))
    return struct.pack("<HH", 0x041C, 4) + zlib.compress(data) + struct.pack("<QI", 0, 1)


def write_files(folder: Path, triangles: int) -> None:
    """Writes the mesh in each format as mesh.*, and a small one as small.*."""
    for name, count in (("mesh", triangles), ("small", 1000)):
        mesh = displaced_sphere(count)
        for kind, encode in zip(FORMATS, (obj_bytes, ply_bytes, serialized_bytes), strict=True):
            (folder / f"{name}.{kind}").write_bytes(encode(mesh))


def scene_of(path: Path) -> dict[str, object]:
    """What both renderers load."""
    mesh = {"type": path.suffix[1:], "filename": str(path)}
    return {"type": "scene", "mesh": mesh, "camera": {"type": "perspective"}}


def with_lajolla(path: Path) -> tuple[object, float, float]:
    """The scene, its number of triangles and the bytes of its arrays."""
    import lajolla
    from lajolla import _core_testing

    scene = lajolla.load_dict(scene_of(path))
    _core_testing.hit_many(scene.core, np.float32([[5, 0, 0]]), np.float32([[-1, 0, 0]]))
    summary = scene.core.summary()
    return scene, summary["triangles"], summary["bytes"]


def with_mitsuba(path: Path) -> tuple[object, float, float]:
    """The scene and its number of triangles."""
    import drjit as dr
    import mitsuba as mi

    scene = mi.load_dict(scene_of(path))
    dr.eval(scene.ray_intersect_preliminary(mi.Ray3f([5, 0, 0], [-1, 0, 0])))
    if "llvm" in mi.variant():
        dr.sync_thread()
    return scene, scene.shapes()[0].face_count(), 0


def status(key: str) -> int:
    """A line of this process's status, in bytes (Linux)."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key + ":"):
            return int(line.split()[1]) * 1024
    raise ValueError(key)


def measure(variant: str, path: Path) -> Measured:
    """Loads the mesh in this process; `variant` is one of Mitsuba's, or lajolla."""
    load: Callable[[Path], tuple[object, float, float]] = with_lajolla
    if variant != "lajolla":
        default_variant()  # finds LLVM
        import mitsuba as mi

        mi.set_variant(variant)
        load = with_mitsuba
    load(path.with_name(f"small{path.suffix}"))
    before = status("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    start = time.perf_counter()
    scene, triangles, arrays = load(path)
    seconds = time.perf_counter() - start
    kept, peak = status("VmRSS") - before, status("VmHWM") - before
    del scene
    return {
        "seconds": seconds,
        "kept": kept / triangles,
        "peak": peak / triangles,
        "arrays": arrays / triangles,
    }


def measure_apart(variant: str, path: Path) -> Measured:
    """The same in a new process."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(measure, variant, path).result()


def medians(runs: list[Measured]) -> Measured:
    """Of each number."""
    return {name: statistics.median(run[name] for run in runs) for name in runs[0]}


def main() -> int:
    """Parses the command line, prints one row per format and returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("formats", nargs="*", metavar="FORMAT", help=f"of {', '.join(FORMATS)} (all)")
    parser.add_argument("--triangles", type=int, default=1_000_000, help="about so many (%(default)s)")
    parser.add_argument("--runs", type=int, default=5, help="of each renderer (%(default)s)")
    options = parser.parse_args()
    unknown = [name for name in options.formats if name not in FORMATS]
    if unknown or options.runs < 1 or options.triangles < 8:
        parser.error(f"unknown format {unknown[0]!r}" if unknown else "runs and triangles must be positive")
    variants = ("lajolla", *dict.fromkeys((default_variant(), "scalar_rgb")))
    columns = (
        "format",
        "lajolla [s]",
        "mitsuba [s]",
        "variant",
        "ratio",
        "arrays",
        "kept",
        "peak",
        "mitsuba's",
    )
    print("|", " | ".join(columns), "|")
    print("|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        write_files(Path(folder), options.triangles)
        for kind in options.formats or FORMATS:
            runs: dict[str, list[Measured]] = {variant: [] for variant in variants}
            for _ in range(options.runs):
                for variant, taken in runs.items():
                    taken.append(measure_apart(variant, Path(folder) / f"mesh.{kind}"))
            ours, *theirs = (medians(taken) for taken in runs.values())
            best, name = min(zip(theirs, variants[1:], strict=True), key=lambda pair: pair[0]["seconds"])
            print(
                f"| {kind} | {ours['seconds']:.3f} | {best['seconds']:.3f} | {name} "
                f"| {best['seconds'] / ours['seconds']:.2f} | {ours['arrays']:.0f} | {ours['kept']:.0f} "
                f"| {ours['peak']:.0f} | {best['kept']:.0f}, {best['peak']:.0f} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
