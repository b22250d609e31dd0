"""Processor time and memory to load scenes of many objects, beside the mitsuba package.

    python bench/reading.py [--size 1.0] [--runs 3] [--variants NAME ...] [CASE ...]

Writes its scenes to a temporary folder: a case of so many objects has `size` times as many. Each load is in
its own process; libraries are imported and, by a scene of one sphere, kernels are compiled before. `cpu` is
what the process and its threads worked from the call that reads the file until it returns, which does not
depend on what else the machine does; `peak` is the most memory that the process had, libraries included. The
median of the runs counts, and of Mitsuba's variants the one that is faster.
"""

from __future__ import annotations

import argparse
import json
import random
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

HEAD = """<scene version="3.0.0">
<integrator type="path"/>
<sensor type="perspective">
    <transform name="to_world"><lookat origin="0, 0, 10" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="64"/></film>
</sensor>
<emitter type="constant"/>
<bsdf type="diffuse" id="grey"/>
"""
CASES: dict[str, tuple[int, Callable[[Path, random.Random, int], Iterator[str]]]] = {}


def case(count: int) -> Callable[[Callable[[Path, random.Random, int], Iterator[str]]], None]:
    """Adds a case of so many objects under the function's name; the function yields what is in the scene."""

    def add(make: Callable[[Path, random.Random, int], Iterator[str]]) -> None:
        CASES[make.__name__] = (count, make)

    return add


def number(rng: random.Random, low: float = -2, high: float = 2) -> str:
    return f"{rng.uniform(low, high):.6f}"


def place(rng: random.Random, first: str = "") -> str:
    x, y, z = (number(rng) for _ in "xyz")
    move = f'<translate x="{x}" y="{y}" z="{z}"/>'
    return f'<transform name="to_world">\n        {first}{move}\n    </transform>'


def shape(plugin: str, *content: str) -> str:
    lines = "".join(f"    {line}\n" for line in content)
    return f'<shape type="{plugin}">\n{lines}</shape>\n'


def colour(rng: random.Random) -> str:
    return ", ".join(number(rng, 0, 1) for _ in range(3))


RADIUS = '<float name="radius" value="0.01"/>'
GREY = '<ref id="grey"/>'


