"""Every texture of the list at known points, nested textures, and filtering over footprints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_tools import error_of, messages, read
from scene_tools import (
    PINHOLE,
    Settings,
    area,
    front_view,
    look_at,
    make_scene,
    picture,
    rotation,
    scaling,
    uv_sphere,
)

from lajolla import _core, load_dict
from lajolla import image as image_file
from lajolla.scene import SceneError

SIZE = 32
COORDINATES = (np.arange(SIZE) + 0.5) / SIZE
V, U = np.meshgrid(COORDINATES[::-1], COORDINATES, indexing="ij")  # u to the right, v upwards

NOISE = np.random.default_rng(5).random((64, 64, 3), np.float32)
TESTED = {"bitmap", "checkerboard", "gridtexture", "scale", "clamped", "mesh_attribute"}
TESTED |= {"wireframe", "curvature"}


def shown(textures: list[Settings], shape: Settings | None = None, width: float = 2) -> np.ndarray:
    """The last of the textures on a rectangle that fills the picture."""
    scene = make_scene(
        shapes=[{"type": "rectangle", "emitter": 0, **(shape or {})}],
        emitters=[area({"texture": len(textures) - 1})],
        textures=textures,
        sensor=front_view(3, width),
        size=(SIZE, SIZE),
        rfilter=PINHOLE,
        max_depth=1,
    )
    return picture(scene, 1)


def test_every_texture_is_tested() -> None:
    assert set(_core.schema()["texture"]) == TESTED | {"ptex"}  # test_ptex


def test_checkerboard() -> None:
    image = shown([{"type": "checkerboard", "color0": [1, 2, 3], "color1": 0, "to_uv": scaling(2)}])
    even = ((2 * U) % 1 > 0.5) == ((2 * V) % 1 > 0.5)
    np.testing.assert_allclose(image, even[..., None] * [1, 2, 3])


def test_grid() -> None:
    grid = {"type": "gridtexture", "color0": 2, "color1": 3, "line_width": 0.1, "to_uv": scaling(2, 3)}
    u, v = 2 * U, 3 * V
    line = np.minimum(np.abs(u - np.round(u)), np.abs(v - np.round(v))) < 0.1
    np.testing.assert_allclose(shown([grid])[..., 0], np.where(line, 3, 2))


def test_scale_multiplies_textures_and_colours() -> None:
    noise = {"type": "bitmap", "image": _core.Image(NOISE)}
    board = {"type": "checkerboard", "color0": 0.5, "color1": {"texture": 0}}
    nested = {"type": "scale", "texture": {"texture": 1}, "scale": [2, 1, 0]}
    both = {"type": "scale", "texture": {"texture": 2}, "scale": {"texture": 0}}
    image, factor = shown([noise]), np.array([2, 1, 0])
    even = (U % 1 > 0.5) == (V % 1 > 0.5)
    expected = np.where(even[..., None], 0.5, image) * factor * image
    np.testing.assert_allclose(shown([noise, board, nested, both]), expected, rtol=1e-5)


def test_clamped() -> None:
    pixels = NOISE[:SIZE, :SIZE] * 6 - 3
    pixels[::3, ::3] = np.nan
    bitmap = {"type": "bitmap", "image": _core.Image(pixels), "filter_type": "nearest"}
    clamped = {"type": "clamped", "texture": {"texture": 0}, "low": 0.25, "high": 2}
    expected = np.clip(np.nan_to_num(pixels, nan=-3), 0.25, 2)[::-1]  # v = 0 is the top row
    np.testing.assert_allclose(shown([bitmap, clamped]), expected, rtol=1e-6)
    with pytest.raises(_core.DescriptionError, match='"low" must not be above "high"'):
        make_scene(textures=[{"type": "clamped", "low": 2}])


BOARD = '<texture type="checkerboard" name="{}"><rgb name="color0" value="{}"/></texture>'
FIVE = '<texture type="scale" name="reflectance"><float name="scale" value="{}"/>{}</texture>'
GREY = '<rgb name="value" value=".5,.5,.5"/>'
PICTURE = '<texture type="bitmap" name="{}"><string name="filename" value="a.exr"/>{}</texture>'
DIFFUSE = '<shape type="sphere"><bsdf type="diffuse">{}</bsdf></shape><emitter type="constant"/>'
GLOWING = '<shape type="sphere"><emitter type="area">{}</emitter></shape>'

OUT_OF_RANGE = {
    "scaled": (DIFFUSE.format(FIVE.format(5, GREY)), '"reflectance" of bsdf "diffuse" is above 1'),
    "negative scale": (
        DIFFUSE.format(FIVE.format(-5, BOARD.format("", ".4,.4,.4"))),
        '"reflectance" of bsdf "diffuse" is below 0',
    ),
    "board": (
        DIFFUSE.format(BOARD.format("reflectance", "3,3,3")),
        '"reflectance" of bsdf "diffuse" is above 1',
    ),
    "image": (
        DIFFUSE.format(PICTURE.format("reflectance", "")),
        '"reflectance" of bsdf "diffuse" is below 0 and above 1',
    ),
    "emitter": (GLOWING.format(PICTURE.format("radiance", "")), '"radiance" of emitter "area" is below 0'),
}


@pytest.mark.parametrize("name", OUT_OF_RANGE)
def test_textures_out_of_range_are_clamped(name: str, tmp_path: Path) -> None:
    body, expected = OUT_OF_RANGE[name]
    image_file.write(tmp_path / "a.exr", np.float32([[[3, 3, 3], [-1, 0.5, 3]]]))
    description = read(tmp_path, body)
    (message,) = messages(description, tmp_path)
    assert message.endswith(f": warning: {expected} somewhere and clamped")
    image = picture(_core.Scene(description.core | {"film": {"width": 16, "height": 16}}), 16)
    assert (image >= 0).all() and (name == "emitter" or image.max() < 1.001)


@pytest.mark.parametrize("wrap_mode, wraps", [("repeat", 0), ("zero", 0), ("one", 1)])
def test_textures_within_range_stay_as_they_are(wrap_mode: str, wraps: int, tmp_path: Path) -> None:
    """What lies around a picture counts; so does what is not known, without a word."""
    image_file.write(tmp_path / "a.exr", np.full((2, 2, 3), 0.5, np.float32))
    wrap = f'<string name="wrap_mode" value="{wrap_mode}"/>'
    body = DIFFUSE.format(FIVE.format(1.5, PICTURE.format("", wrap)))
    description = read(tmp_path, body)
    assert [t["type"] for t in description.core["textures"]] == ["bitmap", "scale"] + wraps * ["clamped"]
    assert len(messages(description, tmp_path)) == wraps
    unknown = DIFFUSE.format('<texture type="mesh_attribute" name="reflectance"/>')  # all defaults
    description = read(tmp_path, unknown)
    assert [t["type"] for t in description.core["textures"]] == ["mesh_attribute", "clamped"]
    assert not any("clamped" in message for message in messages(description, tmp_path))


def test_wireframe() -> None:
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    mesh = _core.Mesh(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.uint32))
    wires = {"type": "wireframe", "interior_color": [0, 1, 1], "edge_color": [1, 0, 1]}
    x, y = 2 * U - 1, 2 * V - 1
    distance = np.minimum(np.minimum(1 - np.abs(x), 1 - np.abs(y)), np.abs(x - y) / np.sqrt(2))
    automatic = 0.1 * (4 + 2 * np.sqrt(2)) / 3
    for settings, width, step in (({}, automatic, 0.5), ({"line_width": 0.3, "step_width": 1}, 0.3, 1)):
        t = np.clip((distance / width - (1 - step)) / step, 0, 1)
        smooth = t * t * (3 - 2 * t)
        image = shown([{**wires, **settings}], {"type": "mesh", "mesh": mesh})
        np.testing.assert_allclose(image, np.stack([1 - smooth, smooth, np.ones_like(t)], -1), atol=3e-3)
    np.testing.assert_allclose(shown([wires]), np.tile([0.0, 1, 1], (SIZE, SIZE, 1)))  # no mesh: no edges


@pytest.mark.parametrize("kind, factor", [("gaussian", 4.0), ("mean", -2.0)])
def test_curvature_of_a_sphere(kind: str, factor: float) -> None:
    """Radius 1/2, normals outside; of the true sphere and of a fine mesh."""
    texture = {"type": "curvature", "curvature": kind, "scale": 0.1}
    expected = [max(0.1 * factor, 0), 0, max(-0.1 * factor, 0)]
    mesh = uv_sphere(256, 128, smooth=True)
    for shape in ({"type": "sphere"}, {"type": "mesh", "mesh": mesh}):
        image = shown([texture], {**shape, "to_world": scaling(0.5)}, width=0.6)
        np.testing.assert_allclose(np.median(image.reshape(-1, 3), axis=0), expected, rtol=2e-2)
    assert not shown([texture]).any()


PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property float r
property float g
property float b
property float load_x
element face 2
property list uchar int vertex_indices
property float heat_x
end_header
-1 -1 0 1 0 0 0.1
1 -1 0 0 1 0 0.2
1 1 0 0 0 1 0.3
-1 1 0 1 1 1 0.4
3 0 1 2 0.25
3 0 2 3 0.75
"""


