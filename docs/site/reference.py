"""Writes the reference: the plugins, the command line and the Python package, from their declarations."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import command_line
from command_line import text

import lajolla
from lajolla.catalog import catalog, default_text, range_text

EXAMPLES = Path(__file__).with_name("examples.xml")
Fields = list[Mapping[str, Any]]

# Of each kind: the name and the title of its page, and where an object of the kind stands in a scene file.
PAGES = {
    "bsdf": (
        "bsdfs",
        "BSDFs",
        "in a shape, in another bsdf, or in the scene with an id that shapes refer to",
    ),
    "texture": ("textures", "Textures", "in an object with a parameter of its name, such as `reflectance`"),
    "emitter": ("emitters", "Emitters", "in the scene; an `area` emitter in a shape"),
    "medium": ("media", "Media", "in a shape, named `interior` or `exterior`"),
    "phase": ("phases", "Phase functions", "in a medium"),
    "volume": ("volumes", "Volumes", "in a medium, with the name of a parameter such as `sigma_t`"),
    "shape": ("shapes", "Shapes", "in the scene"),
    "sensor": ("sensors", "Sensors", "in the scene"),
    "film": ("films", "Films", "in a sensor"),
    "rfilter": ("filters", "Pixel filters", "in a film"),
    "sampler": ("samplers", "Samplers", "in a sensor"),
    "integrator": ("integrators", "Integrators", "in the scene"),
}
# The types of parameters, and how scene files write them.
NUMBER, COLOUR = '<float name="NAME" value="0.5"/>', '<rgb name="NAME" value="0.8, 0.4, 0.1"/>'
TEXTURE, VOLUME = '<texture type="..." name="NAME">', '<volume type="..." name="NAME">'
TYPES = {
    "float": ("number", NUMBER),
    "integer": ("integer", '<integer name="NAME" value="5"/>'),
    "boolean": ("boolean", '<boolean name="NAME" value="true"/>'),
    "string": ("text", '<string name="NAME" value="text"/>'),
    "choice": ("one of several words", '<string name="NAME" value="word"/>'),
    "vector": ("point or vector", '<point name="NAME" x="0" y="1" z="0"/>'),
    "spectrum": ("colour", COLOUR),
    "texture_float": ("number or texture", f"{NUMBER}, {TEXTURE}"),
    "texture_spectrum": ("colour or texture", f"{COLOUR}, {TEXTURE}"),
    "volume_float": ("number or volume", f"{NUMBER}, {VOLUME}"),
    "volume_spectrum": ("colour or volume", f"{COLOUR}, {VOLUME}"),
    "volume_matrix": ("matrix or volume", VOLUME),
    "transform": (
        "transformation",
        '<transform name="NAME"> with translate, rotate, scale, lookat or matrix',
    ),
    "phase": ("phase function", '<phase type="..." name="NAME">'),
    "floats": ("list of numbers", '<string name="NAME" value="1, 2, 3"/>'),
}
SIMPLE = ("float", "integer", "boolean", "choice", "vector", "spectrum", "texture_float", "texture_spectrum")
MOST_SHOWN = 3  # parameters of an example that is made here

PYTHON = """\
# Python package

