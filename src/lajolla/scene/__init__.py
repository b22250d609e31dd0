"""Scene reader: text -> elements -> expand -> nodes -> upgrade -> resolve -> spread -> build.

`syntax` parses XML and keeps places, fills in parameters and includes, gives every value its type, and
follows references; `versions` turns old files into the words of Mitsuba 3; `description` makes what
`_core.Scene` takes. `formats` are the files that scenes name, `data` what others measured. A Python dict
enters where nodes begin (`syntax.dict_reader`). The way out leaves before the description is made: `export`.
"""

from __future__ import annotations

import gc
import os
import re
from collections.abc import Container, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, TypeAlias

import numpy as np

from lajolla import _core
from lajolla.film import Film

from .description import cameras
from .description.assemble import assemble
from .description.builder import Builder, FileContent, plugins_by_kind
from .description.entries import Objects, Places, View
from .description.names import Numbered, numbered
from .description.plugins import READER_PLUGINS
from .description.substitutes import SUBSTITUTES
from .formats.images import Pixels
from .schema import core_schema
from .syntax.dict_reader import nodes_from_dict
from .syntax.errors import Blame, Diagnostics, Location, SceneError, SceneWarning, Source, reason_of
from .syntax.expand import Included, UnknownParameter, expand_file
from .syntax.ids import Ids, Member
from .syntax.nodes import Node
from .syntax.resolve import follow, resolve
from .syntax.typed import Tree, member_of_run, nodes_from_elements
from .versions.upgrade import upgrade

__all__ = [
    "Description",
    "Export",
    "Numbered",
    "Objects",
    "Places",
    "SceneError",
    "SceneFile",
    "SceneWarning",
    "UnknownParameter",
    "View",
    "convert",
    "core_schema",
    "describe",
    "load_description",
    "numbered",
    "plugins",
    "plugins_by_kind",
    "reason_of",
    "sensor_names",
]

SceneFile: TypeAlias = str | os.PathLike[str] | BinaryIO
NO_PARAMETERS: Mapping[str, str] = MappingProxyType({})
NOTHING_KNOWN: Mapping[Hashable, FileContent] = MappingProxyType({})


@dataclass(frozen=True)
class Description:
    """A scene as `_core.Scene` takes it, what was not read as written, and where each entry comes from.

    How the picture is to be written, `film`, is no part of the scene.
    """

    core: dict[str, Any]
    warnings: list[SceneWarning]
    places: Places = field(default_factory=Places)
    objects: Objects = field(default_factory=Objects)  # that the entries come from
    film: Film = field(default_factory=Film)
    sensors: tuple[str, ...] = ()  # the ids, or else numbers, of all that there are
    views: Mapping[str, View] = field(default_factory=dict)  # of all but the one that is used, by these names
    light_groups: tuple[str, ...] = ()  # names of the numbers from 1 on that emitters have as "lightgroup"
    files: Mapping[Hashable, FileContent] = field(default_factory=dict)  # that were read
    includes: Sequence[Included] = ()  # of other scene files
    first_sensor: str = ""  # the one that is used unless another is asked for
    options: Mapping[str, Any] = field(default_factory=dict)  # of `load_description`, with which it was read
    _numbered: dict[str, Numbered] = field(default_factory=dict, init=False, repr=False, compare=False)

    def numbered(self, where: str) -> Numbered:
        """Numbers and names of its shapes, materials or instances; counted once."""
        if where not in self._numbered:
            self._numbered[where] = numbered(self.objects, self.core, where)
        return self._numbered[where]

    @property
    def paths(self) -> set[Path]:
        """All files that it was read from: scene files, and those that they name."""
        sources = [included.source for included in self.includes]
        if "scene" in self.places:
            sources.append(self.places["scene"].source)
        return {Path(s.name) for s in sources if s.data}.union(*(source.named for source in sources))

    def without_files(self) -> Description:
        """The same without places in files, and without the contents of these."""
        return replace(self, places=Places(), files={}, includes=())

    def refusal(self, problem: Exception) -> SceneError:
        """The error to raise when the core refuses the description: the core's message at its place.

        Args:
            problem: what it raises; the text of a `_core.DescriptionError` begins with the entry, as in
                "shapes[3]: ...".
        """
        if not isinstance(problem, _core.DescriptionError):
            return SceneError(reason_of(problem), self.places.get("scene"))
        entry = re.match(r"(\w+(?:\[\d+\])?)(?: \(\w+\))?(?:\.|: )(.*)", str(problem), re.DOTALL)
        place = self.places.find(entry[1]) if entry else None
        if entry is None or place is None:
            return SceneError(str(problem), self.places.get("scene"))
        return SceneError(entry[2], place)