@pytest.mark.parametrize("attribute", ["vertex_color", "vertex_load", "face_heat"])
def test_mesh_attributes(attribute: str, tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"
    path.write_text(PLY)
    mesh = {"type": "mesh", "mesh": _core.load_ply(str(path))}
    lower = U > V
    colours = {
        "vertex_color": np.where(
            lower[..., None],
            np.stack([1 - U, U - V, V], -1),
            np.stack([1 - V + (V - U), V - U, U + (V - U)], -1),
        ),
        "vertex_load": np.where(lower, 0.1 + 0.1 * U + 0.1 * V, 0.1 - 0.1 * U + 0.3 * V)[..., None],
        "face_heat": np.where(lower, 0.25, 0.75)[..., None],
    }
    image = shown([{"type": "mesh_attribute", "name": attribute, "scale": 2}], mesh)
    inside = np.abs(U - V) > 1e-2
    expected = np.broadcast_to(2 * colours[attribute], image.shape)
    np.testing.assert_allclose(image[inside], expected[inside], atol=1e-3)
    assert not shown([{"type": "mesh_attribute", "name": "vertex_none"}], mesh).any()


def test_attributes_need_a_prefix() -> None:
    with pytest.raises(_core.DescriptionError, match="begins with vertex_ or face_"):
        make_scene(textures=[{"type": "mesh_attribute", "name": "color"}])


# Filtering


def tilted_plane(
    filter_type: str, spp: int, degrees: float = 80, footprint: str = "differentials", **settings: object
) -> np.ndarray:
    """A textured plane under even light, seen at a grazing angle: its albedo."""
    scene = make_scene(
        shapes=[{"type": "rectangle", "to_world": rotation((1, 0, 0), degrees) @ scaling(4), "material": 0}],
        emitters=[{"type": "constant"}],
        textures=[
            {
                "type": "bitmap",
                "image": _core.Image(NOISE),
                "filter_type": filter_type,
                "to_uv": scaling(10),
                **settings,
            }
        ],
        bsdfs=[{"type": "diffuse", "reflectance": {"texture": 0}}],
        sensor=front_view(9, 3),
        size=(64, 32),
        strategy="bsdf",
        footprint=footprint,
        max_depth=2,
    )
    return picture(scene, spp)


def error(kind: str, spp: int, degrees: float, truth: np.ndarray, footprint: str = "differentials") -> float:
    return float(np.sqrt(np.mean((tilted_plane(kind, spp, degrees, footprint) - truth) ** 2)))


@pytest.mark.parametrize("footprint", ["differentials", "cone"])
def test_elliptical_averages_follow_the_footprint_of_a_pixel(footprint: str) -> None:
    """One sample sees most of what a pixel sees, at a grazing angle too, and little else.

    Of a cone, trilinear filters see only the width, which is noisy; of differentials a circle of the same
    area, which blurs.
    """
    truth = tilted_plane("bilinear", 4096, 75)
    kinds = ("bilinear", "trilinear", "ewa")
    one = {kind: error(kind, 1, 75, truth, footprint) for kind in kinds}
    assert one["ewa"] < 0.3 * one["bilinear"]
    many = {kind: error(kind, 512, 75, truth, footprint) for kind in kinds}
    assert many["ewa"] < 0.5 * truth.std() and many["ewa"] < 1.5 * many["trilinear"]
    if footprint == "cone":
        assert one["ewa"] < 0.6 * one["trilinear"]
    else:
        assert one["ewa"] < 1.02 * one["trilinear"] and many["ewa"] < 0.8 * many["trilinear"]


def test_round_footprints_are_filtered_alike() -> None:
    truth = tilted_plane("bilinear", 1024, degrees=0)
    one = {kind: error(kind, 1, 0, truth) for kind in ("bilinear", "trilinear", "ewa")}
    assert abs(one["ewa"] - one["trilinear"]) < 0.1 * one["trilinear"] and one["ewa"] < 0.6 * one["bilinear"]


@pytest.mark.parametrize("wrap_mode", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("degrees", [0, 60, 89.9])
def test_filters_keep_what_is_constant(degrees: float, wrap_mode: str) -> None:
    image = _core.Image(np.full((5, 7, 3), 0.25, np.float32))
    grey, seen = (
        tilted_plane(kind, 4, degrees, image=image, wrap_mode=wrap_mode, max_anisotropy=7)
        for kind in ("ewa", "nearest")
    )
    np.testing.assert_allclose(grey, seen, rtol=1e-5)
    assert seen.min() < 0.9


def test_footprints_larger_than_the_image_see_its_mean() -> None:
    image = tilted_plane("ewa", 4, degrees=0, to_uv=scaling(3e4))
    np.testing.assert_allclose(image, np.broadcast_to(NOISE.mean((0, 1)), image.shape), rtol=1e-3)


# Reading


def textures_of(folder: Path, texture: str, version: str = "3.0.0") -> tuple[list[Settings], list[str]]:
    """The textures of a scene with a diffuse shape that has this texture, and the warnings."""
    body = f'<shape type="sphere"><bsdf type="diffuse">{texture}</bsdf></shape>'
    description = read(folder, body, version)
    return description.core["textures"], messages(description, folder)


def test_scale_takes_its_texture_by_any_name(tmp_path: Path) -> None:
    board = '<texture type="checkerboard" name="{}"/>'
    for name in ("", "texture", "nested"):
        scaled = (
            f'<texture type="scale" name="reflectance">{board.format(name)}<float name="scale" value="2"/>'
        )
        textures, warnings = textures_of(tmp_path, scaled + "</texture>", "0.6.0")
        assert not warnings and textures[0]["type"] == "checkerboard"
        assert textures[1] == {"type": "scale", "texture": {"texture": 0}, "scale": (2.0,) * 3}
    both = board.format("texture") + board.format("scale")
    textures, _ = textures_of(tmp_path, f'<texture type="scale" name="reflectance">{both}</texture>')
    assert textures[2] == {"type": "scale", "texture": {"texture": 0}, "scale": {"texture": 1}}
    colour = '<texture type="scale" name="reflectance"><rgb name="value" value=".1 .2 .3"/></texture>'
    assert textures_of(tmp_path, colour)[0] == [{"type": "scale", "texture": (0.1, 0.2, 0.3)}]


def test_scale_of_nothing_is_refused(tmp_path: Path) -> None:
    body = (
        '<shape type="sphere"><bsdf type="diffuse"><texture type="scale" name="reflectance"/></bsdf></shape>'
    )
    assert "needs a texture inside" in error_of(tmp_path, body)


def test_checkerboards_read_as_numbers(tmp_path: Path) -> None:
    """As in Mitsuba 3 the colours are exchanged; older files mean what they say."""
    body = '<shape type="sphere"><bsdf type="mask"><texture type="checkerboard" name="opacity"/>'
    body += '<bsdf type="diffuse"/></bsdf></shape>'
    for version, colours in (("3.0.0", (0.2, 0.4)), ("0.6.0", (0.4, 0.2))):
        core = read(tmp_path, body, version).core
        board = core["textures"][core["adapters"][0]["opacity"]["texture"]]
        assert (board.get("color0", 0.4), board.get("color1", 0.2)) == colours


def test_attributes_that_no_mesh_has_are_told(tmp_path: Path) -> None:
    texture = '<texture type="vertexcolors" name="reflectance"/>'
    textures, warnings = textures_of(tmp_path, texture, "0.6.0")
    assert textures[0] == {"type": "mesh_attribute", "name": "vertex_color"}
    assert len(warnings) == 1 and 'no mesh has the attribute "vertex_color"' in warnings[0]


def on_a_screen(bitmap: dict[str, object]) -> np.ndarray:
    """A bitmap of four by four pixels, as light."""
    scene = {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {
            "type": "orthographic",
            "to_world": look_at((0, 0, 3), (0, 0, 0)),
            "film": {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}},
        },
        "screen": {"type": "rectangle", "light": {"type": "area", "radiance": {"type": "bitmap", **bitmap}}},
    }
    loaded = load_dict(scene)
    assert loaded.warnings == []
    return loaded.render(spp=16, seed=1).array[::-1]  # v = 0 is the first row


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize(
    "channels, channel", [(1, ""), (2, ""), (3, ""), (4, ""), (4, "g"), (4, "A"), (2, "a")]
)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_an_array_is_read_as_a_file_of_its_type(
    dtype: type, channels: int, channel: str, raw: bool, tmp_path: Path
) -> None:
    import OpenImageIO as oiio

    pixels = np.random.default_rng(3).integers(0, np.iinfo(dtype).max, (4, 4, channels), dtype, endpoint=True)
    spec = oiio.ImageSpec(4, 4, channels, "uint8" if dtype is np.uint8 else "uint16")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(str(tmp_path / "a.png"))
    assert output.open(str(tmp_path / "a.png"), spec) and output.write_image(pixels) and output.close()
    given = {"raw": raw, "filter_type": "nearest", **({"channel": channel} if channel else {})}
    array = on_a_screen({"data": pixels[:, :, 0] if channels == 1 else pixels, **given})
    assert np.array_equal(array, on_a_screen({"filename": str(tmp_path / "a.png"), **given}))
    names = {1: "y", 2: "ya", 3: "rgb", 4: "rgba"}[channels]
    used = [names.index(channel.lower())] if channel else list(range(3 if channels > 2 else 1))
    values = pixels[:, :, used] / np.iinfo(dtype).max
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    expected = values if raw or channel.lower() == "a" else linear
    assert np.allclose(array, np.broadcast_to(expected, array.shape), atol=1e-4)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64])
