"""Files of named tensors, in which the RGL distributes measured materials (.bsdf), as NumPy arrays."""

from __future__ import annotations

import math
import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..syntax.files import file_bytes

IDENTIFIER = b"tensor_file\0"
VERSION = b"\1\0"
# By their number in files; the first is unused.
TYPES = (None, *(np.dtype(name) for name in "u1 i1 <u2 <i2 <u4 <i4 <u8 <i8 <f2 <f4 <f8".split()))
LONGEST = 32  # fields, and dimensions of one: as many as every NumPy can have


class TensorError(ValueError):
    """A file that does not hold the tensors that are asked for."""


def read_tensors(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    """Reads all tensors of a file.

    Raises:
        TensorError: the file is no tensor file, is cut short, or cannot be read.
    """
    try:
        data = file_bytes(path)
        return _tensors(data)
    except struct.error:
        raise TensorError("it is cut short") from None
    except (OSError, MemoryError) as problem:
        raise TensorError(str(problem) or "it does not fit into memory") from None


def _tensors(data: bytes) -> dict[str, npt.NDArray[np.generic]]:
    start = len(IDENTIFIER) + len(VERSION)
    if not data.startswith(IDENTIFIER):
        raise TensorError("it is not a tensor file")
    if data[len(IDENTIFIER) : start] != VERSION:
        raise TensorError("its version is not 1.0")
    (count,) = struct.unpack_from("<I", data, start)
    if count > LONGEST:
        raise TensorError(f"it claims to have {count} fields")
    at = start + 4
    tensors = {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", data, at)
        name = data[at + 2 : at + 2 + length].decode("utf-8", "replace")
        dimensions, kind, offset = struct.unpack_from("<HBQ", data, at + 2 + length)
        at += 2 + length + 11
        if dimensions > LONGEST:
            raise TensorError(f'"{name}" claims to have {dimensions} dimensions')
        shape = struct.unpack_from(f"<{dimensions}Q", data, at)
        at += 8 * dimensions
        tensors[name] = _tensor(data, name, kind, offset, shape)
    return tensors


def _tensor(
    data: bytes, name: str, kind: int, offset: int, shape: tuple[int, ...]
) -> npt.NDArray[np.generic]:
    dtype = TYPES[kind] if kind < len(TYPES) else None
    if dtype is None:
        raise TensorError(f'"{name}" is of the unknown type {kind}')
    if 0 in shape:
        raise TensorError(f'"{name}" is empty')
    count = math.prod(shape)
    if offset + count * dtype.itemsize > len(data):
        raise TensorError(f'it is cut short: "{name}" is not all there')
    return np.frombuffer(data, dtype, count, offset).reshape(shape)
