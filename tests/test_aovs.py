"""Layers beside the picture: variables, ids, Cryptomattes, variance; and the files that hold them. Expected
values are known from the scenes' geometry, or come from a decoder that shares no code with the writer.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from scene_tools import look_at, scaling, t_margin, translation
from statistics_tools import require

import lajolla
from lajolla import _core, cli, layers
from lajolla.aovs import AOVS, IDS, is_matte
from lajolla.limits import COMPRESSIONS
from lajolla.scene import load_description, numbered

Scene = dict[str, Any]

SIZE = 8  # pixels on either side: the plane z = 0 from -1 to 1, seen from above
GREY = {"type": "diffuse"}
LIGHTS = ("lightgroup_rest", "lightgroup_key")


def square(low: float, high: float, z: float, **parts: object) -> Scene:
    """A rectangle over x from low to high and all y."""
    to_world = translation((low + high) / 2, 0, z) @ scaling((high - low) / 2, 1, 1)
    return {"type": "rectangle", "to_world": to_world, **parts}


def scene_of(shapes: Scene, *, rfilter: str = "box", pixel_format: str = "rgb", **parts: object) -> Scene:
    film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "pixel_format": pixel_format}
    return {
        "type": "scene",
        "integrator": {"type": "path"},
        "sensor": {
            "type": "orthographic",
            "to_world": look_at((0, 0, 5), (0, 0, 0)),  # x points to the right
            "film": {**film, "rfilter": {"type": rfilter}},
        },
        "light": {"type": "directional", "direction": [0, 0, -1], "lightgroup": "key"},
        **shapes,
        **parts,
    }


def masked(opacity: float) -> Scene:
    return {"type": "mask", "opacity": opacity, "inner": {"type": "twosided", "inner": GREY}}


HALVES = {"wall": square(-1, 1, 0, bsdf=GREY), "front": square(-1, 0, 1, bsdf=GREY)}


def column(values: np.ndarray) -> np.ndarray:
    """What all rows have in common."""
    assert np.array_equal(values, np.broadcast_to(values[:1], values.shape))
    return values[0]


def test_variables_are_what_geometry_says() -> None:
    aovs = ["depth", "position", "normal", "rel_position", "albedo", "uv", "alpha"]
    tinted = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.2, 0.4, 0.6]}}
    shapes = {"wall": square(-1, 1, 0, bsdf=tinted), "front": square(-1, 0, 1, bsdf=GREY)}
    scene = lajolla.load_dict(scene_of(shapes), aovs=aovs, spp=16)
    layer = scene.render().arrays()
    assert list(layer) == ["rgb", "alpha", *aovs[:-1]]
    near = np.arange(SIZE) < SIZE // 2
    np.testing.assert_allclose(column(layer["depth"]), np.where(near, 4, 5), rtol=1e-6)
    np.testing.assert_allclose(column(layer["rel_position"][..., 2]), np.where(near, 4, 5), rtol=1e-6)
    np.testing.assert_allclose(column(layer["position"][..., 2]), np.where(near, 1, 0), atol=1e-6)
    np.testing.assert_allclose(layer["position"][0, :, 0], (np.arange(SIZE) + 0.5) / 4 - 1, atol=1 / (4 * 16))
    np.testing.assert_allclose(layer["normal"], np.broadcast_to([0, 0, 1], (SIZE, SIZE, 3)), atol=1e-6)
    np.testing.assert_allclose(layer["albedo"][:, -1], np.tile([0.2, 0.4, 0.6], (SIZE, 1)), rtol=1e-6)
    assert layer["uv"].shape == (SIZE, SIZE, 2) and np.all(layer["alpha"] == 1)


def test_layers_look_through_what_the_picture_looks_through() -> None:
    shapes = {"wall": square(-1, 1, 0, bsdf=GREY), "leaf": square(-1, 0, 1, bsdf=masked(0.25))}
    image = lajolla.load_dict(scene_of(shapes), aovs=["depth", "alpha"], spp=64).render()
    depth = image.arrays()["depth"]
    np.testing.assert_allclose(depth[:, SIZE // 2 :], 5, rtol=1e-6)
    # One uniform number decides, and the 64 Sobol' points have one in each 64th.
    np.testing.assert_allclose(depth[:, : SIZE // 2], 0.25 * 4 + 0.75 * 5, rtol=1e-6)


def test_hidden_lights_are_in_no_layer() -> None:
    lamp = square(-1, 0, 1, emitter={"type": "area", "radiance": 1.0})
    shapes = {"wall": square(-0.5, 0.5, 0, bsdf=GREY), "lamp": lamp}
    aovs = ["depth", "alpha", "shape", "crypto_shape"]
    shown = lajolla.load_dict(scene_of(shapes), aovs=aovs, spp=4).render()
    hidden = lajolla.load_dict(scene_of(shapes), aovs=aovs, spp=4, hide_emitters=True).render()
    lit, wall = np.arange(SIZE) < 4, abs(np.arange(SIZE) - 3.5) < 2
    assert np.array_equal(column(shown.channels["A"]), (lit | wall).astype(np.float32))
    assert np.array_equal(column(hidden.channels["A"]), wall.astype(np.float32))
    assert np.array_equal(column(hidden.channels["depth.Z"]), np.where(wall, np.float32(5), 0))
    ids = hidden.layers["shape"]
    assert np.array_equal(column(ids.values), np.where(wall, ids.names.index("wall"), 0))
    assert np.array_equal(column(hidden.layers["crypto_shape"].coverage[..., 0]), wall.astype(np.float32))
    assert np.all(hidden.array[:, ~wall] == 0) and np.all(shown.array[:, lit & ~wall] == 1)


def test_options_that_do_not_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = scene_of(HALVES)
    with pytest.raises(lajolla.OptionError, match=r"unknown aov 'normals'; did you mean 'normal'\?"):
        lajolla.load_dict(scene, aovs=["normals"])
    with pytest.raises(lajolla.OptionError, match="aovs is a list of names"):
        lajolla.load_dict(scene, aovs="normal")
    with pytest.raises(lajolla.OptionError, match="at least two samples"):
        lajolla.load_dict(scene, aovs=["variance"], spp=1).render()
    with pytest.raises(lajolla.OptionError, match="the integrator 'ao' has no hide_emitters"):
        lajolla.load_dict(scene, integrator="ao", hide_emitters=True)
    with pytest.raises(lajolla.OptionError, match="hide_emitters must be True or False"):
        lajolla.load_dict(scene, hide_emitters=1)
    own = {"type": "aov", "aovs": "depth:depth,albedo:albedo", "inner": {"type": "path"}}
    with pytest.raises(lajolla.OptionError, match=r"has a channel 'albedo.R' itself"):
        lajolla.load_dict(scene_of(HALVES, integrator=own), aovs=["albedo"])
    assert cli.main(["render", "scene.xml", "--aov", "albedo,dept"]) == 1
    assert "unknown aov 'dept'; did you mean 'depth'?" in capsys.readouterr().err
    assert cli.main(["list", "aov"]) == 0
    listed = capsys.readouterr().out
    assert all(f"  {name} " in listed for name in AOVS)


# --- ids


INSTANCED = {
    "wall": square(-1, 1, 0, bsdf={"type": "ref", "id": "stone"}),
    "stone": {"type": "diffuse", "reflectance": 0.3},
    "slate": {"type": "diffuse", "reflectance": 0.3},
    "group": {
        "type": "shapegroup",
        "leaf": square(-0.25, 0, 0, bsdf={"type": "ref", "id": "slate"}),
        "stem": {**square(0, 0.25, 0, bsdf=GREY), "id": "stem"},
    },
    "first": {"type": "instance", "to_world": translation(-0.5, 0, 1), "of": {"type": "ref", "id": "group"}},
    "second": {"type": "instance", "to_world": translation(0.5, 0, 1), "of": {"type": "ref", "id": "group"}},
}


def test_ids_are_those_of_pixel_centres() -> None:
    aovs = [*IDS, "crypto_instance", "crypto_material"]
    image = lajolla.load_dict(scene_of(INSTANCED), aovs=aovs, spp=4).render()
    arrays = image.arrays()
    assert all(arrays[aov].dtype == np.int32 for aov in IDS)
    texts = {aov: column(arrays[f"{aov}_names"][arrays[aov]]).tolist() for aov in IDS[:3]}
    assert texts["shape"] == ["wall", "shape_2", "stem", "wall"] * 2
    assert texts["instance"] == ["", "first", "first", "", "", "second", "second", ""]
    # Equal materials are different objects if they have different ids.
    assert texts["material"] == ["stone", "slate", "stem.bsdf", "stone"] * 2
    primitives = arrays["primitive"]
    assert set(np.unique(primitives)) <= {0, 1}
    for aov in ("crypto_instance", "crypto_material"):
        assert np.array_equal(arrays[aov][..., 0], arrays[aov.removeprefix("crypto_")])


def test_nothing_has_no_id() -> None:
    arrays = lajolla.load_dict(scene_of({"a": square(0, 1, 0)}), aovs=list(IDS), spp=1).render().arrays()
    for aov in IDS:
        assert np.all(arrays[aov][:, : SIZE // 2] == (-1 if aov == "primitive" else 0)), aov
        assert np.all(arrays[aov][:, SIZE // 2 :] >= (aov == "shape")), aov


@pytest.mark.parametrize(("opacity", "expected"), [(0.6, "near"), (0.4, "far"), (0.2, "wall")])
def test_an_id_is_of_where_half_of_the_light_is_stopped(opacity: float, expected: str) -> None:
    shapes = {
        "near": square(-1, 1, 2, bsdf=masked(opacity)),
        "far": square(-1, 1, 1, bsdf=masked(opacity)),
        "wall": square(-1, 1, 0, bsdf=GREY),
    }
    ids = lajolla.load_dict(scene_of(shapes), aovs=["shape"], spp=1).render().layers["shape"]
    assert {ids.names[i] for i in np.unique(ids.values)} == {expected}


def test_names_of_objects(tmp_path: Path) -> None:
    (tmp_path / "two.obj").write_text(
        "mtllib two.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nusemtl red\nf 1 2 3\nusemtl blue\nf 2 4 3\n"
    )
    (tmp_path / "two.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    spheres = "".join(f'<shape type="sphere"><float name="radius" value="{r}"/></shape>' for r in range(1, 6))
    mesh = """<shape type="obj"{}><string name="filename" value="two.obj"/>
        <boolean name="load_materials" value="true"/></shape>"""
    (tmp_path / "scene.xml").write_text(
        f"""<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"/>
        {spheres}{mesh.format("")}{mesh.format(' id="shape_8"')}
        <shape type="disk"><bsdf type="twosided"><bsdf type="diffuse" id="inner"/></bsdf></shape>
        <emitter type="constant"/></scene>"""
    )
    description = load_description(tmp_path / "scene.xml")
    shapes, materials, instances = (
        numbered(description.objects, description.core, where)
        for where in ("shapes", "materials", "instances")
    )
    # Both parts of a mesh are one shape; a name that is taken gets another ending.
    assert shapes.numbers.tolist() == [1, 2, 3, 4, 5, 6, 6, 7, 7, 8]
    assert list(shapes.names) == ["", *(f"shape_{i}" for i in range(1, 7)), "shape_8", "shape_10"]
    assert list(materials.names) == ["", "shape_1.bsdf", "red", "blue", "inner"]
    assert instances.numbers.tolist() == []


# --- Cryptomatte


def decoded(path: Path, name: str) -> dict[str, np.ndarray]:
    """The matte of each object in a Cryptomatte, as the specification says to read it."""
    header = attributes(path.read_bytes())
    (key,) = (k.rpartition("/")[0] for k, v in header.items() if k.endswith("/name") and v == name)
    assert header[f"{key}/hash"] == "MurmurHash3_32"
    assert header[f"{key}/conversion"] == "uint32_to_float32"
    assert len(key.partition("/")[2]) == 7
    manifest = json.loads(header[f"{key}/manifest"])
    file = oiio.ImageInput.open(str(path))
    names, pixels = list(file.spec().channelnames), file.read_image("float")
    levels = sorted({n.split(".")[0] for n in names if n.startswith(name)})
    assert levels == [f"{name}0{i}" for i in range(3)]
    mattes = {}
    for text, bits in manifest.items():
        (wanted,) = struct.unpack("<f", struct.pack("<I", int(bits, 16)))
        mattes[text] = sum(
            np.where(pixels[..., names.index(f"{level}.{i}")] == np.float32(wanted), 1, 0)
            * pixels[..., names.index(f"{level}.{c}")]
            for level in levels
            for i, c in ("rg", "ba")
        )
    return mattes


def attributes(data: bytes) -> dict[str, str]:
    """The texts in the header of an EXR file (OpenEXR's file layout)."""
    found, at = {}, 8
    while data[at]:
        end = data.index(0, at)
        kind_end = data.index(0, end + 1)
        (size,) = struct.unpack_from("<I", data, kind_end + 1)
        value = data[kind_end + 5 : kind_end + 5 + size]
        if data[end + 1 : kind_end] == b"string":
            found[data[at:end].decode()] = value.decode()
        at = kind_end + 5 + size
    return found


def test_hashes() -> None:
    # Published values of MurmurHash3_x86_32 with the seed 0.
    known = {b"": 0, b"hello": 0x248BFA47, b"hello, world": 0x149BBB7F, b"test": 0xBA6BD213}
    known[b"The quick brown fox jumps over the lazy dog"] = 0x2E4FF723
    assert {data: layers.murmur_hash(data) for data in known} == known
    # Names that hash to infinities, NaN and denormal numbers become others.
    names = [f"object_{i}" for i in range(4000)]
    bits = np.array([layers.name_hash(name) for name in names], np.uint32)
    exponents = bits >> 23 & 255
    assert exponents.min() > 0 and exponents.max() < 255
    changed = [
        layers.murmur_hash(name.encode()) != bit for name, bit in zip(names, bits.tolist(), strict=True)
    ]
    assert 0 < sum(changed) < 100


@pytest.mark.parametrize("rfilter", ["box", "mitchell"])
def test_mattes_are_coverages(rfilter: str, tmp_path: Path) -> None:
    edge = -1 + 2 * (2 + 0.3) / SIZE  # covers 0.3 of the third column
    shapes = {
        'Wänd "ñ"': square(-0.5, 1, 0, bsdf=GREY),
        "card": square(-1, edge, 1, bsdf=GREY),
        "leaf": square(0.5, 1, 2, bsdf=masked(0.75)),
    }
    scene = lajolla.load_dict(
        scene_of(shapes, rfilter=rfilter), aovs=["alpha", "crypto_shape", "crypto_material"], spp=256
    )
    image = scene.render(seed=3)
    image.save(tmp_path / "a.exr", half=True, compression="dwaa")
    mattes = decoded(tmp_path / "a.exr", "crypto_shape")
    assert set(mattes) == set(shapes)
    excess = sum(mattes.values()) - image.channels["A"]
    # Objects with negative coverage are left out, which other filters have.
    assert excess.min() > -1e-6 and excess.max() < (1e-6 if rfilter == "box" else 0.05)
    if rfilter == "box":  # one of 256 Sobol' points is in each 256th of a pixel
        card = np.broadcast_to([1, 1, 0.3, 0, 0, 0, 0, 0], (SIZE, SIZE))
        np.testing.assert_allclose(mattes["card"], card, atol=1 / 256)
        np.testing.assert_allclose(mattes["leaf"][:, -2:], 0.75, atol=1e-6)
    matte = image.layers["crypto_shape"]
    assert np.all(np.diff(matte.coverage, axis=2) <= 0)
    assert np.array_equal(matte.numbers == 0, matte.coverage == 0)
    again = scene.render(seed=3, threads=1)
    assert again.layers["crypto_shape"].numbers.tobytes() == matte.numbers.tobytes()
    assert again.layers["crypto_shape"].coverage.tobytes() == matte.coverage.tobytes()


def test_bands_and_ranks() -> None:
    shapes = {f"s{i}": square(-1 + i / 40, -1 + (i + 1) / 40, 0, bsdf=GREY) for i in range(80)}
    scene = lajolla.load_dict(scene_of(shapes), aovs=["crypto_shape"], spp=64)
    whole = scene.render().layers["crypto_shape"]
    assert np.all(whole.coverage[..., -1] > 0)  # ten shapes in a pixel: the largest six are kept
    numbers = np.arange(1, 81, dtype=np.int32)
    parts = [
        _core.object_coverage(scene.core, [("shape", numbers)], scene.core.seed, 0, 64, 6, first, first + 4)
        for first in (0, 4)
    ]
    joined = [np.concatenate([part[0][i] for part in parts]) for i in range(2)]
    assert np.array_equal(joined[0], whole.numbers) and np.array_equal(joined[1], whole.coverage)
    with pytest.raises(ValueError, match="one number for each shape expected"):
        _core.object_coverage(scene.core, [("shape", numbers[1:])], 0, 0, 1, 6, 0, 1)


# --- files


def test_mattes_of_files_stay_as_they_are(tmp_path: Path) -> None:
    """Also those of other programs, whose channels are named like colours."""
    image = lajolla.load_dict(scene_of(INSTANCED), aovs=["depth", "crypto_shape"], spp=4).render()
    ours, name = image.layers["crypto_shape"], "View.CryptoObject"
    channels = {f"{name}{k[-4:].upper()}": values for k, values in ours.channels(name).items()}
    image.layers[name] = layers.StoredCryptomatte(channels, ours.metadata(name))
    image.save(tmp_path / "a.exr")
    opened = lajolla.Image.open(tmp_path / "a.exr")
    assert set(opened.channels) == {"depth.Z"}
    opened.save(tmp_path / "b.exr", half=True)
    before, after = (attributes((tmp_path / file).read_bytes()) for file in ("a.exr", "b.exr"))
    assert {k: v for k, v in before.items() if k.startswith("cryptomatte/")}.items() <= after.items()
    again = lajolla.Image.open(tmp_path / "b.exr").layers
    for matte, layer in image.layers.items():
        for channel, values in layer.channels(matte).items():
            assert again[matte].channels(matte)[channel].tobytes() == values.tobytes()
    with pytest.raises(lajolla.ImageError, match="pxr24 rounds numbers"):
        opened.save(tmp_path / "c.exr", compression="pxr24")


def saved(path: Path, **options: Any) -> tuple[dict[str, str], dict[str, np.ndarray]]:  # noqa: ANN401
    """The formats and the values of the channels of a render with every layer."""
    scene = lajolla.load_dict(scene_of(INSTANCED), aovs=list(AOVS), spp=4)
    scene.render().save(path, **options)
    file = oiio.ImageInput.open(str(path))
    spec = file.spec()
    names, pixels = list(spec.channelnames), file.read_image("float")
    formats = spec.channelformats or [spec.format] * len(names)
    return dict(zip(names, map(str, formats), strict=True)), {
        name: pixels[..., i] for i, name in enumerate(names)
    }


def test_only_colours_are_stored_in_16_bits(tmp_path: Path) -> None:
    formats, _ = saved(tmp_path / "a.exr", half=True)
    assert {name for name, kind in formats.items() if kind == "half"} == {
        *"RGBA",
        *(f"{layer}.{letter}" for layer in ("albedo", *LIGHTS) for letter in "RGB"),
    }
    assert set(saved(tmp_path / "b.exr")[0].values()) == {"float"}


@pytest.mark.parametrize("compression", [c for c in COMPRESSIONS if c != "pxr24"])
def test_compressions_keep_data(compression: str, tmp_path: Path) -> None:
    _, values = saved(tmp_path / "a.exr", compression=compression)
    _, expected = saved(tmp_path / "b.exr", compression="none")
    for name, pixels in expected.items():
        if name.rpartition(".")[2] not in "RGB" or not compression.startswith("dwa"):
            assert np.array_equal(values[name], pixels), name
    stored = oiio.ImageInput.open(str(tmp_path / "a.exr")).spec().getattribute("compression")
    assert stored == compression


def test_compressions_that_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(
        lajolla.ImageError, match="pxr24 rounds numbers, which would destroy the layer 'shape'"
    ):
        saved(tmp_path / "a.exr", compression="pxr24")
    with pytest.raises(lajolla.ImageError, match=r"unknown compression 'zap'; did you mean 'zip'\?"):
        saved(tmp_path / "a.exr", compression="zap")
    assert not list(tmp_path.iterdir())


def test_npz_files_hold_arrays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    image = lajolla.load_dict(scene_of(INSTANCED), aovs=list(AOVS), spp=4).render()
    image.save("a.npz")
    with np.load("a.npz") as file:
        stored = dict(file)
    expected = image.arrays()
    assert list(stored) == list(expected)
    assert all(np.array_equal(stored[name], values) for name, values in expected.items())
    assert stored["rgb"].dtype == stored["alpha"].dtype == np.float32
    assert {*AOVS, *LIGHTS} - {"lightgroups"} <= set(stored)
    names = stored["crypto_shape_names"][stored["crypto_shape"][0, 1, 0]]
    assert names == "shape_2"
    image.save("b.npz")
    assert Path("a.npz").read_bytes() == Path("b.npz").read_bytes()
    exr = saved(tmp_path / "c.exr")[1]
    assert all(np.array_equal(exr[f"{aov}.I"], stored[aov]) for aov in IDS)
    image.save("d.npy")
    means = 5 + sum(len(v.letters) for v in AOVS.values()) + 3 * len(("variance", *LIGHTS))
    assert np.load("d.npy").shape == (SIZE, SIZE, means + len(IDS) + 12 * sum(map(is_matte, AOVS)))


def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:  # noqa: ANN401
    monkeypatch.chdir(tmp_path)
    Path("scene.xml").write_text(
        """<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"><film type="hdrfilm">
        <integer name="width" value="6"/><integer name="height" value="4"/></film></sensor>
        <shape type="sphere" id="lamp"><point name="center" z="3"/><emitter type="area"/></shape></scene>"""
    )
    words = (
        "render scene.xml --spp 2 --quiet --aov shape --aov depth,alpha --compression piz -o a.exr -o a.npz"
    )
    assert cli.main([*words.split(), "--hide-emitters"]) == 0
    names = oiio.ImageInput.open("a.exr").spec().channelnames
    assert names == ("R", "G", "B", "A", "depth.Z", "shape.I")
    with np.load("a.npz") as file:
        assert file["shape_names"].tolist() == ["", "lamp"]
        assert not any(file[name].any() for name in ("rgb", "alpha", "depth", "shape"))
    many = "render scene.xml --spp 1073741824 --aov shape --compression pxr24 -o b.exr"  # refused before
    assert cli.main(many.split()) == 1
    assert "b.exr: pxr24 rounds numbers" in capsys.readouterr().err
    assert cli.main("render scene.xml --spp 1 --quiet --aov shape -o a.png".split()) == 0
    assert "files hold all channels" in capsys.readouterr().err


# --- variance


@pytest.mark.parametrize("rfilter", ["gaussian", "lanczos"])
def test_variance_is_that_of_independent_renders(rfilter: str) -> None:
    """The estimate has no bias for independent samples. Renders with different seeds tell the variance."""
    shapes = {"wall": square(-1, 0.2, 0, bsdf=masked(0.5)), "sky": {"type": "constant", "radiance": 0.2}}
    spp, renders = 8, 256
    scene = lajolla.load_dict(
        scene_of(shapes, rfilter=rfilter), aovs=["variance"], sampler="independent", spp=spp
    )
    images = [scene.render(seed=seed) for seed in range(renders)]
    means = np.array([image.array[..., 0] for image in images], np.float64)
    estimates = np.array([image.channels["variance.R"] for image in images], np.float64)
    true = means.var(axis=0, ddof=1).mean()
    # Pixels are independent, so that the differences of the pixels' means are too.
    differences = (estimates.mean(axis=0) - means.var(axis=0, ddof=1)).ravel()
    margin = t_margin(differences.std(ddof=1) / np.sqrt(differences.size), differences.size - 1, 1)
    require(abs(differences.mean()) <= margin + 1e-4 * true, f"{differences.mean()} of {true}, {margin}")
    assert margin < 0.1 * true
