"""Render options, and their effect on the description."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from lajolla.limits import LIMITS, OptionError, check
from lajolla.messages import suggestion
from lajolla.scene import core_schema, plugins_by_kind


@dataclass(frozen=True)
class Options:
    """Options of a render; None means the scene's own value."""

    spp: int | None = None  # samples per pixel
    size: tuple[int, int] | None = None  # width, height in pixels; drops the scene's crop window
    crop: tuple[int, int, int, int] | None = None  # x, y, width, height in pixels
    seed: int | None = None
    sampler: str | None = None  # "independent" or "sobol", which replaces all samplers named in scenes
    integrator: str | None = None  # keeps the scene's parameters that the new one has too
    max_depth: int | None = None  # -1: unlimited, 1: emitters only, 2: direct light
    sensor: int | str | None = None  # one of several, by its number from 0 or its id

    def __post_init__(self) -> None:
        """Raises OptionError for invalid values."""
        for name, value in vars(self).items():
            if name in LIMITS and not (name == "sensor" and isinstance(value, str)):
                check(name, value)
        _check_name("sampler", self.sampler, lambda: list(core_schema()["sampler"]))
        integrators = plugins_by_kind()["integrator"]
        _check_name("integrator", self.integrator, lambda: [plugin.name for plugin in integrators.values()])


def _check_name(kind: str, name: str | None, known: Callable[[], list[str]]) -> None:
    if name is not None and name not in known():
        raise OptionError(f"unknown {kind} {name!r}{suggestion(str(name), known())}")


def apply_options(core: dict[str, Any], options: Options) -> dict[str, Any]:
    """The description with options instead of the scene's own values. Raises OptionError.

    `integrator` and `sensor` are ignored here, because they apply when the scene is read.
    """
    result = dict(core)
    points = {"type": options.sampler, "sample_count": options.spp, "seed": options.seed}
    result["sampler"] = _with(core["sampler"], **points)
    film = dict(core["film"])
    if options.size is not None:
        film = {key: value for key, value in film.items() if not key.startswith("crop_")}
        film["width"], film["height"] = options.size
    if options.crop is not None:
        film.update(_crop_fields(options.crop, film))
    result["film"] = film
    result["integrator"] = _integrator(core["integrator"], options)
    return result


def _with(entry: Mapping[str, Any], **values: object) -> dict[str, Any]:
    return {**entry, **{key: value for key, value in values.items() if value is not None}}


def _crop_fields(crop: tuple[int, int, int, int], film: Mapping[str, Any]) -> dict[str, int]:
    x, y, width, height = crop
    if x < 0 or y < 0 or x + width > film["width"] or y + height > film["height"]:
        raise OptionError(
            f"the crop window {x},{y},{width},{height} (x, y, width, height) reaches outside of the film, "
            f"{film['width']} x {film['height']}"
        )
    return {"crop_offset_x": x, "crop_offset_y": y, "crop_width": width, "crop_height": height}


def _integrator(entry: Mapping[str, Any], options: Options) -> dict[str, Any]:
    fields = {field["name"] for field in core_schema()["integrator"][entry["type"]]["fields"]}
    if options.max_depth is not None and "max_depth" not in fields:
        raise OptionError(f"the integrator {entry['type']!r} has no max_depth")
    return _with(entry, max_depth=options.max_depth)