@contextmanager
def _collector_paused() -> Iterator[None]:
    """Within it, Python does not look for garbage in cycles.

    A reader only makes objects that stay until it is done, and the collector would go through all of them
    again and again: a fifth of the time of a large scene.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@_collector_paused()
def load_description(
    path: SceneFile,
    *,
    parameters: Mapping[str, str] = NO_PARAMETERS,
    required_names: Container[str] = (),
    strict: bool = False,
    two_sided: bool = False,
    integrator: str | None = None,
    sensor: str | int | None = None,
    runs: bool = True,
    known_files: Mapping[Hashable, FileContent] = NOTHING_KNOWN,
) -> Description:
    """Reads a Mitsuba scene file of any version.

    Args:
        path: an XML file, or a binary file object to read one from.
        parameters: values for `$name` in the file; they win over its defaults.
        required_names: of parameters that the scene must have; others are warned about.
        strict: refuse unknown plugins and properties instead of warning.
        two_sided: make opaque materials the same on the back.
        integrator: the plugin to use in place of the scene's integrator, with the parameters that both have.
        sensor: the number, from zero, or the id of the one to look through.
        runs: read objects that are alike together, which is quicker and means the same.
        known_files: `files` of another description, which are read again only if they have changed.

    Raises:
        SceneError: the scene cannot be read; the message contains the location and the reason.
        UnknownParameter: the scene does not have one that it must have.
    """
    tree, builder, includes = _read(path, parameters, strict, required_names, runs=runs)
    asked: dict[str, Any] = {"two_sided": two_sided, "integrator": integrator, "sensor": sensor}
    description = _describe(tree, replace(builder, known_files=known_files, **asked))
    return replace(description, includes=includes, options={"parameters": dict(parameters), **asked})


@_collector_paused()
def sensor_names(path: SceneFile, *, parameters: Mapping[str, str] = NO_PARAMETERS) -> tuple[str, ...]:
    """The ids of a scene file's sensors, or their numbers where they have none; nothing else is opened.

    Raises:
        SceneError: the scene cannot be read; the message contains the location and the reason.
    """
    tree, *_ = _read(path, parameters, strict=False)
    return cameras.names(tree.root)


@dataclass(frozen=True)
class Export:
    """A scene for Mitsuba 3: the text of its XML file, the files beside it by their names (PLY files as
    bytes, pictures as arrays of linear colours), and what is not written as it was read."""

    text: str
    files: dict[str, bytes | Pixels]
    warnings: list[SceneWarning]


@_collector_paused()
def convert(
    path: SceneFile,
    target: str | os.PathLike[str],
    *,
    parameters: Mapping[str, str] = NO_PARAMETERS,
    strict: bool = False,
    pack: bool = False,
) -> Export:
    """Restates a scene file of any version as one of version 3.0.0; nothing is written.

    Args:
        path: an XML file, or a binary file object to read one from.
        target: where the result will be; names of meshes and textures are relative to it.
        parameters: values for `$name` in the file; they win over its defaults.
        strict: refuse unknown plugins and properties instead of warning.
        pack: put all meshes into files of the result's own.

    Raises:
        SceneError: the scene cannot be read; the message contains the location and the reason.
    """
    from .export.translator import Translator  # the way out, which no render needs
    from .export.write import scene_text

    tree, builder, _ = _read(path, parameters, strict, runs=False)
    builder.kept = {}
    description = _describe(tree, builder)
    builder.diagnostics.strict = False  # what is read is read, and what is lost is no mistake
    target = Path(target)
    stem = target.stem.encode("utf-8", "replace").decode()
    translator = Translator(builder, target.parent, stem, pack)
    with Blame(tree.root.location):
        text = scene_text(translator.scene(tree.root, description.core))
    known = {warning.message for warning in description.warnings}
    new = [warning for warning in builder.diagnostics.warnings if warning.message not in known]
    return Export(text, translator.packed, [*description.warnings, *new])


@_collector_paused()
def describe(
    scene_dict: Mapping[str, Any],
    *,
    base_path: str | os.PathLike[str] | None = None,
    strict: bool = False,
    two_sided: bool = False,
    integrator: str | None = None,
    sensor: str | int | None = None,
) -> Description:
    """Reads a scene from a dict, as Mitsuba 3's `load_dict` does.

    Args:
        scene_dict: `{"type": "scene", ...}`.
        base_path: the folder of files that it names; the working directory by default.
        strict, two_sided, integrator, sensor: as for `load_description`.

    Raises:
        SceneError: the scene cannot be read; the message contains the location and the reason.
    """
    base = Path(base_path) if base_path is not None else Path.cwd()
    builder = Builder(Diagnostics(strict), [base], two_sided, integrator, sensor)
    with Blame(Location(Source("scene", b"", base))), np.errstate(all="ignore"):
        tree = nodes_from_dict(scene_dict, base, builder.table, SUBSTITUTES)
    return _describe(_opened(tree, builder), builder)


def plugins() -> dict[str, dict[str, Any]]:
    """The plugins that scene files know beside the core's, in the form of `_core.schema()`."""
    table = plugins_by_kind()
    result: dict[str, dict[str, Any]] = {}
    for plugin in READER_PLUGINS:
        result.setdefault(plugin.kind, {})[plugin.name] = table[plugin.kind][plugin.name.lower()].described()
    return result


