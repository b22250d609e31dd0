"""Commands that compute a pixel of the viewer again."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Mapping
from typing import Any

import numpy as np

from lajolla.arguments import replay_command

OPTIONS = (
    "size",
    "crop",
    "seed",
    "sampler",
    "integrator",
    "max_depth",
    "strategy",
    "footprint",
    "sensor",
    "hide_emitters",
    "robust",
    "spp",
)


def command_for(
    arguments: argparse.Namespace,
    integrator: str | None,
    sensor: str | None,
    changes: Mapping[str, Any],
    x: int,
    y: int,
) -> str:
    """A command line that prints the radiance of a pixel; one of Python if something was changed.

    Args:
        arguments: of the command that opened the scene.
        integrator, sensor: that were chosen since, if any.
        changes: parameters that were changed since, by their paths.
    """
    arguments = argparse.Namespace(**vars(arguments))
    arguments.integrator = integrator or arguments.integrator
    arguments.sensor = arguments.sensor if sensor is None else sensor
    if not changes:
        return replay_command(arguments, x, y)
    options = {name: value for name in OPTIONS if (value := getattr(arguments, name)) is not None}
    options |= {name: True for name in ("strict", "two_sided") if getattr(arguments, name)}
    if arguments.parameters:
        options["parameters"] = dict(arguments.parameters)
    words = [repr(str(arguments.scene)), *(f"{name}={value!r}" for name, value in options.items())]
    plain = {path: _plain(value) for path, value in changes.items()}
    loaded = f"lajolla.load({', '.join(words)}).with_params({plain!r})"
    return shlex.join(["python", "-c", f"import lajolla; print(*{loaded}.radiance({x}, {y}))"])


def _plain(value: Any) -> Any:  # noqa: ANN401
    return np.asarray(value).tolist() if isinstance(value, np.ndarray) else value
