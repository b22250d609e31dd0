"""No file whatsoever brings the mesh readers down: a mesh is read or a MeshError is raised."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from mesh_files import SAMPLES, SERIALIZED_SAMPLE, Loader, check, loader, serialized

from lajolla import _core


@pytest.fixture
def load(tmp_path: Path) -> Loader:
    return loader(tmp_path)


def mutated(data: bytes, random: np.random.Generator) -> bytes:
    """Some bytes overwritten, bits flipped, stretches copied elsewhere or cut out."""
    result = bytearray(data)
    for _ in range(random.integers(1, 6)):
        place, other = random.integers(len(result), size=2)
        length = random.integers(1, 12)
        match random.integers(5):
            case 0:
                result[place] = random.integers(256)
            case 1:
                result[place] ^= 1 << random.integers(8)
            case 2:
                result[place] = random.choice(list(b"0123456789-/. \n#e\\"))
            case 3:
                result[place : place + length] = result[other : other + length]
            case 4 if len(result) > 20:
                del result[place : place + length]
    return bytes(result)


def survives(load: Loader, kind: str, data: bytes, *arguments: int) -> bool:
    """True if the file was read, False if it was refused; anything else fails the test."""
    try:
        mesh = load(kind, data, *arguments)
    except _core.MeshError as error:
        assert str(error)
        return False
    check(mesh)
    return True


@pytest.mark.parametrize("sample", SAMPLES)
def test_truncated_files(load: Loader, sample: str) -> None:
    kind, data, arguments = SAMPLES[sample]
    for length in range(len(data)):
        survives(load, kind, data[:length], *arguments)


@pytest.mark.parametrize("sample", SAMPLES)
def test_mutated_files(load: Loader, sample: str) -> None:
    kind, data, arguments = SAMPLES[sample]
    random = np.random.default_rng(7)
    outcomes = [survives(load, kind, mutated(data, random), *arguments) for _ in range(2000)]
    assert not all(outcomes)


@pytest.mark.parametrize("version", [3, 4])
def test_mutated_serialized_data_with_a_correct_checksum(load: Loader, version: int) -> None:
    random = np.random.default_rng(8)
    outcomes = [
        survives(load, "serialized", serialized([mutated(payload, random)], version), 0)
        for payload, _ in itertools.product(SERIALIZED_SAMPLE, range(1000))
    ]
    assert not all(outcomes)
