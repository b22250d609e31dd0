"""An independent oracle: the same scene rendered by the ``mitsuba`` package.

Scene files of any age are restated with the film, depth and sampler of a comparison, brought to the dialect
that Mitsuba 3.9 reads, and rendered in independent batches, so that every mean comes with its standard error.
Nothing here uses lajolla's own reader: a misreading on one side must show up as a difference.
"""

from __future__ import annotations

import ctypes
import functools
import glob
import os
import re
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

# Rounding of colours and tables may differ between renderers by this fraction of the mean.
RELATIVE_ALLOWANCE = 0.003
# Probability that a correct renderer fails one comparison of block means.
FAMILY_WISE_ERROR = 1e-3

OLD_TAGS = {"camera": "sensor", "luminaire": "emitter", "lookAt": "lookat"}
OLD_TYPES = {
    ("film", "exrfilm"): "hdrfilm",
    ("film", "ldrfilm"): "hdrfilm",
    ("film", "pngfilm"): "hdrfilm",
    ("film", "mfilm"): "hdrfilm",
    ("texture", "exrtexture"): "bitmap",
    ("texture", "ldrtexture"): "bitmap",
}
OLD_NAMES = {"intensity_scale": "scale", "density_multiplier": "scale", "focus_depth": "focus_distance"}
FILTER_TYPES = {"trilinear": "bilinear", "ewa": "bilinear"}


@dataclass(frozen=True)
class Setup:
    """What a comparison changes in a scene; None leaves the file's own value.

    A new film size drops the file's crop window. Roulette starts beyond every path: with it, the renderers
    would sample the same mean with different, sometimes unbounded, variance.
    """

    width: int | None = None
    height: int | None = None
    max_depth: int | None = 8
    rr_depth: int = 1000
    rfilter: str | None = "box"
    sampler: str | None = "independent"