def _read(
    file: SceneFile,
    parameters: Mapping[str, str],
    strict: bool,
    required_names: Container[str] = (),
    *,
    runs: bool = True,
) -> tuple[Tree, Builder, list[Included]]:
    """The nodes of a scene file, a builder with the folders of its files, and what it includes."""
    diagnostics = Diagnostics(strict)
    path, data = _named(file)
    document = expand_file(path, parameters, diagnostics, data=data, required_names=required_names, runs=runs)
    with np.errstate(all="ignore"):
        tree = nodes_from_elements(document.root, diagnostics)
    builder = Builder(diagnostics, document.search_paths)
    tree = _opened(tree, builder)
    return tree, replace(builder, members=partial(_members, tree, builder)), document.includes


def _members(tree: Tree, builder: Builder, node: Node) -> Iterator[Node]:
    """The individual shapes of a run's node, as if there were no run."""
    for index in range(node.count):
        parsed = _parsed(Member(node, index))
        follow(parsed, tree.ids)
        yield next(child for _, child in parsed.root.children("shape"))


def _bsdf(member: Member) -> Node:
    """An individual BSDF of a run; it refers to nothing."""
    return next(child for _, child in _parsed(member).root.children("bsdf"))


def _parsed(member: Member) -> Tree:
    """A tree of one object of a run, whose references are not followed yet."""
    parsed = member_of_run(member.node, member.number)
    upgrade(parsed.nodes, plugins_by_kind(), Diagnostics())  # the run's warnings were reported
    return parsed


def _unused_bsdfs(tree: Tree, builder: Builder) -> Ids:
    """The BSDFs with an id of which nothing was made; they are built when a shape is to have one."""
    made = set(builder.objects.ids.values())
    found = {
        name: node
        for name, node in tree.ids.found.items()
        if name not in made
        and (node.node if isinstance(node, Member) else node).kind == "bsdf"
        and node not in builder.materials_of
    }
    return Ids(found, tree.ids.alone)


def _named(file: SceneFile) -> tuple[Path, bytes | None]:
    """A scene file's path, to which other files are relative, and the content of an open file."""
    if isinstance(file, str | os.PathLike):
        return Path(file), None
    if not hasattr(file, "read"):
        raise TypeError(f"a scene is a file name or a binary file object, not {type(file).__name__}")
    name, data = getattr(file, "name", None), file.read()
    if not isinstance(data, bytes):
        raise TypeError('a scene is read from bytes: open its file with mode "rb"')
    return Path(name if isinstance(name, str) else "scene"), data


def _opened(tree: Tree, builder: Builder) -> Tree:
    """Nodes with the names of Mitsuba 3, resolved references, and all cameras in the scene itself."""
    with Blame(tree.root.location), np.errstate(all="ignore"):  # the core checks for numbers
        upgrade(tree.nodes, builder.table, builder.diagnostics)
        resolve(tree, _bsdf)
        cameras.spread(tree.root, builder.diagnostics)
    return tree


def _describe(tree: Tree, builder: Builder) -> Description:
    with Blame(tree.root.location), np.errstate(all="ignore"):
        core = assemble(builder, tree.root)
    builder.objects.mirrored = tree.root.unsaid.mirrored
    builder.objects.exchanges = tree.root.unsaid.exchanged
    builder.objects.two_sided = builder.two_sided
    builder.objects.terminator = builder.terminator
    builder.objects.spare = _unused_bsdfs(tree, builder)
    return Description(
        core,
        builder.diagnostics.warnings,
        builder.places,
        builder.objects,
        builder.film,
        cameras.names(tree.root),
        builder.views,
        tuple(builder.light_groups),
        builder.files,
        first_sensor=cameras.first_name(tree.root),
    )
