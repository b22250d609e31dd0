"""Parameters of loaded scenes: changes give the bits of a scene that was built with them, and share the rest."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plugin_tools import plugin_entry, scene_with
from test_faults import KINDS, files  # noqa: F401

import lajolla
from lajolla import _core
from lajolla.scene import core_schema, plugins_by_kind
from lajolla.scene.schema import Field

SIZE = (4, 4)
LIGHT = {"type": "point", "position": [0, 3, 1], "intensity": 40.0}


def rendered(core: _core.Scene) -> np.ndarray:
    render = _core.Render(core, 1)
    render.advance(3, 1)
    return render.image()


def loaded(scene: dict[str, Any], **options: Any) -> lajolla.Scene:  # noqa: ANN401
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lajolla.SceneWarning)
        return lajolla.load_dict(scene, size=SIZE, **options)


def assert_as_if_loaded(scene: lajolla.Scene) -> None:
    """A scene that was changed is one that is built from its description."""
    fresh = rendered(_core.Scene(scene.description.core))
    assert np.array_equal(rendered(scene.core), fresh, equal_nan=True)


def other(value: Any, field: Field) -> Any:  # noqa: ANN401
    """Another value for a numeric field, within its range; None for fields of another type."""
    low = -np.inf if field.minimum is None else field.minimum
    high = np.inf if field.maximum is None else field.maximum
    if isinstance(value, bool):
        return not value
    if field.choices:
        return next(choice for choice in (*field.choices, value) if choice != value)
    if isinstance(value, int):
        return int(value + 1 if value + 1 <= high else value - 1)
    if field.type == "transform":
        return value @ np.diag([1.1, 1.1, 1.1, 1.0])
    if field.type in ("image", "grid"):
        return None if value is None else np.asarray(value, np.float32)[::-1] * np.float32(0.7)
    numbers = np.asarray(value)
    if numbers.dtype.kind != "f":
        return None
    moved = numbers * 0.9 + 0.05 * np.arange(1, numbers.size + 1).reshape(numbers.shape)
    clipped = np.clip(moved, low, high)
    return clipped if numbers.shape else float(clipped)


def same(value: Any, expected: Any) -> bool:  # noqa: ANN401
    if isinstance(expected, str):
        return bool(value == expected)
    return bool(np.allclose(value, expected, rtol=2e-3, atol=1e-6))  # half precision of voxels


WITHOUT_NUMBERS = {"bsdf": {"measured"}}  # models that only files make


@pytest.mark.parametrize("kind", KINDS)
def test_every_parameter_of_every_model(kind: str, files: Path) -> None:  # noqa: F811
    changed, seen = 0, set()
    for plugin in plugins_by_kind()[kind].values():
        try:
            given = {**scene_with(kind, plugin_entry(kind, plugin.name)), "light": LIGHT}
            scene = loaded(given, base_path=files)
        except lajolla.SceneError:
            continue  # a plugin of which the file is another one
        before = rendered(scene.core)
        seen.update((found.kind, found.model) for found in scene.params.objects.values())
        for path, value in scene.params.items():
            new = other(value, scene.params.field(path))
            if new is None:
                continue
            try:
                scene_after = scene.with_params({path: new})
            except lajolla.SceneError as problem:
                assert "\n" not in problem.message, path  # several fields depend on each other
                continue
            if not path.startswith("film."):  # a window is cut where the film ends
                assert same(scene_after[path], new), path
            assert_as_if_loaded(scene_after)
            changed += 1
        assert np.array_equal(rendered(scene.core), before, equal_nan=True), plugin.name
    assert changed
    for checked in ("bsdf", "adapter") if kind == "bsdf" else (kind,):
        every = set(core_schema()[checked]) - WITHOUT_NUMBERS.get(checked, set())
        assert {(checked, model) for model in every} <= seen
