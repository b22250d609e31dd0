"""Layers of a picture that are no means of samples: numbers of objects, and Cryptomattes."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lajolla.aovs import RANKS, VARIANCE
from lajolla.colour import FloatImage

IdImage = NDArray[np.int32]


class Layer(Protocol):
    """A layer of a picture: what it is in files."""

    def channels(self, name: str) -> dict[str, FloatImage]:
        """Channels of an EXR file, (height, width) each."""

    def metadata(self, name: str) -> dict[str, str]:
        """Attributes of an EXR file."""

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Arrays of an NPZ file."""


NO_LAYERS: Mapping[str, Layer] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Ids:
    """Numbers of what the rays through pixel centres see: `values`, int32 (height, width).

    `names[number]` is the name of an object; primitives have none.
    """

    values: IdImage
    names: Sequence[str] = ()

    def channels(self, name: str) -> dict[str, FloatImage]:
        return {f"{name}.I": self.values.astype(np.float32)}

    def metadata(self, name: str) -> dict[str, str]:
        return {}

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        names = {f"{name}_names": np.array(self.names)} if self.names else {}
        return {name: self.values, **names}


@dataclass(frozen=True, eq=False)
class Cryptomatte:
    """The objects that cover each pixel most, in falling order of coverage.

    `numbers` is int32 (height, width, RANKS), 0 for none, `coverage` float32 of the same shape; the name of
    an object is `names[number]`. Files follow the Cryptomatte specification, version 1.2 (Psyop 2018).
    """

    numbers: IdImage
    coverage: FloatImage
    names: Sequence[str]

    def channels(self, name: str) -> dict[str, FloatImage]:
        """Layers NAME00, NAME01, ... of two ids and their coverages each: r, g and b, a."""
        hashed = np.zeros(len(self.names), np.float32)
        for number in self._seen():
            hashed[number] = np.uint32(name_hash(self.names[number])).view(np.float32)
        ids = hashed[self.numbers]
        result = {}
        for rank in range(RANKS):
            layer, letters = f"{name}{rank // 2:02d}", "rg" if rank % 2 == 0 else "ba"
            result[f"{layer}.{letters[0]}"] = ids[..., rank]
            result[f"{layer}.{letters[1]}"] = self.coverage[..., rank]
        return result

    def metadata(self, name: str) -> dict[str, str]:
        """The manifest lists the names that are in the picture."""
        manifest = {self.names[number]: f"{name_hash(self.names[number]):08x}" for number in self._seen()}
        key = f"cryptomatte/{name_hash(name):08x}"[: len("cryptomatte/") + 7]
        return {
            f"{key}/name": name,
            f"{key}/hash": "MurmurHash3_32",
            f"{key}/conversion": "uint32_to_float32",
            f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
        }

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        return {
            name: self.numbers,
            f"{name}_coverage": self.coverage,
            f"{name}_names": np.array(self.names),
        }

    def _seen(self) -> list[int]:
        return [number for number in np.unique(self.numbers).tolist() if number > 0]


@dataclass(frozen=True)
class StoredCryptomatte:
    """A Cryptomatte of a file, by any program, which stays as it is: its channels and attributes by name."""

    stored: Mapping[str, FloatImage]
    attributes: Mapping[str, str]

    def channels(self, name: str) -> dict[str, FloatImage]:
        return dict(self.stored)

    def metadata(self, name: str) -> dict[str, str]:
        return dict(self.attributes)

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """The channels of each layer together, (height, width, number of channels)."""
        names = dict.fromkeys(channel.rpartition(".")[0] for channel in self.stored)
        return {
            layer: np.dstack([v for k, v in self.stored.items() if k.rpartition(".")[0] == layer])
            for layer in names
        }


def stored_cryptomattes(
    channels: Mapping[str, FloatImage], attributes: Mapping[str, str]
) -> dict[str, StoredCryptomatte]:
    """The Cryptomattes of a file by their names; those that have no channels are left out."""
    result = {}
    for attribute, name in attributes.items():
        key, _, field = attribute.rpartition("/")
        part = re.compile(re.escape(name) + r"\d\d\.\w+")
        own = {channel: values for channel, values in channels.items() if part.fullmatch(channel)}
        if field == "name" and key.startswith("cryptomatte/") and own:
            told = {k: v for k, v in attributes.items() if k.startswith(f"{key}/")}
            result[name] = StoredCryptomatte(own, told)
    return result


