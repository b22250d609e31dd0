"""Checkpoints: files with the samples of a render so far, to go on with it or to merge it with others."""

from __future__ import annotations

import itertools
import json
import math
import time
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lajolla import _core, processor
from lajolla.adaptive import Counts, Halves
from lajolla.aovs import VARIANCE, object_layers
from lajolla.film import Film
from lajolla.identity import differences, sections
from lajolla.image import Image
from lajolla.limits import LARGEST, MOST_SAMPLES
from lajolla.picture_files import ImageError
from lajolla.render import Rendering, developed
from lajolla.whole_files import replacing

FORMAT = 2  # of the files; others are refused

# What NumPy raises for a file that is not one of its archives, or that is damaged.
DAMAGES = (ValueError, KeyError, TypeError, EOFError, IndexError, MemoryError, zipfile.BadZipFile, zlib.error)


class CheckpointError(ImageError):
    """A checkpoint that cannot be read, or does not fit; the message names its file and the reason."""


def identity(rendering: Rendering) -> dict[str, Any]:
    """What must be equal for samples to belong to one picture, in plain numbers and texts."""
    scene = rendering.description
    height, width = rendering.halves.size
    film = {name: value for name, value in scene["film"].items() if not name.startswith("crop_")}
    own = {
        "film": {**film, "window": [*rendering.halves.offset, width, height]},
        "sampler": {"type": scene["sampler"]["type"], "seed": rendering.seed},
    }
    return {
        **sections({**scene, **own}),
        "lajolla": {
            "version": version("lajolla"),
            "instruction_set": f"{_core.isa} on {processor.level()}",  # Embree chooses by the processor
        },
    }


@dataclass
class Checkpoint:
    """The samples of a render.

    `ranges` are those of each pixel: (first, end). If pixels have different numbers of samples, there is one
    range of the largest number, and `counts` has the numbers of all halves of cells.
    """

    identity: dict[str, Any]
    width: int
    height: int
    offset: tuple[int, int]  # of the crop window
    channels: list[str]
    film: Film
    aovs: list[str]
    ranges: list[tuple[int, int]]
    seconds: float
    nonfinite: int
    nonfinite_list: list[tuple[int, int, int]]
    sums: _core.Sums
    rays: NDArray[np.uint64]  # of each tile
    counts: Counts
    rounds: dict[str, NDArray[Any]]  # of adaptive renders: the state of the estimate, and the round

    def image(self) -> Image:
        """The mean of the samples."""
        halves = Halves(self.width, self.height, self.offset)
        counts = self.counts.ravel()[halves.of_pixels]
        return developed(self.sums.means(counts), counts, self.channels, self.aovs, self.film)

    @property
    def left_out(self) -> list[str]:
        """AOVs that a picture of it does not have, because they need the scene."""
        return object_layers(self.aovs)

    def write(self, path: Path) -> None:
        """Writes a file in place of the one that is there. Raises ImageError."""
        facts = {
            name: value
            for name, value in vars(self).items()
            if name not in ("sums", "rays", "counts", "rounds")
        }
        text = json.dumps({**facts, "format": FORMAT, "film": asdict(self.film)})
        with replacing(path) as temporary, open(temporary, "wb") as file:
            arrays: dict[str, Any] = {
                "facts": np.array(text),
                "digits": self.sums.digits,
                "places": self.sums.places,
                "rays": self.rays,
                "counts": self.counts,
                **self.rounds,
            }
            np.savez(file, **arrays)


def of_rendering(rendering: Rendering, own: dict[str, Any] | None = None) -> Checkpoint:
    """The present state of a render, which may be running; `own` is its identity, if that is known."""
    sums, counts, rays, nonfinite, nonfinite_list = rendering.accumulator.state()
    estimate, rounds = rendering.estimate, {}
    if rendering.rules.in_rounds:
        rounds = {
            "errors": estimate.errors,
            "changes": estimate.changes,
            "reduction": np.array(estimate.reduction),
            "measured_counts": estimate.counts,
            "measured_picture": estimate.picture,
        }
        if rendering.round is not None:
            rounds["round"] = rendering.round
    height, width = rendering.halves.size
    first = rendering.first_sample
    return Checkpoint(
        identity=own or identity(rendering),
        width=width,
        height=height,
        offset=rendering.halves.offset,
        channels=list(rendering.channels),
        film=rendering.film,
        aovs=list(rendering.aovs),
        ranges=[(first, first + int(counts.max()))],
        seconds=rendering.seconds,
        nonfinite=nonfinite,
        nonfinite_list=nonfinite_list,
        sums=sums,
        rays=rays,
        counts=counts,
        rounds=rounds,
    )


