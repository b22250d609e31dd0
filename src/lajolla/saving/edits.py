"""The changes of a scene since it was read, as changes of its files' texts."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lajolla.params import TERMINATOR, Params
from lajolla.params.objects import KINDS as LISTS
from lajolla.params.objects import MATERIAL, SINGLE, Entry, Lists, SceneObject, names_by_entry, place_of
from lajolla.params.values import WITH_OBJECTS
from lajolla.saving.differences import MEDIA, whole_window
from lajolla.saving.file_names import keep_files, plain_name, relative_to
from lajolla.saving.terminators import Terminators, said
from lajolla.saving.texts import ElementText, SourceText, Span, kind_of
from lajolla.saving.values import (
    EXCHANGED,
    PLUGINS,
    NotWritten,
    Values,
    equal,
    exchanged,
    is_plain,
    material_entry,
    plain_text,
)
from lajolla.scene import Description, SceneError
from lajolla.scene.schema import ROBUST, Field
from lajolla.scene.syntax.errors import Location, Source
from lajolla.scene.syntax.nodes import KINDS
from lajolla.scene.versions.upgrade import current_name

OF_VIEW = ("sensor", "film", "rfilter", "sampler")  # what each sensor has of its own
FILES = ("filename", "raw", "gamma", "channel")  # properties that say what a file holds
KIND_IN_FILES = {"adapter": "bsdf", "instance": "shape"}
KEPT = ("lightgroup", TERMINATOR)  # properties that no fields of the core's models replace
PLACES = {"first": 0, "second": 1, "child": 0, "bsdf": 0}  # of bsdfs among those inside of another object
RELATIVE = {"conductor": {"ext_eta": 1.0}, "roughconductor": {"ext_eta": 1.0}}  # eta and k are divided by it


@dataclass
class Changed:
    """An object of the file, of which some fields have other values; it may be there several times."""

    found: SceneObject
    entry: Entry  # with the new values
    places: list[Location]
    names: list[str]


@dataclass
class SceneEdits:
    """Writes changes into the texts of a scene.

    Attributes:
        read, now: the scene as it was read, and as it is.
        folder: where the scene will be.
        stem: of its name.
        whole: names of objects of which all values are written.
    """

    read: Description
    now: Description
    params: Params
    folder: Path
    stem: str
    whole: Collection[str] = ()
    texts: dict[Source, SourceText] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.before = Params(self.read, self.read.places)
        self.names = names_by_entry(self.params.objects)
        self.lists, self.old_lists = Lists(self.now.core), Lists(self.read.core)
        own = self.read.objects
        known = {*own.ids.values(), *own.spare}
        ids = self.now.objects.ids
        self.values = Values(self.lists, self._id_of, f"{plain_name(self.stem)}-files", ids, known)
        self.main = self.read.places["scene"].source
        self.values.exchanges = own.exchanges
        self.terminators = Terminators(self.read, self.before, self.params)

    def written(self) -> bytes:
        """The text of the scene; the files that it needs are in `values.files`.

        Raises:
            SceneError: something cannot be written; the message names the parameter.
        """
        for changed in self.changes():
            try:
                self._write_all(changed)
            except NotWritten as problem:
                paths = ", ".join(f"{changed.found.name}.{name}" for name in changed.names)
                raise SceneError(f"{paths} cannot be saved: {problem.message}", *changed.places[:1]) from None
        self._put_sensor_first()
        self._put_ray_queries()
        for included in self.read.includes:  # what is inside of another one comes before it
            if included.source in self.texts:
                name = self.values.file(".xml", self.texts[included.source].text())
                element = self._text(included.place).element(included.place)
                element.attributes["filename"] = plain_text(name)
        main = self._text(self.read.places["scene"])
        parameters = self.read.options.get("parameters", {})
        main.first += [ET.Element("default", name=n, value=plain_text(v)) for n, v in parameters.items()]
        main.first += [ET.Element("path", value=plain_text(folder)) for folder in self._folders()]
        return main.text()

    def _put_ray_queries(self) -> None:
        """Writes whether no ray passes between neighbouring triangles, which is a property of the scene."""
        now = bool(self.now.core.get("robust", False))
        if now == bool(self.read.core.get("robust", False)):
            return
        new = ET.Element("boolean", name=ROBUST, value=str(now).lower())
        main = self._text(self.read.places["scene"])
        root = main.element(Location(self.main, main.root))
        if any(child.attributes.get("name") == ROBUST for child in root.span.children):
            root.put([new], lambda child: child.attributes.get("name") == ROBUST)
        else:
            main.first.append(new)

    def _folders(self) -> Iterator[str]:
        """The folders of texts that will be in another one, relative to that."""
        for folder in dict.fromkeys(source.directory.resolve() for source in self.texts):
            if folder != self.folder.resolve():
                yield relative_to(folder, self.folder)

    def _text(self, place: Location) -> SourceText:
        source = place.source
        if source not in self.texts:
            text = self.texts[source] = SourceText(source)
            folder = self.folder if source is self.main else self.folder / self.values.folder
            keep_files(text, folder, [self.main, *(included.source for included in self.read.includes)])
        return self.texts[source]

    # --- what differs -------------------------------------------------------------------------------------

    def changes(self) -> Iterator[Changed]:
        """The objects of the file that differ."""
        yield from self._of_views()
        lists = self.old_lists
        same = {
            where for where in (*LISTS, "materials") if self.read.core.get(where) is self.now.core.get(where)
        }
        if "materials" not in same:  # they have properties of the outermost bsdfs and adapters
            same -= {"bsdfs", "adapters"}
        replaced: list[str] = []  # materials that are written as a whole, with their parts
        for name, found in self.before.objects.items():
            after = self.params.objects.get(name)
            if after is None or found.kind in SINGLE or place_of(found.entry)[0] in same:
                continue
            if found.kind == "shape" and self._has_other_models(found):
                replaced.append(f"{name}.bsdf")
            is_part = any(f"{name}.".startswith((f"{path}.", f"{path}_back")) for path in replaced)
            if is_part and found.kind in ("bsdf", "adapter") and found.entry not in self.read.objects.ids:
                continue
            old, new = (
                inside(all_.entry(one.entry), one) for all_, one in ((lists, found), (self.lists, after))
            )
            differing = [f.name for f in found.fields.values() if self._differs(f, old, new, name)]
            differing += self._of_shape(found, old, new)
            if self.terminators.must_be_written(found):
                differing.append(TERMINATOR)
            if differing:
                yield Changed(after, new, self._places(found), differing)

    def _places(self, found: SceneObject) -> list[Location]:
        """Where an object is in the files."""
        if found.owner:  # its entry stands for other objects, too
            return self._place_inside(found)
        place = self.read.places.find(found.entry)
        return [*([place] if place else []), *self.read.places.others.get(found.entry, [])]

    def _place_inside(self, found: SceneObject) -> list[Location]:
        """The place of a bsdf in the object around it, by its name: "ball.bsdf.child"."""
        owner = next(name for name, o in self.before.objects.items() if o.entry == found.owner)
        place = self.read.places.find(found.owner)
        if place is None or place.key or not found.name.startswith(f"{owner}."):
            return []
        parts = found.name.removeprefix(f"{owner}.").split(".")
        span = self._text(place).element(place).span
        if parts[0] == "bsdf" and not any(kind_of(child) in ("bsdf", "ref") for child in span.children):
            return [place]  # of a shape without one
        for part in parts[: len(parts) - len(found.inner)]:
            bsdfs = [child for child in span.children if kind_of(child) == "bsdf"]
            if PLACES.get(part, 0) >= len(bsdfs):
                return []
            span = bsdfs[PLACES.get(part, 0)]
            while span.attributes.get("type") == "twosided":
                sides = [child for child in span.children if kind_of(child) == "bsdf"]
                if not sides:
                    return []
                span = sides[-1 if part == "bsdf_back" else 0]
        return [Location(place.source, span.start)]

    def _has_other_models(self, shape: SceneObject) -> bool:
        """Whether a shape has a material of other models than in the file, which is not there as a whole."""
        name, after = shape.name, self.params.objects[shape.name]
        old, new = (
            all_.entry(one.entry).get("material", -1)
            for all_, one in ((self.old_lists, shape), (self.lists, after))
        )
        if old == new or new < 0 or self.params[f"{name}.bsdf"] != f"{name}.bsdf":
            return False

        def models(params: Params) -> list[tuple[str, str]]:
            paths = (f"{name}.bsdf.", f"{name}.bsdf_back")
            found = ((n, o.model) for n, o in params.objects.items() if f"{n}.".startswith(paths))
            return sorted(found)

        return self.before[f"{name}.bsdf"] != f"{name}.bsdf" or models(self.before) != models(self.params)

    def _of_views(self) -> Iterator[Changed]:
        """Those that belong to a sensor, and the integrator."""
        for name in self.read.sensors or ("",):
            view, shown = self.read.views.get(name), self.now.views.get(name)
            before = self.read.core if view is None else view.entries
            after = self.now.core if shown is None else shown.entries
            if before and after:
                yield from self._of_view(before, after, self.read.places if view is None else view.places)
        yield from self._of_view(self.read.core, self.now.core, self.read.places, ("integrator",))

    def _of_view(
        self,
        before: Mapping[str, Entry],
        after: Mapping[str, Entry],
        places: Mapping[str, Location],
        kinds: tuple[str, ...] = OF_VIEW,
    ) -> Iterator[Changed]:
        for kind in kinds:
            old, new = before[kind], after[kind]
            found = SceneObject(kind, kind, "film" if kind == "film" else new["type"], kind)
            if kind == "sampler":  # all samplers of files are the same
                found = SceneObject(kind, kind, old["type"], kind)
            if kind == "film":
                old, new = whole_window(old), whole_window(new)
            names = [f.name for f in found.fields.values() if self._differs(f, old, new, kind)]
            if kind == "film":
                names = _without_whole_window(names, old, new)
            asked = kind == "integrator" and self.read.options.get("integrator")  # it is not the file's
            if kind not in ("film", "sampler") and (asked or old["type"] != new["type"]):
                names = ["type", *names]
            if kind == "sensor" and self._name("media", old) != self._name("media", new):
                names.append("medium")
            if names:
                yield Changed(found, new, [places[kind]] if kind in places else [], names)

    def _name(self, where: str, entry: Entry) -> str | None:
        return self.names.get(f"{where}[{entry.get('medium', -1)}]")

    def _differs(self, declared: Field, old: Entry, new: Entry, name: str) -> bool:
        """Whether a field of an object differs; one that refers to another object, if that is another."""
        x, y = old.get(declared.name, declared.default), new.get(declared.name, declared.default)
        refers = _refers(declared, x) and _refers(declared, y)
        if x is y or declared.type == "bsdf":  # the object inside is one of its own
            return False
        path = f"{name}.{declared.name}"
        return self.before[path] != self.params[path] if refers else not equal(x, y)

    def _of_shape(self, found: SceneObject, old: Entry, new: Entry) -> list[str]:
        if found.kind != "shape":
            return []
        names = ["bsdf"] if old.get("material") != new.get("material") else []
        names += [side for side in MEDIA if old.get(side, -1) != new.get(side, -1)]
        return [
            name
            for name in names
            if self.before[f"{found.name}.{name}"] != self.params[f"{found.name}.{name}"]
            or (name == "bsdf" and self._has_other_models(found))
        ]

    # --- texts --------------------------------------------------------------------------------------------

    def _write_all(self, changed: Changed) -> None:
        if not changed.places:
            raise NotWritten("it does not come from a scene file")
        for place in changed.places:
            self._write(changed, place)

    def _write(self, changed: Changed, place: Location) -> None:
        changed = self._as_in_file(changed)
        found = changed.found
        if place.key or place.source.data[place.start : place.start + 1] != b"<":
            raise NotWritten("it does not come from a scene file")
        element = self._text(place).element(place)
        for _ in found.inner:
            bsdfs = [child for child in element.span.children if child.tag == "bsdf"]
            if not bsdfs:
                raise NotWritten("the bsdf is declared elsewhere and may be a part of others")
            element = self._text(place).element(Location(place.source, bsdfs[0].start))
        if found.kind == "integrator":  # that of the picture is the first inside of others
            element = self._innermost(element)
        if kind_of(element.span) != KIND_IN_FILES.get(found.kind, found.kind):
            made = self.values.whole(found, changed.entry)
            if TERMINATOR in changed.names:
                made.append(said(self.params[f"{found.name}.{TERMINATOR}"]))
            element.put([made], lambda child: kind_of(child) == found.kind)
        elif found.kind != "film" and (found.name in self.whole or {"type", "mesh"} & {*changed.names}):
            self._write_whole(element, changed)
        else:
            self._write_fields(element, changed)

    def _as_in_file(self, changed: Changed) -> Changed:
        """A change with the colours of a checkerboard that is read as a number in the file's order."""
        before = self.before.objects.get(changed.found.name)
        if before is None or before.entry not in self.read.objects.exchanged:
            return changed
        names = [EXCHANGED.get(name, name) for name in changed.names]
        return replace(changed, entry=exchanged(changed.entry), names=names)

    def _innermost(self, element: ElementText) -> ElementText:
        while inner := [child for child in element.span.children if child.tag == "integrator"]:
            place = Location(element.source, inner[0].start)
            element = self._text(place).element(place)
        return element

    def _write_fields(self, element: ElementText, changed: Changed) -> None:
        """Writes the values that differ, and keeps the others."""
        found, names = changed.found, list(changed.names)
        meant = {self._meaning(child, element, found) for child in element.span.children}
        if "fov" in names and "fov" not in meant:  # the axis is that of the focal length
            names.append("fov_axis")
        both = {"alpha_u", "alpha_v"} <= {*names}
        for name in dict.fromkeys(names):
            others = {"fov": ("focal_length",), "alpha_u": ("alpha", "roughness") if both else ()}.get(
                name, ()
            )
            self._put(element, changed, name, (name, *others))

    def _put(self, element: ElementText, changed: Changed, name: str, instead: tuple[str, ...]) -> None:
        found, entry = changed.found, changed.entry
        if name == TERMINATOR:
            self.terminators.put(self._text(Location(element.source, element.span.start)), element, found)
            return
        if name in MEDIA:
            self._put_medium(element, entry.get(name, -1), name)
            return
        if name == "bsdf":
            material = self.lists.entry(f"materials[{entry['material']}]")
            is_new = self.params[f"{found.name}.bsdf"] not in self.before.objects
            if is_new or self._has_other_models(found):
                new = self.values.sides(material)
            else:
                new = self.values.reference("bsdf", material_entry(material["front"]), "")
            self._put_bsdf(element, name, new)
            return
        declared = found.fields[name]
        written = self.values.field(found, declared, entry)
        if declared.type == MATERIAL:
            self._put_bsdf(element, name, *written)
        else:
            if declared.type in ("image", "grid"):
                instead = FILES
            element.put(written, lambda child: self._meaning(child, element, found) in instead)

    def _put_medium(self, element: ElementText, index: int, name: str) -> None:
        new = [self.values.reference("medium", f"media[{index}]", name)] if index >= 0 else []
        alone = name == "medium"
        element.put(
            new,
            lambda child: child.tag == "medium" if alone else child.attributes.get("name") == name,
        )

    def _put_bsdf(self, element: ElementText, name: str, new: ET.Element) -> None:
        """Puts a bsdf in the place of one inside of an object."""
        ids = {
            identity
            for entry, identity in self.read.objects.ids.items()
            if entry.startswith(("bsdfs", "adapters"))
        }
        old = [
            c
            for c in element.span.children
            if c.tag == "bsdf" or (c.tag == "ref" and c.attributes.get("id") in ids)
        ]
        chosen = old[PLACES[name] : PLACES[name] + 1]
        element.put([new], lambda child: child in chosen)

    def _write_whole(self, element: ElementText, changed: Changed) -> None:
        """Writes all values of an object, with the name that its model has."""
        found, entry = changed.found, changed.entry
        lights = self._lights_at(element) if found.kind == "emitter" else []
        if len(lights) > 1:
            element.instead = [self.values.whole(light, self.lists.entry(light.entry)) for light in lights]
            if "id" in element.span.attributes:
                element.instead[0].set("id", element.span.attributes["id"])
            return
        element.attributes["type"] = PLUGINS.get((found.kind, found.model), found.model)
        for child in element.span.children:
            named = self._meaning(child, element, found)
            is_value = kind_of(child) not in (*KINDS, "ref")
            if (is_value or named in changed.names) and named not in KEPT:
                element.replaced[child.start] = []
        for declared in found.fields.values():
            value = entry.get(declared.name, declared.default)
            kept = _refers(declared, value) and declared.name not in changed.names
            if not kept and declared.type not in ("bsdf", MATERIAL) and not is_plain(declared, value):
                element.added += self.values.field(found, declared, entry)
        for name, number in RELATIVE.get(found.model, {}).items():
            element.added.append(ET.Element("float", name=name, value=repr(number)))
        for name in {"bsdf", TERMINATOR, *MEDIA} & {*changed.names}:
            self._put(element, changed, name, (name,))

    def _lights_at(self, element: ElementText) -> list[SceneObject]:
        """The lights that come from one element, such as the sun and the sky."""
        place = Location(element.source, element.span.start)
        return [
            self.params.objects[name]
            for name, found in self.before.objects.items()
            if found.kind == "emitter" and self.read.places.find(found.entry) == place
        ]

    @staticmethod
    def _meaning(child: Span, element: ElementText, found: SceneObject) -> str:
        """The name of a property, as today's files have it."""
        plugin = element.span.attributes.get("type", "")
        return current_name(found.kind, plugin, child.attributes.get("name", ""))

    def _id_of(self, kind: str, entry: str) -> str | None:
        """The id of an object of the file, which gets one if it has none."""
        found = self.before.objects.get(self.names.get(entry, ""))
        place = None if found is None else next(iter(self._places(found)), None)
        if found is None or place is None or place.source.data[place.start : place.start + 1] != b"<":
            return None
        known = self.read.objects.ids.get(found.entry)
        if known is not None:
            return known
        element = self._text(place).element(place)
        if kind_of(element.span) != kind:
            return None
        if "id" not in element.attributes:
            taken = {*self.read.objects.ids.values()}
            element.attributes["id"] = free_name(found.name.replace(".", "-"), lambda name: name in taken)
        return element.attributes["id"]

    def _put_sensor_first(self) -> None:
        """Makes the sensor that is used the one that the file's version takes."""
        shown = next((name for name in self.read.sensors if name not in self.now.views), "")
        if shown == self.read.first_sensor or not shown:
            return
        places = self.read.views[shown].places if shown in self.read.views else self.read.places
        place = places.get("sensor")
        if place is None or place.source is not self.main:
            raise SceneError(
                f'the sensor "{shown}" cannot be saved as the first: it is in another file', place
            )
        text = self._text(place)
        text.moved = text.element(place).span, self.read.first_sensor == self.read.sensors[0]


def inside(entry: Entry, found: SceneObject) -> Entry:
    """The part of an entry that is an object."""
    result: Any = entry
    for name in found.inner:
        result = result[name]
    return result


def _refers(declared: Field, value: object) -> bool:
    """Whether the value of a field is another object."""
    return declared.type in (MATERIAL, "phase") or (
        declared.type in WITH_OBJECTS and isinstance(value, Mapping)
    )


def free_name(wanted: str, is_taken: Callable[[str], bool]) -> str:
    """A name that is not taken."""
    while is_taken(wanted):
        wanted += "-"
    return wanted


def _without_whole_window(names: list[str], old: Entry, new: Entry) -> list[str]:
    """The names without those of a window that is and was the whole film."""

    def is_whole(film: Entry) -> bool:
        return (film["crop_width"], film["crop_height"]) == (film["width"], film["height"])

    return (
        [name for name in names if not name.startswith("crop_")] if is_whole(old) and is_whole(new) else names
    )
