"""What a plugin is to the reader: a name, a line of doc, its fields, and how to build it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from lajolla import _core

if TYPE_CHECKING:
    from .description.builder import Builder
    from .syntax.nodes import Node

# What descriptions and properties hold: numbers, strings, tuples, arrays, core objects, dicts of these.
Content: TypeAlias = Any

# A core model's schema: {kind: {name: {"doc": str, "fields": [{"name": str, "type": str, ...}]}}}.
Schema: TypeAlias = Mapping[str, Mapping[str, Mapping[str, Any]]]

# Kinds of children that may stand in an object without being one of its fields.
CHILDREN = {
    "shape": ("bsdf", "emitter", "medium", "subsurface"),
    "sensor": ("film", "sampler", "medium"),
    "emitter": ("medium",),  # light finds out by itself in which medium it is
    "film": ("rfilter",),
}

TEXTURED = ("texture_float", "texture_spectrum")  # types of fields that take textures

# Properties of Mitsuba that cannot change the picture's values here: hints to its samplers, and how and where
# it writes files, which the command line decides.
HARMLESS = {
    "emitter": ("sampling_weight", "mis_compensation", "cache"),
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


@dataclass(frozen=True)
class AdapterId:
    """An entry of the description's adapters."""

    index: int


BLACK = -1
MaterialId: TypeAlias = int | AdapterId  # the index of a bsdf, an adapter, or BLACK


@dataclass(frozen=True)
class Slot:
    """A material slot: what is seen from the front, and from behind."""

    front: MaterialId
    back: MaterialId = BLACK


@dataclass(frozen=True)
class Part:
    """One of several shapes that a shape of the file becomes, and its bsdf; None: the default one."""

    entry: dict[str, Any]
    bsdf: Node | None


@dataclass(frozen=True)
class Plugin:
    """A plugin of scene files.

    `build(builder, node, values)` gets the values of the properties that were given, converted, and returns
    what the kind asks for: a description entry; for textures also a colour; for bsdfs also a `Slot`; for
    shapes also a list of `Part`s.
    """

    kind: str
    name: str
    doc: str  # empty: that of the core model of the same name
    fields: tuple[Field, ...]
    build: Callable[[Builder, Node, dict[str, Any]], Any]
    children: tuple[str, ...] = ()
    model: str = ""  # the core model that it makes, whose fields it shares
    hidden: tuple[str, ...] = ()  # fields of the model that scenes do not set

    def with_model(self, schema: Schema) -> Plugin:
        """The same plugin with the fields of its core model before its own, and its doc if it has none."""
        kind = "adapter" if self.model in schema.get("adapter", {}) else self.kind
        doc = self.doc or schema.get(kind, {}).get(self.name, {"doc": ""})["doc"]
        shared = fields_of(schema, kind, self.model) if self.model else ()
        own = {f.name for f in self.fields}
        kept = [f for f in shared if f.name not in own and f.name not in self.hidden]
        return Plugin(self.kind, self.name, doc, (*kept, *self.fields), self.build, self.children, self.model)

    def described(self) -> dict[str, Any]:
        """The plugin in the form of `_core.schema()`."""
        return {"doc": self.doc, "fields": [asdict(f) | {"choices": list(f.choices)} for f in self.fields]}


@cache
def core_schema() -> Schema:
    """`_core.schema()`, which is recomputed in each call; do not modify this one."""
    return _core.schema()


def fields_of(schema: Schema, kind: str, name: str) -> tuple[Field, ...]:
    """The fields of a core model; none where the core does not have it."""
    model = schema.get(kind, {}).get(name, {"fields": []})
    known = Field.__dataclass_fields__
    return tuple(
        Field(**{k: tuple(v or ()) if k == "choices" else v for k, v in f.items() if k in known})
        for f in model["fields"]
    )