@dataclass(frozen=True)
class Estimate:
    """Independent renders of one scene: float64 `batches` of shape (B, H, W, 3)."""

    batches: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Mean image, (H, W, 3)."""
        return self.batches.mean(axis=0)

    def inner(self, margin: int) -> Estimate:
        """The same estimate without `margin` pixels along each edge."""
        return Estimate(self.batches[:, margin:-margin, margin:-margin]) if margin else self

    def blocks(self, size: int) -> np.ndarray:
        """Means of whole blocks of `size` x `size` pixels per batch, (B, H // size, W // size, 3)."""
        count, height, width, channels = self.batches.shape
        rows, columns = height // size, width // size
        whole = self.batches[:, : rows * size, : columns * size]
        return whole.reshape(count, rows, size, columns, size, channels).mean(axis=(2, 4))


# --- Scene files ----------------------------------------------------------------------------------


def restate(path: Path, target: Path, setup: Setup) -> Path:
    """Writes the scene to `target` with the set-up applied, otherwise in the file's own dialect."""
    root = ET.parse(path).getroot()
    _apply(root, setup)
    root.insert(0, ET.Element("path", value=str(path.parent.resolve())))
    ET.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    return target


def upgrade(path: Path, target: Path, setup: Setup) -> Path:
    """Writes the scene to `target` for Mitsuba 3, with its includes spliced in and the set-up applied."""
    root = _upgraded(path)
    _apply(root, setup)
    root.insert(0, ET.Element("path", value=str(path.parent.resolve())))
    ET.ElementTree(root).write(target, encoding="utf-8", xml_declaration=True)
    return target


def _version(root: ET.Element) -> tuple[int, ...]:
    return tuple(int(part) for part in root.get("version", "3.0.0").split("."))


def _property(tag: str, name: str, value: object) -> ET.Element:
    return ET.Element(tag, name=name, value=str(value))


def _drop(parent: ET.Element, names: set[str]) -> None:
    for child in [child for child in parent if child.get("name") in names]:
        parent.remove(child)


def _apply(root: ET.Element, setup: Setup) -> None:
    old = _version(root) < (2,)
    if setup.max_depth is not None:
        for integrator in root.findall("integrator"):
            root.remove(integrator)
        integrator = ET.SubElement(root, "integrator", type="path")
        integrator.append(_property("integer", "maxDepth" if old else "max_depth", setup.max_depth))
        integrator.append(_property("integer", "rrDepth" if old else "rr_depth", setup.rr_depth))
    for sensor in [*root.findall("sensor"), *root.findall("camera")]:
        if setup.sampler is not None:
            for sampler in sensor.findall("sampler"):
                sensor.remove(sampler)
            ET.SubElement(sensor, "sampler", type=setup.sampler)
        film = sensor.find("film")
        _apply_film(ET.SubElement(sensor, "film", type="hdrfilm") if film is None else film, setup)


def _apply_film(film: ET.Element, setup: Setup) -> None:
    _drop(film, {"pixelFormat", "pixel_format", "fileFormat", "file_format"})
    if setup.width is not None and setup.height is not None:
        _drop(film, {child.get("name", "") for child in film if child.get("name", "").startswith("crop")})
        _drop(film, {"width", "height"})
        film.append(_property("integer", "width", setup.width))
        film.append(_property("integer", "height", setup.height))
    if setup.rfilter is not None:
        for rfilter in film.findall("rfilter"):
            film.remove(rfilter)
        ET.SubElement(film, "rfilter", type=setup.rfilter)


def _upgraded(path: Path, search: tuple[Path, ...] = ()) -> ET.Element:
    """The root element of a scene file in the dialect of Mitsuba 3."""
    root = ET.parse(path).getroot()
    old = _version(root) < (2,)
    search = (path.parent, *search)
    for element in root.findall("path"):
        folder = (path.parent / element.get("value", "")).resolve()
        element.set("value", str(folder))
        search = (*search, folder)
    for parent in list(root.iter()):
        for child in list(parent):
            _upgrade_element(parent, child, old)
    _splice_includes(root, search)
    root.set("version", "3.0.0")
    return root


def _splice_includes(root: ET.Element, search: tuple[Path, ...]) -> None:
    for include in root.findall("include"):
        name = include.get("filename", "").replace("\\", "/")
        found = next(folder / name for folder in search if (folder / name).is_file())
        index = list(root).index(include)
        root.remove(include)
        for offset, child in enumerate(_upgraded(found, search)):
            root.insert(index + offset, child)


def _upgrade_element(parent: ET.Element, child: ET.Element, old: bool) -> None:
    child.tag = OLD_TAGS.get(child.tag, child.tag)
    kind = child.get("type")
    if kind is not None:
        child.set("type", OLD_TYPES.get((child.tag, kind), kind))
    name = child.get("name")
    if old and name is not None and child.tag != "default":
        snake = _snake_case(name)
        if parent.get("type") == "diffuse" and snake == "diffuse_reflectance":
            snake = "reflectance"
        child.set("name", OLD_NAMES.get(snake, snake))
    if child.tag == "boolean":
        child.set("value", child.get("value", "").lower())
    if child.tag == "string" and child.get("name") == "filename":
        child.set("value", child.get("value", "").replace("\\", "/"))
    if child.tag == "srgb":
        _upgrade_srgb(child)
    if old and child.tag == "spectrum" and re.fullmatch(r"[^:]+[\s,][^:]+", child.get("value", "").strip()):
        child.tag = "rgb"
    if old and child.tag == "spectrum" and parent.tag == "emitter" and ":" not in child.get("value", ":"):
        # One number was white; to Mitsuba 3 it is the equal-energy spectrum, which is reddish in sRGB.
        child.tag = "rgb"
    if child.tag == "texture":
        _upgrade_texture(child, old)
    if child.tag == "bsdf" and old and child.get("type") in ("conductor", "roughconductor"):
        _upgrade_conductor(child)


def _snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z])([A-Z]+)", lambda match: "_" + match.group(1), name).lower()