def test_floating_point_arrays_are_linear(dtype: type) -> None:
    pixels = np.random.default_rng(3).random((4, 4, 4)).astype(dtype)
    shown = on_a_screen({"data": pixels, "filter_type": "nearest"})
    assert np.allclose(shown, pixels[:, :, :3], atol=1e-6)


def test_arrays_of_other_shapes_are_refused() -> None:
    rgb = np.zeros((4, 4, 3))
    for bitmap in ({"data": np.zeros((4, 4, 5))}, *({"data": rgb, "channel": name} for name in ("a", "gb"))):
        with pytest.raises(SceneError, match=r"must have the shape|has no channel"):
            on_a_screen(bitmap)


PLAIN = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\n"


@pytest.mark.parametrize(
    "material, told",
    [
        ('<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>', True),
        (
            '<bsdf type="twosided"><bsdf type="mask"><texture type="scale" name="opacity"><texture '
            'type="checkerboard"/></texture><bsdf type="plastic"/></bsdf></bsdf>',
            True,
        ),
        ('<emitter type="area"><texture type="checkerboard" name="radiance"/></emitter>', True),
        ('<bsdf type="diffuse"><texture type="vertexcolors" name="reflectance"/></bsdf>', False),
        ('<bsdf type="plastic"/>', False),
    ],
)
def test_a_texture_on_a_mesh_without_coordinates_is_told(material: str, told: bool, tmp_path: Path) -> None:
    (tmp_path / "plain.obj").write_text(PLAIN + "f 1 2 3\n")
    (tmp_path / "mapped.obj").write_text(PLAIN + "vt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n")
    body = '<shape type="obj"><string name="filename" value="{}.obj"/>' + material + "</shape>"
    found = " ".join(messages(read(tmp_path, body.format("plain") * 2), tmp_path))
    assert ("no texture coordinates" in found) == told and ("(2 times)" in found or not told)
    assert "coordinates" not in " ".join(messages(read(tmp_path, body.format("mapped")), tmp_path))
