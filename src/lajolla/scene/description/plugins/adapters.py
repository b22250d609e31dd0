"""Adapters: bsdfs that contain bsdfs. They become the tree of a material slot."""

from __future__ import annotations

from collections.abc import Callable

from ...schema import Field
from ...syntax.errors import SceneError
from ...syntax.literals import Text, parse_floats
from ...syntax.nodes import Node
from ..plugin import BLACK, AdapterId, Context, MaterialId, Plugin, Slot, Values


def _inner(context: Context, node: Node, most: int, needed: str) -> list[Slot]:
    """The slots of the bsdfs inside an adapter, up to a maximum number."""
    slots = [slot for _, child in node.children("bsdf") if (slot := context.slot(child)) is not None]
    if not slots:
        raise SceneError(f"{node} needs {needed} inside", node.location)
    if len(slots) > most:
        first = "the first one is used" if most == 1 else f"the first {most} are used"
        context.diagnostics.warn(f"{node} has {len(slots)} bsdfs inside; {first}", node.location)
    return slots[:most]


def _two_sided(context: Context, node: Node, values: Values) -> Slot:
    slots = _inner(context, node, 2, "one or two bsdfs")
    front, back = slots[0], slots[-1]
    if any(context.lets_light_through(slot.front) for slot in slots):
        context.diagnostics.warn(
            f"{node} cannot contain a transmissive bsdf, which is used alone", node.location
        )
        return front
    return Slot(front.front, back.front)


def _mask(context: Context, node: Node, values: Values) -> Slot:
    inner = _inner(context, node, 1, "a bsdf")[0]
    if values.setdefault("opacity", 0.5) == 1:
        return inner
    return _around(context, node, "mask", values, inner)


def _filter(passing: float) -> Callable[[Context, Node, Values], Slot]:
    """Polarising plates, which transmit this fraction of unpolarised light."""

    def build(context: Context, node: Node, values: Values) -> Slot:
        clear, share = values.get("transmittance", (1.0, 1.0, 1.0)), 1.0
        if isinstance(clear, dict):
            share = passing
        else:
            clear = tuple(passing * c for c in clear)
        sheet = {"type": "thindielectric", "int_ior": 1.0, "ext_ior": 1.0, "specular_transmittance": clear}
        plate: MaterialId = context.add_once("bsdfs", sheet, node)
        if share < 1:
            plate = context.adapt(node, "blendbsdf", {"weight": share}, first=BLACK, second=plate)
        return Slot(plate)

    return build


def _around(context: Context, node: Node, name: str, values: Values, inner: Slot) -> Slot:
    """A slot with an adapter on both sides."""
    front = context.adapt(node, name, values, child=inner.front)
    back = BLACK if inner.back == BLACK else context.adapt(node, name, values, child=inner.back)
    return Slot(front, back)


def _map(context: Context, node: Node, name: str, texture: str, values: Values) -> Slot:
    """A bump or normal map: its texture has any name, or none."""
    inner = _inner(context, node, 1, "a bsdf")[0]
    textures = [prop for prop, child in node.children("texture") if context.texture(child) is not None]
    if not textures and texture not in values:
        context.diagnostics.warn(f"{node} has no texture inside and changes nothing", node.location)
        return inner
    if len(textures) > 1:
        context.diagnostics.warn(f"{node} has more than one texture; the first one is used", node.location)
    if textures:
        field = next(f for f in context.declared("bsdf", name) if f.name == texture)
        values[texture] = context.convert(node, textures[0], field)
    front = context.adapt(node, name, values, child=inner.front)
    if inner.back == BLACK:
        return Slot(front)
    # A bump on the front is a dent on the back.
    mirrored = values | {"scale": -values.get("scale", 1.0)}
    return Slot(front, context.adapt(node, name, mirrored, child=inner.back))


def _bump_map(context: Context, node: Node, values: Values) -> Slot:
    return _map(context, node, "bumpmap", "map", values)


def _normal_map(context: Context, node: Node, values: Values) -> Slot:
    return _map(context, node, "normalmap", "normalmap", values)


def _blend(context: Context, node: Node, values: Values) -> Slot:
    slots = _inner(context, node, 2, "two bsdfs")
    if len(slots) < 2:
        raise SceneError(f"{node} needs two bsdfs inside", node.location)
    return _mixed(context, node, values, *slots)


def _mixture(context: Context, node: Node, values: Values) -> Slot:
    """`mixturebsdf`: the remaining weight is black."""
    slots = _inner(context, node, len(node.properties), "bsdfs")
    text = Text(values.get("weights", ""), node.property_location("weights"))
    weights = parse_floats(text, (len(text.text.replace(",", " ").split()),)) if text.text.strip() else ()
    if len(weights) != len(slots):
        message = f"{node} has {len(slots)} bsdfs inside and {len(weights)} weights"
        raise SceneError(message, node.property_location("weights"))
    total = sum(weights)
    if min(weights) < 0 or not 0 < total < float("inf"):
        raise SceneError("weights must be positive, not all zero", node.property_location("weights"))
    if total > 1 + 1e-4:
        context.diagnostics.warn(
            f"the weights of {node} sum to {total:g} and are scaled to 1", node.property_location("weights")
        )
    shares = [*zip(weights, slots, strict=True), (max(1 - total, 0.0), Slot(BLACK))]
    rest, mixed = shares.pop()
    while shares:
        share, slot = shares.pop()
        rest += share
        if rest > 0 and share < rest:
            mixed = _mixed(context, node, {"weight": 1 - share / rest}, slot, mixed)
        elif share > 0:
            mixed = slot
    return mixed


