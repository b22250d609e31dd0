"""What plugins declare: fields, and children and properties that are none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Protocol, TypeAlias

from lajolla import _core

# A core model's schema: {kind: {name: {"doc": str, "fields": [{"name": str, "type": str, ...}]}}}.
Schema: TypeAlias = Mapping[str, Mapping[str, Mapping[str, Any]]]

# Kinds of children that an object may contain without a field for them.
CHILDREN = {
    "shape": ("bsdf", "emitter", "medium", "subsurface"),
    "sensor": ("film", "sampler", "medium"),
    "emitter": ("medium",),  # light finds out by itself in which medium it is
    "film": ("rfilter",),
}

# Kinds of models of the core that scene files know as bsdfs and shapes.
INNER_KINDS = ("adapter", "instance", "material")

# Properties of all shapes and instances: how the camera sees them. The values are the defaults.
COMPOSITING = {"visible_to_camera": True, "holdout": False, "shadow_catcher": False}

# The property of a scene by which Embree lets no ray pass between neighbouring triangles; entry "robust".
ROBUST = "embree_use_robust_intersections"

TEXTURED = ("texture_float", "texture_spectrum")  # types of fields that take textures

# Properties of Mitsuba that cannot change the picture's values here: hints to its samplers, and how and where
# it writes files, which the command line decides.
HARMLESS = {
    "scene": (
        "kd_intersection_cost",  # this and the rest: how Mitsuba builds trees without Embree, and uses GPUs
        "kd_traversal_cost",
        "kd_empty_space_bonus",
        "kd_stop_prims",
        "kd_max_depth",
        "kd_min_max_bins",
        "kd_clip",
        "kd_retract_bad_splits",
        "kd_exact_primitive_threshold",
        "allow_thread_reordering",
    ),
    "emitter": ("sampling_weight", "cache"),
    "bsdf": (
        "sample_visible",
        "specular_sampling_weight",
        "main_specular_sampling_rate",
        "clearcoat_sampling_rate",
        "specular_reflectance_sampling_rate",
        "specular_transmittance_sampling_rate",
        "diffuse_reflectance_sampling_rate",
        "diffuse_transmittance_sampling_rate",
    ),
    "sensor": ("focus_distance", "shutter_open", "shutter_close"),
    "sampler": ("wavefront_size",),
    "film": (
        "banner",
        "filename",
        "attach_log",
        "compensate",
        "high_quality_edges",  # pixels see the same at the border of the film as elsewhere
    ),
    "shape": ("name", "silhouette_sampling_weight"),
    "texture": ("accel", "cache", "format"),
    "medium": (
        "sample_emitters",
        "has_spectral_extinction",
        "method",
        "step_size",
        "strategy",
        "sampling_weight",
    ),
    "volume": ("raw", "accel", "max_value", "send_data"),
    "integrator": (
        "samples_per_pass",
        "block_size",
        "timeout",
        "cache_dimension",
        "use_spectral_mis",
        "sppc",  # this and the rest: how Mitsuba estimates derivatives
        "sppp",
        "sppi",
        "guiding",
        "guiding_proj",
        "guiding_rounds",
        "project_seed",
    ),
}


@dataclass(frozen=True)
class Field:
    """One parameter, as `_core.schema()` describes it; the reader adds the type "string"."""

    name: str
    type: str
    doc: str
    default: Any = None
    minimum: float | None = None
    maximum: float | None = None
    unit: str = ""
    choices: tuple[str, ...] = ()


class Declared(Protocol):
    """A plugin as far as names go."""

    @property
    def name(self) -> str:
        """As scene files write it."""

    @property
    def fields(self) -> Sequence[Field]:
        """Its parameters."""


@cache
def core_schema() -> Schema:
    """`_core.schema()`, which is recomputed in each call; do not modify this one."""
    return _core.schema()


def fields_of(schema: Schema, kind: str, name: str) -> tuple[Field, ...]:
    """The fields of a core model; empty if the core does not have it."""
    model = schema.get(kind, {}).get(name, {"fields": []})
    known = Field.__dataclass_fields__
    fields = ({key: value for key, value in field.items() if key in known} for field in model["fields"])
    return tuple(Field(**{**field, "choices": tuple(field["choices"] or ())}) for field in fields)


@cache
def terminator_field() -> Field:
    """The property that every bsdf has: what the material of a shape takes from its outermost one."""
    fields = fields_of(core_schema(), "material", "material")
    found = next(field for field in fields if field.name == "terminator")
    return replace(found, doc=f"{found.doc}; in dicts, hanika is the default")