def name_hash(name: str) -> int:
    """The 32 bits of the float that stands for a name: no NaN, infinity or denormal number."""
    bits = murmur_hash(name.encode("utf-8", "surrogateescape"))
    return bits ^ (1 << 23) if bits >> 23 & 255 in (0, 255) else bits


def murmur_hash(data: bytes) -> int:
    """MurmurHash3_x86_32 with the seed 0 (Appleby 2011)."""

    def mixed(block: int) -> int:
        block = block * 0xCC9E2D51 & 0xFFFFFFFF
        return _rotated(block, 15) * 0x1B873593 & 0xFFFFFFFF

    result, whole = 0, len(data) & ~3
    for at in range(0, whole, 4):
        result ^= mixed(int.from_bytes(data[at : at + 4], "little"))
        result = (_rotated(result, 13) * 5 + 0xE6546B64) & 0xFFFFFFFF
    result ^= mixed(int.from_bytes(data[whole:], "little")) ^ len(data)
    for factor, shift in ((0x85EBCA6B, 16), (0xC2B2AE35, 13)):
        result = (result ^ result >> shift) * factor & 0xFFFFFFFF
    return result ^ result >> 16


def _rotated(bits: int, by: int) -> int:
    return (bits << by | bits >> (32 - by)) & 0xFFFFFFFF


# What the core renders beside alpha in scenes with shadow catchers: how much of a pixel they cover, and the
# light on them with all objects and without.
SHADOWS = (".catcher", ".shadowed", ".unshadowed")


def shown(labels: Sequence[str]) -> list[str]:
    """The labels of channels that pictures have."""
    return [label for label in labels if not label.endswith(SHADOWS)]


def has_shadows(labels: Sequence[str]) -> bool:
    """Whether a render with these channels is one of shadow catchers, with alpha."""
    return any(label.endswith(SHADOWS) for label in labels)


def with_shadows(values: FloatImage, labels: Sequence[str]) -> tuple[FloatImage, list[str]]:
    """The means of a render with the shadows on catchers in alpha, and the labels of its channels.

    Alpha is 1 - (light with all objects) / (light without them), times how much of the pixel catchers cover.

    Args:
        values: (height, width, 3 + number of labels).
        labels: of the channels behind the first three; those of `SHADOWS` come last.
    """
    kept = shown(labels)
    if len(kept) == len(labels):
        return values, kept
    result = values[..., : 3 + len(kept)].copy()
    for index, label in enumerate(kept):
        if label + SHADOWS[0] in labels:
            covered, lit, unlit = (values[..., 3 + labels.index(label + name)] for name in SHADOWS)
            left = np.divide(lit, unlit, out=np.ones_like(lit), where=unlit > 0)
            result[..., 3 + index] += covered * (1 - np.clip(left, 0, 1))
    return result, kept


def named_channels(
    values: FloatImage, labels: Sequence[str], counts: NDArray[np.uint32]
) -> dict[str, FloatImage]:
    """The channels beside red, green and blue of a render, by name.

    Args:
        values: the means of the samples, (height, width, 3 + number of labels).
        labels: of the channels behind the first three.
        counts: numbers of samples, (height, width).
    """
    values, labels = with_shadows(values, labels)
    channels = {label: values[..., 3 + index] for index, label in enumerate(labels)}
    for index, letter in enumerate("RGB"):
        label = f"{VARIANCE}.{letter}"
        if label in channels:
            channels[label] = _variance_of_mean(values[..., index], channels[label], counts)
    return channels


def _variance_of_mean(mean: FloatImage, mean_square: FloatImage, counts: NDArray[np.uint32]) -> FloatImage:
    """The unbiased estimate from the means of samples and of their squares; infinite for one sample.

    All arrays have the same shape; `counts` has the numbers of samples.
    """
    difference = mean_square.astype(np.float64) - mean.astype(np.float64) ** 2
    variance = np.maximum(difference, 0) / np.maximum(counts.astype(np.float64) - 1, 1)
    return np.where(counts > 1, variance, np.inf).astype(np.float32)