def _mixed(context: Context, node: Node, values: Values, first: Slot, second: Slot) -> Slot:
    front = context.adapt(node, "blendbsdf", values, first=first.front, second=second.front)
    if first.back == second.back == BLACK:
        return Slot(front)
    backs = (_seen_from_behind(context, slot) for slot in (first, second))
    return Slot(front, context.adapt(node, "blendbsdf", values, first=next(backs), second=next(backs)))


def _seen_from_behind(context: Context, slot: Slot) -> MaterialId:
    """Transmissive bsdfs are visible from both sides."""
    return slot.front if slot.back == BLACK and context.lets_light_through(slot.front) else slot.back


def _coating(context: Context, node: Node, values: Values) -> Slot:
    """Adds a coating to every bsdf inside blends, masks and maps."""
    inner = _inner(context, node, 1, "a bsdf")[0]
    clear = context.lets_light_through(inner.front) or context.lets_light_through(inner.back)
    if clear:
        message = f"{node} cannot contain a transmissive bsdf, which remains uncoated"
        context.diagnostics.warn(message, node.location)
    made: dict[MaterialId, MaterialId] = {}
    front, back = (_coated(context, node, values, side, made) for side in (inner.front, inner.back))
    return Slot(front, back)


def _rough_coating(context: Context, node: Node, values: Values) -> Slot:
    return _coating(context, node, {"alpha": 0.1, **values})


def _coated(
    context: Context,
    node: Node,
    values: Values,
    material: MaterialId,
    made: dict[MaterialId, MaterialId],
) -> MaterialId:
    if material in made or material == BLACK:
        return made.get(material, BLACK)
    if isinstance(material, AdapterId):
        entry = dict(context.entry("adapters", material.index))
        children = {name: entry.pop(name) for name in CHILDREN if name in entry}
        coated = {
            name: _coated(
                context,
                node,
                values,
                AdapterId(child["adapter"]) if isinstance(child, dict) else child,
                made,
            )
            for name, child in children.items()
        }
        made[material] = context.adapt(node, entry.pop("type"), entry, **coated)
        return made[material]
    base = context.entry("bsdfs", material)
    if context.lets_light_through(material):
        return material
    if base["type"] == "coating":
        context.diagnostics.warn(f"{node} around another coating is ignored", node.location)
        return material
    made[material] = context.add_once("bsdfs", {"type": "coating", "base": base, **values}, node)
    return made[material]


CLEAR = Field("transmittance", "texture_spectrum", "fraction of light that is not absorbed", 1.0, 0.0, 1.0)
THETA = Field("theta", "texture_float", "angle of the axis; ignored without polarisation", 0.0)
HALF = "A {} polariser: half of the light passes."
RETARDANCE = Field("delta", "texture_float", "retardance; ignored", 90.0, unit="degrees")
POLARIZING = Field("polarizing", "boolean", "ignored", True)
LEFT_HANDED = Field("left_handed", "boolean", "ignored", False)
WEIGHTS = Field("weights", "string", "one share per bsdf inside; what they leave over is black")
CHILD = ("child",)
CHILDREN = ("first", "second", "child")

PLUGINS = (
    Plugin("bsdf", "twosided", "The same, or another, bsdf on the back.", (), _two_sided, ("bsdf",)),
    Plugin("bsdf", "mask", "", (), _mask, ("bsdf",), "mask", CHILD),
    Plugin("bsdf", "bumpmap", "", (), _bump_map, ("bsdf", "texture"), "bumpmap", CHILD),
    Plugin("bsdf", "normalmap", "", (), _normal_map, ("bsdf", "texture"), "normalmap", (*CHILD, "scale")),
    Plugin("bsdf", "blendbsdf", "", (), _blend, ("bsdf",), "blendbsdf", ("first", "second")),
    Plugin("bsdf", "coating", "", (), _coating, ("bsdf",), "coating", ("base", "alpha", "distribution")),
    Plugin(
        "bsdf",
        "roughcoating",
        "A layer of dull varnish, clear or tinted, on another BSDF.",
        (Field("alpha", "float", "roughness of the layer", 0.1, 0.0),),
        _rough_coating,
        ("bsdf",),
        "coating",
        ("base",),
    ),
    Plugin("bsdf", "polarizer", HALF.format("linear"), (CLEAR, THETA, POLARIZING), _filter(0.5)),
    Plugin("bsdf", "circular", HALF.format("circular"), (CLEAR, LEFT_HANDED), _filter(0.5)),
    Plugin("bsdf", "retarder", "A retarder plate: clear.", (CLEAR, THETA, RETARDANCE), _filter(1.0)),
    Plugin("bsdf", "mixturebsdf", "A mixture of bsdfs.", (WEIGHTS,), _mixture, ("bsdf",)),
)
