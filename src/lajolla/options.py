"""Render options, and their effect on the description."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lajolla.aovs import check_aovs, with_aovs
from lajolla.limits import FOOTPRINTS, LIMITS, STRATEGIES, OptionError, check, check_flag
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
    strategy: str | None = None  # estimators of direct light: "mis", "bsdf" or "light"
    footprint: str | None = None  # what textures are filtered over: "differentials" or "cone"
    sensor: int | str | None = None  # one of several, by its number from 0 or its id
    hide_emitters: bool | None = None  # lights are invisible to the camera
    robust: bool | None = None  # no ray passes between neighbouring triangles
    aovs: Sequence[str] = ()  # variables to render beside the picture (lajolla list aov)

    def __post_init__(self) -> None:
        """Raises OptionError for invalid values."""
        for name, value in list(vars(self).items()):
            if name in LIMITS and not (name == "sensor" and isinstance(value, str)):
                object.__setattr__(self, name, check(name, value))
        for flag in ("hide_emitters", "robust"):
            check_flag(flag, getattr(self, flag))
        object.__setattr__(self, "aovs", check_aovs(self.aovs))
        _check_name("sampler", self.sampler, lambda: list(core_schema()["sampler"]))
        integrators = plugins_by_kind()["integrator"]
        _check_name("strategy", self.strategy, lambda: list(STRATEGIES))
        _check_name("footprint", self.footprint, lambda: list(FOOTPRINTS))
        _check_name("integrator", self.integrator, lambda: [plugin.name for plugin in integrators.values()])


def _check_name(kind: str, name: str | None, known: Callable[[], list[str]]) -> None:
    if name is not None and name not in known():
        raise OptionError(f"unknown {kind} {name!r}{suggestion(str(name), known())}")


def apply_options(core: dict[str, Any], options: Options, light_groups: Sequence[str] = ()) -> dict[str, Any]:
    """The description with options instead of the scene's own values. Raises OptionError.

    `integrator` and `sensor` are ignored here, because they apply when the scene is read.
    """
    result = apply_to_view(core, options)
    result["integrator"] = _integrator(core["integrator"], options)
    if options.robust is not None:
        result["robust"] = options.robust
    if options.hide_emitters is not None and "other_integrators" in core:
        others = [_hiding(entry, options.hide_emitters) for entry in core["other_integrators"]]
        result["other_integrators"] = others
    return with_aovs(result, options.aovs, light_groups) if options.aovs else result


def apply_to_view(entries: Mapping[str, Any], options: Options) -> dict[str, Any]:
    """Entries of a description with the options for its "sampler" and its "film". Raises OptionError."""
    points = {"type": options.sampler, "sample_count": options.spp, "seed": options.seed}
    film = dict(entries["film"])
    if options.size is not None:
        film = {key: value for key, value in film.items() if not key.startswith("crop_")}
        film["width"], film["height"] = options.size
    if options.crop is not None:
        film.update(_crop_fields(options.crop, film))
    return {**entries, "sampler": _with(entries["sampler"], **points), "film": film}


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
    names = ("max_depth", "strategy", "footprint", "hide_emitters")
    given = {name: getattr(options, name) for name in names}
    for name, value in given.items():
        if value is not None and name not in _fields(entry):
            raise OptionError(f"the integrator {entry['type']!r} has no {name}")
    return _with(entry, **given)


def _hiding(entry: Mapping[str, Any], hide: bool) -> Mapping[str, Any]:
    """An integrator beside that of the picture, which may show no lights anyway."""
    return _with(entry, hide_emitters=hide) if "hide_emitters" in _fields(entry) else entry


def _fields(entry: Mapping[str, Any]) -> set[str]:
    return {field["name"] for field in core_schema()["integrator"][entry["type"]]["fields"]}
