"""The declarations that everything else is generated from, and what descriptions that break them are told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lajolla import _core

SCHEMA = _core.schema()
TYPES = {
    "float", "integer", "boolean", "choice", "string", "spectrum", "vector", "transform",
    "texture_float", "texture_spectrum", "material", "bsdf", "mesh", "curves", "image", "face_images",
    "volume_float", "volume_spectrum", "volume_matrix", "grid", "phase", "floats", "measurement",
}  # fmt: skip
KINDS = {
    "bsdf", "adapter", "texture", "emitter", "shape", "sensor", "film", "rfilter", "sampler", "integrator",
    "medium", "phase", "volume", "instance", "material",
}  # fmt: skip
MODELS = [(kind, name) for kind, models in SCHEMA.items() for name in models]
FIELDS = [
    pytest.param(field, id=f"{kind}-{name}-{field['name']}")
    for kind, name in MODELS
    for field in SCHEMA[kind][name]["fields"]
]


def numbers_of(value: object) -> np.ndarray:
    return np.ravel(np.asarray(value, float))


def test_kinds_are_known() -> None:
    assert set(SCHEMA) <= KINDS and "bsdf" in SCHEMA
    assert all(SCHEMA.values())


@pytest.mark.parametrize("kind, name", MODELS)
def test_models_are_described(kind: str, name: str) -> None:
    model = SCHEMA[kind][name]
    assert set(model) == {"doc", "fields"}
    assert model["doc"] and model["doc"][-1] == "."
    names = [field["name"] for field in model["fields"]]
    assert len(set(names)) == len(names) and "type" not in names


@pytest.mark.parametrize("field", FIELDS)
def test_fields_are_described(field: dict) -> None:
    assert set(field) == {"name", "type", "default", "minimum", "maximum", "unit", "choices", "doc"}
    assert field["type"] in TYPES
    assert field["doc"] and "\n" not in field["doc"]
    assert (field["choices"] is not None) == (field["type"] == "choice")


@pytest.mark.parametrize("field", FIELDS)
def test_defaults_are_within_their_range(field: dict) -> None:
    if field["type"] == "choice":
        assert field["default"] in field["choices"]
        return
    if field["type"] in ("string", "bsdf", "mesh", "curves", "image", "face_images", "grid", "measurement"):
        assert field["minimum"] is None and field["maximum"] is None
        return
    numbers = numbers_of(field["default"])
    assert np.isfinite(numbers).all()
    low = -math.inf if field["minimum"] is None else field["minimum"]
    high = math.inf if field["maximum"] is None else field["maximum"]
    assert low < high and (numbers >= low).all() and (numbers <= high).all()


@pytest.mark.parametrize("name", SCHEMA["bsdf"])
def test_defaults_describe_the_default(name: str) -> None:
    """A model whose fields are all given their defaults is the model without fields."""
    fields = {field["name"]: field["default"] for field in SCHEMA["bsdf"][name]["fields"]}
    wo, u = np.array([[0.6, 0, 0.8]], np.float32), np.full((1, 3), 0.3, np.float32)
    plain = _core.Bsdf({"type": name}).sample_many(wo, u)
    spelled = _core.Bsdf({"type": name, **fields}).sample_many(wo, u)
    for key, value in plain.items():
        np.testing.assert_array_equal(spelled[key], value)


ERRORS = [
    ({}, r'bsdf: "type" is missing \(known: diffuse, .*\)'),
    ({"type": 3}, r"bsdf.type: expected a string, got 3"),
    ({"type": "difuse"}, r"bsdf: unknown type 'difuse' \(known: diffuse, .*\)"),
    (
        {"type": "diffuse", "reflektance": 1},
        r"bsdf \(diffuse\): unknown field 'reflektance' \(known: reflectance\)",
    ),
    ({"type": "diffuse", 3: 1}, r"bsdf \(diffuse\): unknown field '3'"),
    (
        {"type": "diffuse", "reflectance": "x"},
        r"bsdf \(diffuse\).reflectance: expected .*, a number or three numbers in \[0, 1\], got 'x'",
    ),
    (
        {"type": "roughplastic", "distribution": "phong"},
        r"distribution: expected one of 'beckmann', 'ggx', got 'phong'",
    ),
    ({"type": "roughplastic", "nonlinear": 1}, r"nonlinear: expected True or False, got 1"),
    ({"type": "dielectric", "int_ior": -1}, r"bsdf \(dielectric\).int_ior: expected a number .*, got -1"),
    ({"type": "dielectric", "int_ior": None}, r"int_ior: expected a number .*, got None"),
]


@pytest.mark.parametrize("description, message", ERRORS)
def test_errors_name_the_place_and_what_is_expected(description: dict, message: str) -> None:
    with pytest.raises(_core.DescriptionError, match=message):
        _core.Bsdf(description)


@pytest.mark.parametrize(
    "value",
    [
        1.5, -0.1, math.nan, math.inf, 1e300, 10**400, True, "0.5", None, [], [1, 2], [1, 2, 3, 4],
        [0.1, 0.2, "x"], [0.1, 0.2, math.nan], {"texture": -1}, {"texture": 2**31}, {"texture": 0.5},
        {"texture": 0, "a": 1}, {}, object(),
    ],
    ids=lambda v: repr(v)[:20],
)  # fmt: skip
def test_values_that_are_no_reflectance_are_refused(value: object) -> None:
    with pytest.raises(_core.DescriptionError, match="reflectance: expected"):
        _core.Bsdf({"type": "diffuse", "reflectance": value})


@pytest.mark.parametrize(
    "value",
    [1, 0.25, np.float32(0.25), [0.1, 0.2, 0.3], (0, 1, 0), np.array([0.1, 0.2, 0.3], np.float32)],
    ids=repr,
)
def test_values_of_many_python_types_are_reflectances(value: object) -> None:
    wo = np.array([[0, 0, 1]], np.float32)
    f_cos, _ = _core.Bsdf({"type": "diffuse", "reflectance": value}).eval_many(wo, wo)
    np.testing.assert_allclose(f_cos[0] * np.pi, np.broadcast_to(value, 3), rtol=1e-6)


def test_textures_need_a_scene() -> None:
    with pytest.raises(_core.DescriptionError, match="constants"):
        _core.Bsdf({"type": "diffuse", "reflectance": {"texture": 0}})


def test_errors_are_value_errors() -> None:
    assert issubclass(_core.DescriptionError, ValueError)