@case(200_000)
def spheres(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    for _ in range(count):
        yield shape("sphere", RADIUS, place(rng), GREY)


@case(200_000)
def coloured_spheres(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    for _ in range(count):
        x, y, z = (number(rng) for _ in "xyz")
        center = f'<point name="center" x="{x}" y="{y}" z="{z}"/>'
        bsdf = f'<bsdf type="diffuse"><rgb name="reflectance" value="{colour(rng)}"/></bsdf>'
        yield shape("sphere", center, f'<float name="radius" value="{number(rng, 0.01, 0.02)}"/>', bsdf)


@case(200_000)
def scaled_spheres(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    for _ in range(count):
        yield shape("sphere", place(rng, f'<scale value="{number(rng, 0.01, 0.02)}"/>'), GREY)


@case(100_000)
def instances(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    yield f'<shape type="shapegroup" id="group">{shape("sphere", RADIUS, GREY)}</shape>\n'
    for _ in range(count):
        turn = f'<rotate y="1" angle="{number(rng, 0, 360)}"/>'
        yield shape("instance", place(rng, turn), '<ref id="group"/>')


@case(10_000)
def materials(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    for i in range(count):
        yield f'<bsdf type="diffuse" id="m{i}"><rgb name="reflectance" value="{colour(rng)}"/></bsdf>\n'
    for i in range(count):
        yield shape("sphere", RADIUS, place(rng), f'<ref id="m{i}"/>')


@case(10_000)
def textures(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    import OpenImageIO as oiio

    pixels = np.random.default_rng(1).integers(0, 255, (count, 8, 8, 3), np.uint8)
    for i in range(count):
        file = oiio.ImageOutput.create(f"{folder}/{i}.png")
        file.open(f"{folder}/{i}.png", oiio.ImageSpec(8, 8, 3, "uint8"))
        file.write_image(pixels[i])
        file.close()
        picture = (
            f'<texture type="bitmap" name="reflectance"><string name="filename" value="{i}.png"/></texture>'
        )
        yield shape("rectangle", place(rng), f'<bsdf type="diffuse">{picture}</bsdf>')


@case(10_000)
def ply_files(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    points, faces = small_mesh()
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    table = np.zeros(len(faces), [("count", "u1"), ("at", "<i4", 3)])
    table["count"], table["at"] = 3, faces
    yield from mesh_files(folder, rng, count, "ply", header.encode() + points.tobytes() + table.tobytes())


@case(10_000)
def obj_files(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    points, faces = small_mesh()
    text = "".join("v {:.6f} {:.6f} {:.6f}\n".format(*point) for point in points.tolist())
    text += "".join("f {} {} {}\n".format(*face) for face in (faces + 1).tolist())
    yield from mesh_files(folder, rng, count, "obj", text.encode())


def small_mesh() -> tuple[np.ndarray, np.ndarray]:
    """A sphere of 8 x 8 points."""
    rows, columns = np.mgrid[0:8, 0:8]
    theta, phi = np.pi * (rows + 0.5) / 8, 2 * np.pi * columns / 8
    points = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)
    at = (rows * 8 + columns)[:7].ravel()
    right = (rows * 8 + (columns + 1) % 8)[:7].ravel()
    faces = np.concatenate([np.stack([at, at + 8, right + 8], -1), np.stack([at, right + 8, right], -1)])
    return points.reshape(-1, 3).astype("<f4"), faces.astype("<i4")


def mesh_files(folder: Path, rng: random.Random, count: int, kind: str, data: bytes) -> Iterator[str]:
    for i in range(count):
        (folder / f"{i}.{kind}").write_bytes(data)
        yield shape(kind, f'<string name="filename" value="{i}.{kind}"/>', place(rng), GREY)


@case(1_000_000)
def one_obj_file(folder: Path, rng: random.Random, count: int) -> Iterator[str]:
    size = max(2, round((count / 2) ** 0.5) + 1)
    with (folder / "big.obj").open("w") as file:
        for i in range(size * size):
            u, v = i % size / size, i // size / size
            file.write(f"v {u:.6f} {v:.6f} {rng.random():.6f}\nvt {u:.6f} {v:.6f}\nvn 0 0 1\n")
        for i in range(size * size - size):
            if (i + 1) % size:
                corners = [i + 1, i + 2, i + size + 2, i + size + 1]
                a, b, c, d = (f"{corner}/{corner}/{corner}" for corner in corners)
                file.write(f"f {a} {b} {c}\nf {a} {c} {d}\n")
    yield shape("obj", '<string name="filename" value="big.obj"/>', GREY)


def load(renderer: str, path: str, warm: str) -> None:
    """Loads a scene in this process and prints seconds and MB."""
    if renderer == "lajolla":
        from lajolla import load as load_file
    else:
        import mitsuba as mi

        mi.set_variant(renderer)
        mi.set_log_level(mi.LogLevel.Error)
        load_file = mi.load_file
    load_file(warm)
    before = time.process_time()
    load_file(path)
    seconds = time.process_time() - before
    print(json.dumps([seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]))


def measured(renderer: str, path: Path, warm: Path, runs: int) -> tuple[float, float]:
    """The medians of seconds and MB of some loads."""
    command = [sys.executable, __file__, "--load", renderer, str(path), str(warm)]
    results = [
        json.loads(
            subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1]
        )
        for _ in range(runs)
    ]
    seconds, memory = np.median(results, axis=0)
    return float(seconds), float(memory)


def main() -> None:
    parser = argparse.ArgumentParser(description="Times loading scenes of many objects.")
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--size", type=float, default=1.0, help="factor of the number of objects")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--variants", nargs="*", default=["scalar_rgb", "llvm_ad_rgb"])
    parser.add_argument("--load", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.load:
        return load(*arguments.load)
    print("| scene | objects | lajolla cpu s | peak MB | mitsuba cpu s | peak MB | mitsuba / lajolla |")
    print("|---|---|---|---|---|---|---|")
    for name in arguments.cases or CASES:
        most, make = CASES[name]
        count = max(1, round(most * arguments.size))
        with tempfile.TemporaryDirectory() as folder:
            path, warm = Path(folder, "scene.xml"), Path(folder, "warm.xml")
            warm.write_text(HEAD + shape("sphere") + "</scene>\n")
            with path.open("w") as file:
                file.writelines([HEAD, *make(Path(folder), random.Random(1), count), "</scene>\n"])
            own, memory = measured("lajolla", path, warm, arguments.runs)
            others = [measured(variant, path, warm, arguments.runs) for variant in arguments.variants]
        row = f"| {name.replace('_', ' ')} | {count:,} | {own:.2f} | {memory:.0f} |"
        if others:
            other, taken = min(others)
            row += f" {other:.2f} | {taken:.0f} | {other / own:.2f} |"
        print(row, flush=True)


if __name__ == "__main__":
    main()
