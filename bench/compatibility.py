"""Compares public scenes in lajolla and the mitsuba package: whether they open, and the means of the images.

    python bench/compatibility.py [--scenes FOLDER] [--width 64] [--samples 512] [NAME ...] > OUT.md

writes docs/compatibility.md. The mitsuba package opens each scene unchanged, and then renders the result of
`lajolla convert`. Both render the same film with paths of at most 8 segments, without roulette, in 16
independent batches, so that the ratio of the means has a standard error.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from oracle import Estimate, default_variant  # noqa: E402
from test_references import RGB_TO_XYZ, read_xyz, references  # noqa: E402

from lajolla.loaded_scene import Scene  # noqa: E402
from lajolla.options import Options  # noqa: E402
from lajolla.scene import Description, convert, load_description  # noqa: E402

BATCHES = 16
DEPTH = 8
NO_ROULETTE = 1000
FRAGMENTS = ("include", "fragments")  # folders of what other scenes include


@dataclass(frozen=True)
class Comparison:
    """One row: the film, and how both renderers fare."""

    name: str
    opens: bool  # in the mitsuba package, as it is
    warnings: int  # of ours
    lost: int  # warnings about what Mitsuba 3 does not support
    ratio: np.ndarray | None = None  # ours to theirs, of each channel's mean
    error: np.ndarray | None = None  # its standard error
    problem: str = ""

    def row(self) -> str:
        shown = "" if self.ratio is None else " ".join(f"{value:.3f}" for value in self.ratio)
        spread = "" if self.error is None else f"{self.error.max():.3f}"
        cells = (
            self.name,
            "yes" if self.opens else "no",
            self.warnings,
            self.lost,
            shown,
            spread,
            self.problem,
        )
        return "| " + " | ".join(map(str, cells)) + " |"


def scene_files(folder: Path, names: list[str]) -> list[Path]:
    """The scenes that stand for themselves; of series that differ in numbers only, the first."""
    paths = (
        p for p in sorted(folder.rglob("*.xml")) if p.parent.name not in FRAGMENTS and "_rand_" not in p.name
    )
    return [path for path in paths if not names or any(name in str(path) for name in names)]


def compare(path: Path, folder: Path, width: int, samples: int) -> Comparison:
    """Renders one scene with both."""
    import mitsuba as mi

    opens = loads(path)
    description = load_description(path)
    integrator = "volpath" if description.core.get("media") else "path"
    size = small_size(description, width)
    with tempfile.TemporaryDirectory() as made:
        target = Path(made) / "scene.xml"
        result = convert(path, target)
        for name, content in result.files.items():
            write(target.parent / name, content)
        target.write_text(adapted(result.text, integrator, size), encoding="utf-8")
        row = Comparison(
            str(path.relative_to(folder)), opens, len(description.warnings), lost(result.warnings)
        )
        try:
            theirs = mitsuba_batches(mi.load_file(str(target)), samples)
        except RuntimeError as problem:
            return replace(row, problem=f"converted: {str(problem).splitlines()[0][:120]}")
    ours = our_batches(load_description(path, integrator=integrator), size, samples)
    a, b = (estimate.batches.mean(axis=(1, 2)) for estimate in (ours, theirs))
    with np.errstate(invalid="ignore", divide="ignore"):
        spread = np.hypot(*(x.std(axis=0, ddof=1) / x.mean(axis=0) for x in (a, b))) / np.sqrt(BATCHES)
        return replace(row, ratio=a.mean(axis=0) / b.mean(axis=0), error=spread)


def loads(path: Path) -> bool:
    """Whether the mitsuba package opens a file as it is."""
    import mitsuba as mi

    try:
        mi.load_file(str(path))
    except RuntimeError:
        return False
    return True


def lost(warnings: list) -> int:
    return sum(
        warning.message.startswith("Mitsuba 3 ") and "sampler" not in warning.message for warning in warnings
    )


def small_size(description: Description, width: int) -> tuple[int, int]:
    film = description.core["film"]
    return width, max(1, round(width * film["height"] / film["width"]))


def write(path: Path, content: bytes | np.ndarray) -> None:
    from lajolla import image

    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content) if isinstance(content, bytes) else image.write(path, content)


def adapted(text: str, integrator: str, size: tuple[int, int]) -> str:
    """A scene of `lajolla convert` with another integrator and film."""
    root = ET.fromstring(text)
    for old in root.findall("integrator"):
        root.remove(old)
    new = ET.SubElement(root, "integrator", type=integrator)
    for name, value in (("max_depth", DEPTH), ("rr_depth", NO_ROULETTE)):
        ET.SubElement(new, "integer", name=name, value=str(value))
    sensor = root.find("sensor")
    assert sensor is not None
    for film in sensor.findall("film"):
        sensor.remove(film)
    film = ET.SubElement(sensor, "film", type="hdrfilm")
    for name, pixels in zip(("width", "height"), size, strict=True):
        ET.SubElement(film, "integer", name=name, value=str(pixels))
    ET.SubElement(film, "rfilter", type="box")
    return ET.tostring(root, encoding="unicode")


def mitsuba_batches(scene: object, samples: int) -> Estimate:
    import mitsuba as mi

    images = [np.array(mi.render(scene, spp=samples // BATCHES, seed=i + 1000)) for i in range(BATCHES)]
    return Estimate(np.stack(images)[..., :3].astype(np.float64))


def our_batches(description: Description, size: tuple[int, int], samples: int) -> Estimate:
    core = dict(description.core)
    core["rfilter"] = {"type": "box"}
    core["integrator"] = {"type": core["integrator"]["type"], "rr_depth": NO_ROULETTE}
    scene = Scene(replace(description, core=core), Options(size=size, max_depth=DEPTH))
    images = [scene.render(spp=samples // BATCHES, seed=i).array[..., :3] for i in range(BATCHES)]
    return Estimate(np.stack(images).astype(np.float64))


def reference_rows(folder: Path, samples: int) -> Iterator[str]:
    """Our scenes against the images that were published with them."""
    import lajolla

    for path in sorted(folder.glob("mitsuba-data/tests/scenes/*/*.xml")):
        files = references(path)
        if not all(file.is_file() for file in files):
            continue
        mean = read_xyz(files[0]).mean(axis=(0, 1))
        scene = lajolla.load(path)
        picture = scene.render(spp=max(16, samples * 64**2 // (scene.width * scene.height))).array[..., :3]
        xyz = (picture.astype(np.float64) @ RGB_TO_XYZ.T).mean(axis=(0, 1))
        ratios = " ".join(f"{value:.4f}" for value in xyz / mean)
        yield f"| {path.relative_to(folder)} | {ratios} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="parts of paths; all scenes by default")
    parser.add_argument("--scenes", type=Path, default=ROOT.parent / "shared" / "scenes")
    parser.add_argument("--width", type=int, default=64, help="of the films, in pixels")
    parser.add_argument("--samples", type=int, default=512, help="per pixel")
    options = parser.parse_args()
    variant = default_variant()
    import mitsuba as mi

    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    print(
        HEADER.format(
            mitsuba=version("mitsuba"), variant=variant, width=options.width, samples=options.samples
        )
    )
    for path in scene_files(options.scenes, options.names):
        print(compare(path, options.scenes, options.width, options.samples).row(), flush=True)
    print(REFERENCES)
    for row in reference_rows(options.scenes, options.samples):
        print(row, flush=True)


HEADER = """# Compatibility

Made by `bench/compatibility.py`. *Opens*: whether mitsuba {mitsuba} (`{variant}`) opens the file unchanged;
lajolla opens all of them. *Warnings*: number of lajolla's warnings. *Lost*: number of warnings of
`lajolla convert` about features that Mitsuba 3 does not support. *Ratio*: mean of red, green and blue in
lajolla's image of the scene, divided by the mean in Mitsuba's image of the converted scene; {width} pixels
wide, {samples} samples per pixel, at most 8 segments. *Error*: the largest standard error.

| scene | opens | warnings | lost | ratio | error | |
|---|---|---|---|---|---|---|"""

REFERENCES = """
## Published references

Ratios of the means (X, Y, Z) to those of the images that Mitsuba publishes with its test scenes.
`tests/test_references.py` compares them pixel by pixel.

| scene | ratio |
|---|---|"""

if __name__ == "__main__":
    main()