[The Python API](../python.md) shows it in twelve tasks.
Below are its public names with the texts of `help()`.
"""


def write_reference(folder: Path) -> None:
    """Writes all pages of the reference into a folder, which it makes."""
    folder.mkdir()
    everything = catalog()
    for kind, (name, title, where) in PAGES.items():
        (folder / f"{name}.md").write_text(_plugins(kind, title, where, everything[kind]))
    (folder / "types.md").write_text(_types())
    (folder / "aovs.md").write_text(_variables(everything["aov"]))
    (folder / "command-line.md").write_text(command_line.page())
    (folder / "python.md").write_text(_python())


# --- plugins ------------------------------------------------------------------------------------------------


def _plugins(kind: str, title: str, where: str, models: Mapping[str, Mapping[str, Any]]) -> str:
    """The page of a kind."""
    common = _common(models)
    place = f"An object `<{kind}>` stands {where}."
    parts = [f"# {title}", f"{place} [Types of parameters](types.md) tells how their values are written."]
    if common:
        parts += ["## Common parameters", _table(common), "The tables below leave them out."]
    examples = read_examples()
    for name, model in sorted(models.items(), key=lambda item: item[0].lower()):
        own = [field for field in model["fields"] if field not in common]
        shared = [f"`{field['name']}`" for field in model["fields"] if field in common]
        parts += [f"({kind}-{name})=\n## {name}", text(model["doc"])]
        if own:
            parts.append(_table(own))
        if shared:
            parts.append(f"{'Also' if own else 'Parameters:'} {', '.join(shared)}.")
        elif not own:
            parts.append("It has no parameters.")
        parts.append(_example(kind, name, model["fields"], examples))
    return "\n\n".join(parts) + "\n"


def _common(models: Mapping[str, Mapping[str, Any]]) -> Fields:
    """The parameters that most plugins of a kind have, if there are many plugins."""
    if len(models) < 7:
        return []
    found: Fields = [field for model in models.values() for field in model["fields"]]
    common: Fields = []
    for field in found:
        if field not in common and 2 * sum(field == other for other in found) > len(models):
            common.append(field)
    return common


def _table(fields: Iterable[Mapping[str, Any]]) -> str:
    rows = ["| Parameter | Type | Default | Range | Meaning |", "|---|---|---|---|---|"]
    for field in fields:
        kind = TYPES[field["type"]][0] if field["type"] in TYPES else "from Python"
        default = "" if field["type"] == "phase" else default_text(field).removeprefix("= ")
        unit = f" ({field['unit']})" if field["unit"] and field["default"] is None else ""  # else beside it
        cells = (
            f"`{field['name']}`",
            kind,
            text(default),
            text(range_text(field)),
            text(field["doc"] + unit),
        )
        rows.append("| " + " | ".join(cells) + " |")
    return "{.parameters}\n" + "\n".join(rows)


# --- examples -----------------------------------------------------------------------------------------------


def read_examples() -> dict[tuple[str, str], str]:
    """The examples of examples.xml by kind and name."""
    found = {}
    for example in re.finditer(r"^<(\w+) type=\"(\w+)\".*?^</\1>$", EXAMPLES.read_text(), re.M | re.S):
        found[example[1], example[2]] = example[0]
    return found


def example_of(kind: str, name: str, fields: Fields, examples: Mapping[tuple[str, str], str]) -> str | None:
    """How a scene file has a plugin; None if only Python can make it."""
    if (kind, name) in examples:
        return examples[kind, name]
    if any(field["type"] not in TYPES and field["default"] is None for field in fields[:1]):
        return None
    lines = [line for field in fields if (line := _property(field))][:MOST_SHOWN]
    place = ' name="reflectance"' if kind == "texture" else ""
    if not lines:
        return f'<{kind} type="{name}"{place}/>'
    return "\n".join([f'<{kind} type="{name}"{place}>', *(f"    {line}" for line in lines), f"</{kind}>"])


def _property(field: Mapping[str, Any]) -> str | None:
    """A parameter with its default value as scene files write it; None if it is no plain value."""
    kind, name, value = field["type"], field["name"], field["default"]
    if kind not in SIMPLE or value is None or name in ("visible_to_camera", "holdout", "shadow_catcher"):
        return None
    if kind == "vector":
        x, y, z = value
        return f'<vector name="{name}" x="{x:g}" y="{y:g}" z="{z:g}"/>'
    shown = default_text({**field, "unit": ""}).removeprefix("= ")
    tag = {"choice": "string", "spectrum": "rgb", "texture_spectrum": "rgb", "texture_float": "float"}.get(
        kind, kind
    )
    return f'<{tag} name="{name}" value="{shown}"/>'


def _example(kind: str, name: str, fields: Fields, examples: Mapping[tuple[str, str], str]) -> str:
    example = example_of(kind, name, fields, examples)
    if example is None:
        return "Scene files cannot hold its data: it is for dicts, see [the Python API](../python.md)."
    return f"```xml\n{example}\n```"


# --- other pages --------------------------------------------------------------------------------------------


def _types() -> str:
    rows = "\n".join(f"| {name} | {_code(syntax)} |" for name, syntax in TYPES.values())
    return (
        "# Types of parameters\n\nHow scene files write them; dicts have the values themselves.\n\n"
        f"| Type | In scene files |\n|---|---|\n{rows}\n\n"
        "Parameters that are *from Python* take arrays and other objects in dicts alone.\n"
    )


def _code(syntax: str) -> str:
    tags = re.split(r"(<[^>]*>)", syntax)
    return "".join(f"`{part}`" if part.startswith("<") else part for part in tags)


def _variables(models: Mapping[str, Mapping[str, Any]]) -> str:
    rows = "\n".join(f"| `{name}` | {text(model['doc'])} |" for name, model in models.items())
    return (
        "# Variables for `--aov`\n\n[Layers, ids, mattes and compositing](../outputs.md) shows their use.\n\n"
        f"| Name | Meaning |\n|---|---|\n{rows}\n"
    )


def _python() -> str:
    """Every public name, functions before classes, and errors last."""
    names: dict[str, list[str]] = {"Functions": [], "Classes": [], "Errors and warnings": []}
    for name in lajolla.__all__:
        value = getattr(lajolla, name)
        if not isinstance(value, type):
            names["Functions"].append(f".. autofunction:: lajolla.{name}")
        elif issubclass(value, BaseException):
            names["Errors and warnings"].append(f".. autoexception:: lajolla.{name}")
        else:
            names["Classes"].append(f".. autoclass:: lajolla.{name}\n   :members:")
    parts = [
        f"## {title}\n\n```{{eval-rst}}\n" + "\n".join(lines) + "\n```" for title, lines in names.items()
    ]
    return "\n\n".join([PYTHON, *parts]) + "\n"
