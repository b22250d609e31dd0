"""Outputs of a render: pictures in files or on standard output, and statistics."""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

from lajolla.aovs import object_channels, object_layers
from lajolla.arguments import STREAMS
from lajolla.display import say
from lajolla.film import Film
from lajolla.image import Image, check_exact, check_output, check_space
from lajolla.loaded_scene import Scene
from lajolla.picture_files import ImageError, ImageWarning
from lajolla.picture_formats import ENDINGS, HOLD_CHANNELS, LOW_RANGE, ending_of
from lajolla.render import Rendering
from lajolla.whole_files import Target, check_folder, is_device, replacing


@dataclass(frozen=True)
class Output:
    """A picture to be written; "-" is standard output."""

    path: Path
    format: str | None = None  # used if the path has no known ending

    def __str__(self) -> str:
        return "standard output" if self.is_standard else str(self.path)

    @property
    def is_standard(self) -> bool:
        return str(self.path) == "-"

    @property
    def target(self) -> Target:
        return sys.stdout.buffer if self.is_standard else self.path

    @property
    def named_format(self) -> str | None:
        """The format, if it does not follow from the path."""
        return None if self.path.suffix.lower() in ENDINGS else self.format

    @property
    def ending(self) -> str:
        """Of its format, such as ".exr"."""
        return ending_of(self.path, self.named_format)

    @property
    def holds_channels(self) -> bool:
        return self.ending in HOLD_CHANNELS

    def check(self) -> None:
        """Raises ImageError if it cannot be written."""
        if self.is_standard and sys.stdout.isatty():
            raise ImageError("standard output is a terminal, which shows no pictures; redirect it to a file")
        if self.is_standard and self.format is None:
            raise ImageError("a picture on standard output needs --format, such as --format png")
        check_output(self.target, self.named_format)

    def check_space(self, scene: Scene, layers: int = 0) -> None:
        """Raises ImageError if the disk may be too full for a picture of the scene with further layers."""
        if not self.is_standard:
            channels = 3 + len(scene.core.channels) + object_channels(scene.aovs) + layers
            check_space(self.path, scene.width, scene.height, channels, self.named_format)

    def check_layers(self, scene: Scene, arguments: argparse.Namespace) -> None:
        """Raises ImageError if the file cannot hold the scene's ids and mattes exactly."""
        if self.ending == ".exr":
            half, compression = arguments.half, arguments.compression
            layers = object_layers(scene.aovs)
            check_exact(self.target, layers, scene.film, half=half, compression=compression)

    def save(self, picture: Image, *, exposure: float, half: bool, compression: str) -> None:
        picture.save(
            self.target, format=self.named_format, exposure=exposure, half=half, compression=compression
        )


def outputs_of(arguments: argparse.Namespace, film: Film | None = None) -> list[Output]:
    """The outputs of a command line without duplicates; the film determines the defaults."""
    paths = list(dict.fromkeys(arguments.outputs or []))
    if film is not None and not paths:
        endings = [f".{arguments.format.lower()}"] if arguments.format else film.endings
        paths = [Path(arguments.scene.stem + arguments.suffix + ending) for ending in endings]
    return [Output(path, arguments.format) for path in paths]


def check(arguments: argparse.Namespace) -> None:
    """Checks the outputs before rendering. Raises ImageError."""
    if arguments.format is not None:
        ending_of(None, arguments.format)
    for output in outputs_of(arguments):
        output.check()
    if arguments.stats is not None and str(arguments.stats) not in STREAMS:
        check_folder(arguments.stats)
    if arguments.checkpoint is not None:
        check_folder(arguments.checkpoint)
        resumed = arguments.resume is not None and _same(arguments.checkpoint, arguments.resume)
        if not resumed and os.path.lexists(arguments.checkpoint):
            raise ImageError(
                f"{arguments.checkpoint}: already exists; continue it with --resume, or delete it"
            )


def check_distinct(arguments: argparse.Namespace, outputs: Sequence[Output]) -> None:
    """Raises ImageError if two files to be written, or one of them and a file that is read, are the same."""
    named = [output.path for output in outputs]
    named += [path for path in (arguments.stats, arguments.checkpoint) if path is not None]
    read = [arguments.scene] if arguments.command == "render" else arguments.files
    if arguments.resume is not None and not _same(arguments.resume, arguments.checkpoint):
        read = [*read, arguments.resume]
    for index, path in enumerate(named):
        if str(path) in STREAMS or is_device(path):
            continue
        for other in (*named[:index], *read):
            if _same(path, other):
                raise ImageError(f"{path}: is named for two files; name another one")


def _same(a: Path, b: Path) -> bool:
    return os.path.realpath(a) == os.path.realpath(b)


def write_pictures(
    outputs: Sequence[Output], picture: Image, arguments: argparse.Namespace
) -> tuple[list[str], list[Exception]]:
    """Writes all that can be written. Returns the names of these, and the errors of others."""
    written: list[str] = []
    errors: list[Exception] = []
    if arguments.tonemap is not None:
        picture.film = replace(picture.film, tonemap_method=arguments.tonemap)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ImageWarning)
        for output in outputs:
            try:
                output.save(
                    picture,
                    exposure=arguments.exposure,
                    half=arguments.half,
                    compression=arguments.compression,
                )
                written.append(str(output))
            except ImageError as error:
                errors.append(error)
    for warning in caught:
        say(f"warning: {warning.message}")
    return written, errors


def warn_of_unused(outputs: Sequence[Output], arguments: argparse.Namespace) -> None:
    """Warns of options that change none of the pictures."""
    endings = {output.ending for output in outputs}
    if (arguments.half or arguments.compression != "zip") and ".exr" not in endings:
        option = "--half" if arguments.half else "--compression"
        say(f"warning: {option} is for .exr files only")
    if (arguments.exposure or arguments.tonemap) and not endings & {*LOW_RANGE}:
        option = "--exposure" if arguments.exposure else "--tonemap"
        say(f"warning: {option} is for PNG, JPEG and the like only")


def raise_last(errors: Sequence[Exception]) -> None:
    """Raises the last of several errors, and prints the others."""
    for error in errors[:-1]:
        say(f"error: {error}")
    if errors:
        raise errors[-1]


def statistics(scene: Scene, rendering: Rendering) -> dict[str, Any]:
    """What --stats writes (docs/json.md)."""
    counts = rendering.accumulator.pixel_counts()
    samples = int(counts.sum(dtype=int))
    seconds = max(rendering.seconds, 1e-9)
    unit = 1 if sys.platform == "darwin" else 1024  # of ru_maxrss
    return {
        "width": scene.width,
        "height": scene.height,
        "samples_per_pixel": rendering.samples,
        "fewest_samples": int(counts.min()),
        "most_samples": int(counts.max()),
        "noise": rendering.noise if math.isfinite(rendering.noise) else None,
        "threads": rendering.threads,
        "load_seconds": scene.load_seconds,
        "build_seconds": scene.build_seconds,
        "render_seconds": rendering.seconds,
        "samples": samples,
        "samples_per_second": samples / seconds,
        "rays_per_second": int(rendering.accumulator.rays.sum()) / seconds,
        "peak_memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit,
        "nonfinite_samples": rendering.accumulator.nonfinite,
    }


def write_statistics(path: Path, stats: dict[str, Any]) -> None:
    text = json.dumps(stats, indent=2) + "\n"
    if str(path) in STREAMS:  # reopening these would truncate a redirected file
        stream: TextIO = getattr(sys, STREAMS[str(path)])
        stream.write(text)
    else:
        with replacing(path) as temporary:
            temporary.write_text(text)