def read(path: Path) -> Checkpoint:
    """Reads a checkpoint. Raises CheckpointError."""
    try:
        if not path.is_file():
            raise CheckpointError(f"{path}: {'is not a file' if path.exists() else 'no such file'}")
        _check_sizes(path)
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        facts = json.loads(str(arrays.pop("facts")))
        if facts.pop("format") != FORMAT:
            raise CheckpointError(f"{path}: is a checkpoint of another version of lajolla")
        return _checked(facts, arrays)
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror or error}") from None
    except DAMAGES as error:
        raise CheckpointError(f"{path}: is not a checkpoint, or is damaged") from error


def _check_sizes(path: Path) -> None:
    """Raises ValueError if an archive is compressed, so that its contents may be larger than its file."""
    with zipfile.ZipFile(path) as archive:
        if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
            raise ValueError
        if sum(member.file_size for member in archive.infolist()) > path.stat().st_size:
            raise ValueError


def _checked(facts: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Checkpoint:
    """The checkpoint of what a file holds; raises one of DAMAGES if parts do not fit each other."""
    width, height = (_whole(facts[name], 1, LARGEST) for name in ("width", "height"))
    x, y = (_whole(number, 0, LARGEST) for number in facts["offset"])
    channels, aovs = ([str(label) for label in facts[name]] for name in ("channels", "aovs"))
    values = (height, width, 3 + len(channels))
    digits = _shaped(arrays.pop("digits"), np.int64, (*values, 2))  # before anything of this size is made
    places = _shaped(arrays.pop("places"), np.int8, values)
    halves = Halves(width, height, (x, y))
    counts = _shaped(arrays.pop("counts"), np.uint32, halves.shape)
    rays = _shaped(arrays.pop("rays"), np.uint64, halves.tiles)
    ranges = [
        (_whole(first, 0, MOST_SAMPLES), _whole(end, 1, MOST_SAMPLES)) for first, end in facts["ranges"]
    ]
    if sorted(ranges) != ranges or any(a[1] > b[0] for a, b in itertools.pairwise(ranges)):
        raise ValueError("ranges overlap")
    if not 0 < sum(end - first for first, end in ranges) == counts.max():
        raise ValueError("other numbers of samples")
    if digits.max() >= 2**62 or digits.min() <= -(2**62):
        raise ValueError("sums are too large")
    if VARIANCE in aovs and not {f"{VARIANCE}.{letter}" for letter in "RGB"} <= set(channels):
        raise ValueError("a channel is missing")
    return Checkpoint(
        identity=dict(facts["identity"]),
        width=width,
        height=height,
        offset=(x, y),
        channels=channels,
        film=Film(**facts["film"]),
        aovs=aovs,
        ranges=ranges,
        seconds=_seconds(facts["seconds"]),
        nonfinite=_whole(facts["nonfinite"], 0, 2**63),
        nonfinite_list=[
            (_whole(x, 0, LARGEST), _whole(y, 0, LARGEST), _whole(sample, 0, MOST_SAMPLES))
            for x, y, sample in facts["nonfinite_list"]
        ],
        sums=_core.Sums(digits, places),
        rays=rays,
        counts=counts,
        rounds=_checked_rounds(arrays, halves),
    )


def _checked_rounds(arrays: dict[str, NDArray[Any]], halves: Halves) -> dict[str, NDArray[Any]]:
    """The state of rounds: all of it, or none."""
    shapes: dict[str, tuple[type[np.generic], tuple[int, ...]]] = {
        "errors": (np.float64, halves.shape),
        "changes": (np.float64, halves.shape),
        "reduction": (np.float64, ()),
        "measured_counts": (np.uint32, halves.shape),
        "measured_picture": (np.float32, (*halves.size, 3)),
        "round": (np.uint32, halves.shape),
    }
    if arrays and not shapes.keys() - {"round"} <= arrays.keys():
        raise ValueError("an array is missing")
    return {name: _shaped(array, *shapes[name]) for name, array in arrays.items()}


def _seconds(value: object) -> float:
    if not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise ValueError("out of range")
    return float(value)


def _whole(value: object, least: int, most: int) -> int:
    if not isinstance(value, int) or not least <= value <= most:
        raise ValueError("out of range")
    return value


def _shaped(array: NDArray[Any], kind: type[np.generic], shape: tuple[int, ...]) -> NDArray[Any]:
    if array.dtype != kind or array.shape != shape:
        raise ValueError("another array")
    return array


def resume(rendering: Rendering, path: Path) -> Rendering:
    """Lets a render continue where a checkpoint ends, and returns it.

    Raises:
        CheckpointError: it is of another render, and the message says what differs.
    """
    saved = read(path)
    _check_same(path, saved.identity, identity(rendering))
    if len(saved.ranges) > 1 or saved.ranges[0][0] != rendering.first_sample:
        kept = " and ".join(f"{first} to {end - 1}" for first, end in saved.ranges)
        wanted = f"samples from {rendering.first_sample} on"
        raise CheckpointError(f"{path}: has samples {kept}, and this render takes {wanted}")
    rendering.accumulator.restore(saved.sums, saved.counts, saved.rays, saved.nonfinite, saved.nonfinite_list)
    rendering.seconds = saved.seconds
    if rendering.rules.in_rounds and "changes" in saved.rounds:
        rendering.estimate.errors = saved.rounds["errors"]
        rendering.estimate.changes = saved.rounds["changes"]
        rendering.estimate.reduction = float(saved.rounds["reduction"])
        rendering.estimate.counts = saved.rounds["measured_counts"]
        rendering.estimate.picture = saved.rounds["measured_picture"]
        rendering.round = saved.rounds.get("round")
    return rendering


def merged(files: Mapping[Path, Checkpoint]) -> Checkpoint:
    """The sum of checkpoints of one picture, whose ranges of samples must not overlap.

    Raises:
        CheckpointError: they overlap, are of different renders, or pixels have different numbers of samples.
    """
    (first_path, result), *others = files.items()
    for path, part in files.items():
        if part.counts.min() < part.counts.max():
            raise CheckpointError(f"{path}: pixels have different numbers of samples, which cannot be merged")
    for path, part in others:
        _check_same(path, part.identity, result.identity, str(first_path))
        for (first, end), (other_first, other_end) in itertools.product(part.ranges, result.ranges):
            if first < other_end and other_first < end:
                both = f"{max(first, other_first)} to {min(end, other_end) - 1}"
                raise CheckpointError(f"{path}: has samples {both}, which others have too")
        result = _sum(result, part)
    return result


def _sum(a: Checkpoint, b: Checkpoint) -> Checkpoint:
    a.sums.add(0, b.sums)
    ranges: list[tuple[int, int]] = []
    for first, end in sorted([*a.ranges, *b.ranges]):
        if ranges and ranges[-1][1] == first:
            ranges[-1] = (ranges[-1][0], end)
        else:
            ranges.append((first, end))
    return replace(
        a,
        ranges=ranges,
        seconds=a.seconds + b.seconds,
        rays=a.rays + b.rays,
        nonfinite=a.nonfinite + b.nonfinite,
        nonfinite_list=[*a.nonfinite_list, *b.nonfinite_list],
        counts=a.counts + b.counts,
        rounds={},
    )


def _check_same(path: Path, a: Mapping[str, Any], b: Mapping[str, Any], other: str = "this render") -> None:
    if found := differences(a, b):
        more = f" and {len(found) - 3} more" if len(found) > 3 else ""
        shown = ", ".join(found[:3])
        raise CheckpointError(f"{path}: does not belong to {other}: {shown}{more} (there and here)")


class Saver:
    """Writes checkpoints of a running render at most every `interval` seconds, when it is called."""

    def __init__(self, rendering: Rendering, path: Path, interval: float) -> None:
        self.rendering = rendering
        self.identity = identity(rendering)
        self.path = path
        self.interval = interval
        self.next = time.monotonic() + interval

    def write_if_due(self) -> ImageError | None:
        """Writes one if it is time. Returns an error, for which the render should not stop."""
        if time.monotonic() < self.next:
            return None
        try:
            self.write()
        except ImageError as error:
            return error
        finally:
            self.next = time.monotonic() + self.interval
        return None

    def write(self) -> None:
        """Raises ImageError."""
        of_rendering(self.rendering, self.identity).write(self.path)
