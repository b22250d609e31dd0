"""Changes of `terminator` by parameters, and scenes that are saved with them."""

from __future__ import annotations

from pathlib import Path

import pytest
from test_terminator import loaded, said, terminators

import lajolla

GREY = '<bsdf type="diffuse" id="grey"/>'
RED = f'<bsdf type="diffuse" id="red">{said("hanika")}</bsdf>'
BLEND = """<bsdf type="blendbsdf" id="mix"><float name="weight" value="0.5"/><ref id="red"/>
<bsdf type="plastic"/></bsdf>"""


def sphere(name: str, bsdf: str) -> str:
    return f'<shape type="sphere" id="{name}">{bsdf}</shape>'


def of_shapes(scene: lajolla.Scene) -> dict[str, str]:
    """What the material of each shape does."""
    slots = terminators(scene.description)
    shapes = scene.description.core["shapes"]
    names = (name for name, found in scene.params.objects.items() if found.kind == "shape")
    return {name: slots[shape["material"]] for name, shape in zip(names, shapes, strict=True)}


def check_saved(scene: lajolla.Scene, expected: dict[str, str], tmp_path: Path) -> None:
    """The changed scene, and what its file says."""
    assert of_shapes(scene) == expected
    scene.save(tmp_path / "saved.xml")
    assert of_shapes(lajolla.load(tmp_path / "saved.xml")) == expected


@pytest.mark.parametrize(
    "user",
    [
        BLEND + sphere("b", '<ref id="mix"/>'),
        GREY + sphere("b", '<bsdf type="twosided"><ref id="grey"/><ref id="red"/></bsdf>'),
    ],
)
def test_a_bsdf_that_is_assigned_by_name_keeps_its_own(user: str, tmp_path: Path) -> None:
    scene = loaded(RED + user + sphere("a", '<bsdf type="plastic"/>'), tmp_path)
    scene["a.bsdf"] = "red"
    assert scene.params["red.terminator"] == "hanika"
    check_saved(scene, {"b": "hanika", "a": "hanika"}, tmp_path)
    scene["red.terminator"] = "none"
    check_saved(scene, {"b": "hanika", "a": "none"}, tmp_path)


def test_a_part_of_a_new_bsdf_is_as_in_dicts(tmp_path: Path) -> None:
    scene = loaded(sphere("a", "") + sphere("b", ""), tmp_path)
    scene["a.bsdf"] = {
        "type": "blendbsdf",
        "weight": 0.5,
        "first": {"type": "diffuse", "id": "chalk"},
        "second": {"type": "plastic"},
    }
    scene["b.bsdf"] = "chalk"
    assert of_shapes(scene) == {"a": "hanika", "b": "hanika"}


def test_writing_what_was_read_changes_nothing(tmp_path: Path) -> None:
    """A twosided that says something else than the bsdf inside it keeps that."""
    around = f'<bsdf type="twosided">{said("hanika")}<ref id="grey"/></bsdf>'
    scene = loaded(GREY + sphere("a", '<ref id="grey"/>') + sphere("b", around), tmp_path)
    for path in [path for path in scene.params if path.endswith("terminator")]:
        scene[path] = scene.params[path]
    check_saved(scene, {"a": "none", "b": "hanika"}, tmp_path)
    scene["grey.terminator"] = "chiang"
    check_saved(scene, {"a": "chiang", "b": "hanika"}, tmp_path)


@pytest.mark.parametrize("mode", ["chiang", "none"])
def test_saving_where_the_back_says_another(mode: str, tmp_path: Path) -> None:
    blue = f'<bsdf type="plastic" id="blue">{said("hanika")}</bsdf>'
    sides = '<bsdf type="twosided"><ref id="grey"/><ref id="blue"/></bsdf>'
    scene = loaded(GREY + blue + sphere("a", sides), tmp_path)
    scene["grey.terminator"] = mode
    check_saved(scene, {"a": mode}, tmp_path)


def test_saving_where_only_the_back_changes(tmp_path: Path) -> None:
    sides = '<bsdf type="twosided"><ref id="grey"/><ref id="red"/></bsdf>'
    scene = loaded(GREY + RED + sphere("a", sides) + sphere("b", '<ref id="red"/>'), tmp_path)
    scene["red.terminator"] = "none"
    check_saved(scene, {"a": "hanika", "b": "none"}, tmp_path)


def test_saving_where_a_blend_inherits(tmp_path: Path) -> None:
    scene = loaded(RED + BLEND + sphere("a", '<ref id="red"/>') + sphere("b", '<ref id="mix"/>'), tmp_path)
    scene["red.terminator"] = "none"
    check_saved(scene, {"a": "none", "b": "hanika"}, tmp_path)


def test_saving_shapes_without_a_bsdf(tmp_path: Path) -> None:
    scene = loaded(sphere("a", ""), tmp_path)
    scene["a.bsdf.terminator"] = "hanika"
    check_saved(scene, {"a": "hanika"}, tmp_path)
    scene = loaded(sphere("a", "") + sphere("b", ""), tmp_path)
    scene["b.bsdf.terminator"] = "chiang"
    scene["b.bsdf.reflectance"] = 0.25
    check_saved(scene, {"a": "none", "b": "chiang"}, tmp_path)
    saved = lajolla.load(tmp_path / "saved.xml")
    assert saved.params["b.bsdf.reflectance"].max() == 0.25


def test_messages_name_the_bsdf(tmp_path: Path) -> None:
    scene = loaded(GREY + sphere("a", '<ref id="grey"/>'), tmp_path)
    with pytest.raises(lajolla.SceneError, match='"terminator" of bsdf "diffuse" expects a string'):
        scene["grey.terminator"] = 1
