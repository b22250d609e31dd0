"""`lajolla list`: every plugin with its parameters, from the declarations of the core and of the reader."""

from collections.abc import Iterator, Mapping
from typing import Any

from lajolla.aovs import AOVS
from lajolla.limits import OptionError
from lajolla.messages import suggestion
from lajolla.scene import core_schema, plugins, plugins_by_kind
from lajolla.scene.schema import INNER_KINDS

Catalog = dict[str, dict[str, Mapping[str, Any]]]


def catalog() -> Catalog:
    """{kind: {name: {"doc": str, "fields": [...]}}}: the core's models, and the reader's own plugins.

    Where both have a name, the reader's counts: it is what scene files see.
    """
    merged: Catalog = {
        kind: dict(models) for kind, models in core_schema().items() if kind not in INNER_KINDS
    }
    for kind, models in plugins().items():
        merged.setdefault(kind, {}).update(models)
    for kind in ("bsdf", "emitter"):  # with their common properties
        merged[kind] = {plugin.name: plugin.described() for plugin in plugins_by_kind()[kind].values()}
    del merged["film"]["film"]  # the common part of the films, which scenes cannot name
    merged["aov"] = {name: {"doc": variable.doc, "fields": []} for name, variable in AOVS.items()}
    return merged


def listing(kind: str | None, name: str | None) -> Iterator[str]:
    """The lines of `lajolla list [KIND [NAME]]`. Raises OptionError for unknown names."""
    everything = catalog()
    if kind is None:
        for each in everything:
            yield from _names(each, everything[each])
        return
    if kind not in everything:
        raise OptionError(f"unknown kind {kind!r} of plugins{suggestion(kind, everything)}")
    if name is None:
        yield from _names(kind, everything[kind])
        return
    if name not in everything[kind]:
        raise OptionError(f"unknown {kind} {name!r}{suggestion(name, everything[kind])}")
    yield from _parameters(kind, name, everything[kind][name])


def _names(kind: str, models: Mapping[str, Any]) -> Iterator[str]:
    yield kind
    width = max((len(name) for name in models), default=0)
    for name, model in sorted(models.items()):
        yield f"  {name:{width}}  {model['doc']}".rstrip()


def _parameters(kind: str, name: str, model: Mapping[str, Any]) -> Iterator[str]:
    yield f"{kind} {name}: {model['doc']}"
    if not model["fields"]:
        yield "  no parameters"
    columns = [
        (field["name"], field["type"], default_text(field), range_text(field)) for field in model["fields"]
    ]
    widths = [max((len(row[i]) for row in columns), default=0) for i in range(4)]
    for row, field in zip(columns, model["fields"], strict=True):
        cells = "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True))
        yield f"  {cells}  {field['doc']}".rstrip()


def default_text(field: Mapping[str, Any]) -> str:
    value = field["default"]
    unit = f" {field['unit']}" if field["unit"] else ""
    return "" if value is None else f"= {_text(value)}{unit}"


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.6g}"
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list | tuple):
        if value == [[float(i == j) for j in range(4)] for i in range(4)]:
            return "identity"
        return ", ".join(_text(item) for item in value)
    return str(value)


def range_text(field: Mapping[str, Any]) -> str:
    low, high = field["minimum"], field["maximum"]
    if field["choices"]:
        return "one of " + ", ".join(field["choices"])
    if low is None and high is None:
        return ""
    if high is None:
        return f"at least {low:g}"
    return f"at most {high:g}" if low is None else f"{low:g} to {high:g}"
