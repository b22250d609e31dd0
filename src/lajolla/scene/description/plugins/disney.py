"""Disney's models: alternative names and units of parameters."""

from __future__ import annotations

from ...schema import Field
from ...syntax.errors import SceneError
from ...syntax.nodes import Node
from ..plugin import Context, Entry, Plugin, Values


def _principled(context: Context, node: Node, values: Values) -> Entry:
    """Converts `specular` to `eta`: reflectance at normal incidence = 0.08 * specular."""
    specular = values.pop("specular", None)
    if specular is not None:
        if "eta" in values:
            raise SceneError(
                f'{node} takes either "eta" or "specular", not both', node.property_location("specular")
            )
        refracts = values.get("spec_trans", 0.0) != 0.0
        reflectance = 0.08 * max(specular, 1e-3 if refracts else 0.0)
        values["eta"] = 2 / (1 - reflectance**0.5) - 1
    return {"type": "principled", **values}


def _indices(node: Node, values: Values) -> None:
    """Replaces the indices of refraction on both sides by `eta`, the relative one."""
    inside, outside = values.pop("int_ior", None), values.pop("ext_ior", None)
    if inside is None and outside is None:
        return
    inside, outside = 1.5 if inside is None else inside, 1.0 if outside is None else outside
    if outside <= 0:
        message = f'"ext_ior" must be above zero, not {outside:g}'
        raise SceneError(message, node.property_location("ext_ior"))
    values.setdefault("eta", inside / outside)


def _disney_glass(context: Context, node: Node, values: Values) -> Entry:
    _indices(node, values)
    return {"type": "disneyglass", **values}


def _disney_bsdf(context: Context, node: Node, values: Values) -> Entry:
    _indices(node, values)
    for other, name in OTHER_NAMES.items():
        value = values.pop(other, None)
        if value is not None:
            values.setdefault(name, value)
    return {"type": "disneybsdf", **values}


SPECULAR = Field(
    "specular", "float", "reflectance at normal incidence over 0.08, instead of eta", 0.5, 0.0, 1.0
)
INDICES = (
    Field("int_ior", "float", "index of refraction inside, instead of eta; number or name", 1.5, 0.0),
    Field("ext_ior", "float", "index of refraction outside, instead of eta; number or name", 1.0, 0.0),
)
OTHER_NAMES = {"spec_trans": "specular_transmission", "spec_tint": "specular_tint"}
SYNONYMS = tuple(
    Field(other, "texture_float", f"the same as {name}", 0.0, 0.0, 1.0) for other, name in OTHER_NAMES.items()
)

PLUGINS = (
    Plugin("bsdf", "principled", "", (SPECULAR,), _principled, model="principled"),
    Plugin("bsdf", "disneyglass", "", INDICES, _disney_glass, model="disneyglass"),
    Plugin("bsdf", "disneybsdf", "", (*INDICES, *SYNONYMS), _disney_bsdf, model="disneybsdf"),
)
