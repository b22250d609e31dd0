"""Results of `check` and `compare` as text and as JSON (keys in docs/json.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from lajolla.comparison import Comparison
from lajolla.display import size_in_memory
from lajolla.layers import shown
from lajolla.loaded_scene import Scene
from lajolla.scene import SceneError, SceneWarning
from lajolla.survey import Finding

Json = dict[str, Any]


def as_text(result: Json) -> str:
    """Valid JSON: numbers that are not finite become null."""
    return json.dumps(_finite(result), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, dict):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def scene_facts(path: Path, scene: Scene) -> Json:
    """Facts about a scene that opens."""
    counts = dict(scene.core.summary())
    return {
        "scene": str(path),
        "width": scene.width,
        "height": scene.height,
        "samples_per_pixel": scene.core.sample_count,
        "sensors": list(scene.sensors),
        "channels": shown(scene.core.channels),
        "memory_bytes": counts.pop("bytes"),
        "counts": counts,
        "warnings": [{**_located(warning), "count": warning.count} for warning in scene.warnings],
        "error": None,
    }


def refused(path: Path, problem: Exception) -> Json:
    """Facts about a scene that does not open."""
    error = _located(problem) if isinstance(problem, SceneError) else {**NOWHERE, "message": str(problem)}
    return {"scene": str(path), "error": error}


NOWHERE = dict.fromkeys(("message", "file", "line", "column"))


def _located(problem: SceneError | SceneWarning) -> Json:
    """A message with its location; line and column are null if only the file is known."""
    location = problem.location
    if location is None:
        return {**NOWHERE, "message": problem.message}
    known = bool(location.source.data) and not location.key
    return {
        "message": problem.message,
        "file": location.source.name,
        "line": location.line if known else None,
        "column": location.column if known else None,
    }


def scene_lines(facts: Json) -> Iterator[tuple[str, str]]:
    """Labels and values of a scene's facts, for people."""
    for name, count in facts["counts"].items():
        yield name, f"{count:,}"
    samples = facts["samples_per_pixel"]
    yield "picture", f"{facts['width']} x {facts['height']}, {samples} samples per pixel"
    yield "memory", size_in_memory(facts["memory_bytes"])


def folder_facts(folder: Path, findings: Sequence[Finding]) -> Json:
    """Facts about the scenes below a folder: which open, and why others do not."""
    return {
        "folder": str(folder),
        "scenes": [
            {"scene": str(f.path), "warnings": f.warnings, "error": f.error or None} for f in findings
        ],
        "opened": sum(not finding.error for finding in findings),
        "failed": sum(bool(finding.error) for finding in findings),
    }


MEASURES = {"mean ratio": "mean_ratio", "RMSE": "rmse", "relative MSE": "relative_mse"}


def comparison_facts(a: Path, b: Path, result: Comparison) -> Json:
    """Differences between pictures A and B; lists have values for red, green and blue."""
    measures = {name: getattr(result, name).tolist() for name in MEASURES.values()}
    return {"a": str(a), "b": str(b), **measures, "excluded_pixels": result.excluded}


def comparison_lines(facts: Json) -> Iterator[str]:
    yield f"{'':12}  {'red':>12}  {'green':>12}  {'blue':>12}"
    for label, name in MEASURES.items():
        yield f"{label:12}  " + "  ".join(f"{value:12.6g}" for value in facts[name])