def _upgrade_srgb(element: ET.Element) -> None:
    """An sRGB colour becomes a linear one (IEC 61966-2-1)."""
    text = element.get("value", "").strip()
    if text.startswith("#"):
        encoded = np.array([int(text[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    else:
        encoded = np.array([float(part) for part in text.replace(",", " ").split()])
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    element.tag = "rgb"
    element.set("value", " ".join(f"{value:.8g}" for value in linear))


def _upgrade_texture(texture: ET.Element, old: bool) -> None:
    """Old uv scales and offsets mean ``uv * scale + offset``; a gamma of one means raw values."""
    values: dict[str, str] = {}
    for child in list(texture):
        name = _snake_case(child.get("name", ""))
        if name in ("uscale", "vscale", "uvscale", "uoffset", "voffset"):
            values[name] = child.get("value", "")
            texture.remove(child)
        elif name == "gamma" and old:
            texture.remove(child)
            if float(child.get("value", "-1")) == 1.0:
                texture.append(_property("boolean", "raw", "true"))
        elif name == "filter_type":
            child.set("value", FILTER_TYPES.get(child.get("value", ""), child.get("value", "")))
    if values:
        both = values.get("uvscale", "1")
        to_uv = ET.SubElement(texture, "transform", name="to_uv")
        ET.SubElement(to_uv, "scale", x=values.get("uscale", both), y=values.get("vscale", both))
        ET.SubElement(to_uv, "translate", x=values.get("uoffset", "0"), y=values.get("voffset", "0"))


def _upgrade_conductor(bsdf: ET.Element) -> None:
    """Old conductors are copper unless they say otherwise; new ones are perfect mirrors."""
    if not {_snake_case(child.get("name", "")) for child in bsdf} & {"eta", "k", "material"}:
        bsdf.append(_property("string", "material", "Cu"))


# --- Rendering ------------------------------------------------------------------------------------


@functools.cache
def usable_llvm() -> str | None:
    """Path of an LLVM library that Dr.Jit can use; one before version 17 aborts on some kernels."""
    patterns = ("/usr/lib/*/libLLVM*.so*", "/usr/lib/libLLVM*.so*", "/usr/lib/llvm-*/lib/libLLVM*.so*")
    mac = ("/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib", "/usr/local/opt/llvm*/lib/libLLVM*.dylib")
    named = os.environ.get("DRJIT_LIBLLVM_PATH")
    candidates = (
        [named] if named else [file for pattern in patterns + mac for file in sorted(glob.glob(pattern))]
    )
    return next((file for file in candidates if _llvm_major(file) >= 17), None)


def _llvm_major(file: str) -> int:
    if not _may_be_recent(file):
        return 0
    major, minor, patch = ctypes.c_uint(), ctypes.c_uint(), ctypes.c_uint()
    try:
        ctypes.CDLL(file).LLVMGetVersion(ctypes.byref(major), ctypes.byref(minor), ctypes.byref(patch))
    except (OSError, AttributeError):
        return 0
    return major.value


def _may_be_recent(file: str) -> bool:
    """Whether the file name does not already tell an old version: two LLVMs in one process clash."""
    match = re.search(r"libLLVM-(\d+)", Path(file).name)
    return match is None or int(match.group(1)) >= 17


def default_variant() -> str:
    """The fastest variant of the mitsuba package that runs here."""
    llvm = usable_llvm()
    if llvm is None:
        return "scalar_rgb"
    os.environ["DRJIT_LIBLLVM_PATH"] = llvm
    return "llvm_ad_rgb"


def load_with_mitsuba(path: Path, variant: str) -> object:
    """Loads an upgraded scene file; properties unknown to Mitsuba 3 are passed over."""
    import mitsuba as mi

    mi.set_variant(variant)
    mi.set_log_level(mi.LogLevel.Error)
    config = mi.parser.ParserConfig(variant)
    config.unused_properties = mi.LogLevel.Debug
    state = mi.parser.parse_file(config, str(path))
    mi.parser.transform_all(config, state)
    return mi.parser.instantiate(config, state)


def render_with_mitsuba(
    path: Path,
    *,
    spp: int,
    seed: int = 0,
    batches: int = 16,
    setup: Setup | None = None,
    variant: str | None = None,
) -> Estimate:
    """Renders a scene file of any age in `batches` independent parts of ``spp / batches`` samples each."""
    variant = variant or default_variant()
    with tempfile.TemporaryDirectory() as folder:
        scene = load_with_mitsuba(upgrade(path, Path(folder) / "scene.xml", setup or Setup()), variant)
    import mitsuba as mi

    film = scene.sensors()[0].film()  # type: ignore[attr-defined]
    images = []
    for batch in range(batches):
        mi.render(scene, spp=spp // batches, seed=seed + batch)
        images.append(np.array(film.bitmap(), dtype=np.float64)[..., :3])
    return Estimate(np.stack(images))


def render_with_lajolla(
    path: Path, *, spp: int, seed: int = 0, batches: int = 16, setup: Setup | None = None
) -> Estimate:
    """Renders the restated scene with lajolla, in as many independent parts."""
    import lajolla

    setup = setup or Setup()
    with tempfile.TemporaryDirectory() as folder:
        scene = lajolla.load(restate(path, Path(folder) / "scene.xml", setup), sampler=setup.sampler)
    count = os.cpu_count() or 1
    images = [
        np.asarray(scene.render(spp=spp // batches, seed=seed + batch, threads=count).array, dtype=np.float64)
        for batch in range(batches)
    ]
    return Estimate(np.stack(images))


# --- Statistics -----------------------------------------------------------------------------------


def differences(
    ours: Estimate, theirs: Estimate, *, block: int = 8, allowance: float = RELATIVE_ALLOWANCE
) -> list[str]:
    """What speaks against equal means, one line each; empty for renders that agree.

    Channel means must agree within three standard errors plus `allowance` of the mean. Block means are tested
    by Welch's t-test beyond the same allowance, at a family-wise error of `FAMILY_WISE_ERROR` (Bonferroni).
    """
    if ours.batches.shape[1:] != theirs.batches.shape[1:]:
        return [f"shapes differ: {ours.batches.shape[1:]} and {theirs.batches.shape[1:]}"]
    if not (np.isfinite(ours.batches).all() and np.isfinite(theirs.batches).all()):
        return ["an image holds values that are not finite"]
    return [
        *_channel_differences(ours, theirs, allowance),
        *_block_differences(ours, theirs, block, allowance),
    ]


def _channel_differences(ours: Estimate, theirs: Estimate, allowance: float) -> Iterator[str]:
    a, b = ours.batches.mean(axis=(1, 2)), theirs.batches.mean(axis=(1, 2))
    error = np.hypot(stats.sem(a), stats.sem(b))
    for channel in range(3):
        x, y = a[:, channel].mean(), b[:, channel].mean()
        if abs(x - y) > 3 * error[channel] + allowance * abs(y):
            yield (
                f"channel {'RGB'[channel]}: {x:.6g} instead of {y:.6g} "
                f"(ratio {x / y:.5f}, standard error {error[channel] / abs(y):.5f})"
            )


def _block_differences(ours: Estimate, theirs: Estimate, block: int, allowance: float) -> Iterator[str]:
    a, b = ours.blocks(block), theirs.blocks(block)
    va, vb = a.var(axis=0, ddof=1) / len(a), b.var(axis=0, ddof=1) / len(b)
    x, y = a.mean(axis=0), b.mean(axis=0)
    excess = np.maximum(np.abs(x - y) - allowance * np.abs(y), 0.0)
    # A noiseless block (a directly seen light) is exact up to single precision.
    variance = np.maximum(va + vb, (1e-6 * np.abs(y)) ** 2 + 1e-24)
    freedom = variance**2 / (
        np.maximum(va**2, 1e-60) / (len(a) - 1) + np.maximum(vb**2, 1e-60) / (len(b) - 1)
    )
    p_value = 2 * stats.t.sf(excess / np.sqrt(variance), np.minimum(freedom, len(a) + len(b) - 2))
    level = FAMILY_WISE_ERROR / p_value.size
    for row, column, channel in np.argwhere(p_value < level):
        at = (row, column, channel)
        yield (
            f"block ({column * block}, {row * block}) {'RGB'[channel]}: {x[at]:.6g} instead of {y[at]:.6g} "
            f"(p = {p_value[at]:.2g} < {level:.2g})"
        )
