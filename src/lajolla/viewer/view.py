"""One view of a scene: a scene and a camera that stay as they are, and the pictures rendered of it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lajolla import _core
from lajolla.aovs import AOVS, IDS, SAMPLES
from lajolla.colour import FloatImage
from lajolla.loaded_scene import Scene
from lajolla.render import Rendering, StopRules

LAYER_SAMPLES = 16  # per pixel, of variables, which have little noise
KNOWN_LIMITS = {"albedo": (0.0, 1.0), "uv": (0.0, 1.0), "normal": (-1.0, 1.0), "geo_normal": (-1.0, 1.0)}
SPREAD = (1, 99)  # percentiles of a layer that are shown as black and white

Limits = tuple[float, float]


@dataclass
class View:
    """What is rendered until something changes; renderings are kept when another layer is shown."""

    scene: Scene
    number: int
    rules: StopRules  # of the picture
    threads: int
    _renderings: dict[str, Rendering] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def window(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of what is rendered, in pixels of the film."""
        return (*self.scene.core.crop_offset, self.scene.width, self.scene.height)

    @cached_property
    def layers(self) -> dict[str, str]:
        """The names of what can be shown beside the picture, with descriptions."""
        shown = {name: variable.doc for name, variable in AOVS.items() if variable.field or name in IDS}
        return {**shown, **layers_of(self.scene.core.channels)}

    def rendering(self, layer: str) -> Rendering:
        """The render that a layer is a part of; begun if there is none."""
        key = layer if _is_field(layer) else ""
        with self._lock:  # pages ask for pixels in other threads
            if key not in self._renderings:
                self._renderings[key] = self._begun(key)
            return self._renderings[key]

    def _begun(self, layer: str) -> Rendering:
        core, rules = self.scene.core, self.rules
        if layer:
            core, rules = core.with_output(self._output(layer)), StopRules(spp=LAYER_SAMPLES)
        return Rendering(
            core,
            self.scene.description.core,
            rules=rules,
            seed=core.seed,
            threads=self.threads,
            film=self.scene.film,
        )

    def _output(self, layer: str) -> dict[str, Any]:
        """The output of a render that shows a variable."""
        hidden = self.scene.description.core["integrator"].get("hide_emitters", False)
        field = {"type": "field", "field": AOVS[layer].field, "see_through": True, "through_lights": hidden}
        return {"integrator": field, "other_integrators": [], "channels": []}

    def limit(self, rules: StopRules) -> None:
        """Lets the picture's render end by other rules."""
        self.rules = rules
        if "" in self._renderings:
            self._renderings[""].rules = rules

    def preview(
        self, layer: str, divisor: int, begun: Callable[[_core.Render], None] = lambda render: None
    ) -> FloatImage | None:
        """A layer with one sample for each pixel of a picture whose sides are divided by a number.

        `begun` is called with the render, if there is one; None if that is cancelled.
        """
        core = with_film(self.scene, _divided(self.scene.description.core["film"], divisor))
        if layer in IDS:
            return _id_colours(core, layer, self.threads)
        if _is_field(layer):
            core = core.with_output(self._output(layer))
        render = _core.Render(core, core.seed)
        begun(render)
        if not render.advance(1, self.threads):
            return None
        own = "" if _is_field(layer) else layer
        return of_layer(render.image(), own, core.channels, render.pixel_counts())

    def picture(self, layer: str) -> FloatImage:
        """A layer of what is rendered so far, (height, width, 3)."""
        if layer in IDS:
            return _id_colours(self.scene.core, layer, self.threads)
        rendering = self.rendering(layer)
        counts = rendering.accumulator.pixel_counts()
        own = "" if _is_field(layer) else layer
        return of_layer(rendering.accumulator.image(), own, rendering.channels, counts)


def limits_of(layer: str, pixels: FloatImage) -> Limits | None:
    """The values of a layer that are shown as black and white; None for light, which is tone mapped."""
    if layer == "" or layer.startswith("lightgroup_"):
        return None
    if layer in IDS:
        return 0.0, 1.0
    if layer in KNOWN_LIMITS:
        return KNOWN_LIMITS[layer]
    finite = pixels[np.isfinite(pixels)]
    low, high = np.percentile(finite, SPREAD).tolist() if finite.size else (0.0, 1.0)
    return (low, high) if high > low else (low, low + 1)


def _is_field(layer: str) -> bool:
    return layer in AOVS and bool(AOVS[layer].field)


def layers_of(channels: list[str]) -> dict[str, str]:
    """The layers that the channels of a render are, and the numbers of samples, with descriptions."""
    groups = [SAMPLES, *(label.rpartition(".")[0] or label for label in channels)]
    return {name: AOVS[name].doc if name in AOVS else "" for name in groups}


def of_layer(means: FloatImage, layer: str, channels: list[str], counts: NDArray[np.uint32]) -> FloatImage:
    """The three numbers of each pixel that a layer has among all of a render."""
    if layer == "":
        return means[..., :3]
    if layer == SAMPLES:
        return np.repeat(counts.astype(np.float32)[..., None], 3, axis=2)
    found = [3 + i for i, label in enumerate(channels) if (label.rpartition(".")[0] or label) == layer]
    return means[..., (found * 3)[:3] if len(found) == 1 else [*found, *found][:3]]


def _id_colours(core: _core.Scene, layer: str, threads: int) -> FloatImage:
    """A colour for each number, at random but always the same; black for none."""
    numbers = _core.ids_at_centres(core, threads)[..., IDS.index(layer)].astype(np.int64) + 1
    hashed = numbers[..., None] * np.array([0x9E3779B1, 0x85EBCA6B, 0xC2B2AE35]) & 0xFFFFFFFF
    hashed = (hashed ^ hashed >> 15) * 0x2C1B3C6D & 0xFFFFFFFF
    colours = 0.15 + 0.85 * ((hashed ^ hashed >> 13) & 255) / 255
    return np.where(numbers[..., None] > 0, colours, 0).astype(np.float32)


def _divided(film: Mapping[str, Any], divisor: int) -> dict[str, Any]:
    """A film with fewer pixels, and the same crop window as far as these permit."""
    result = dict(film)
    for side, offset, length in (
        ("width", "crop_offset_x", "crop_width"),
        ("height", "crop_offset_y", "crop_height"),
    ):
        size = -(-film[side] // divisor)
        first = film.get(offset, 0) // divisor
        end = film.get(offset, 0) + (film.get(length, 0) or film[side] - film.get(offset, 0))
        result |= {side: size, offset: first, length: min(-(-end // divisor), size) - first}
    return result


def with_film(scene: Scene, film: Mapping[str, Any]) -> _core.Scene:
    """A scene with another film, which shares all else."""
    changed = scene.core.with_changes({"film": dict(film)})
    return changed or _core.Scene({**scene.description.core, "film": dict(film)})
