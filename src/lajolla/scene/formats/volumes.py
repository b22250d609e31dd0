"""Which reader a volume's file needs."""

from __future__ import annotations

import struct
from pathlib import Path

from .nanovdb import read_nvdb
from .openvdb import read_vdb
from .voxels import VoxelError, Voxels, read_vol


def read_voxels(path: Path, grid_name: str) -> Voxels:
    """Reads a volume by the ending of its name.

    Args:
        path: a .vol, .nvdb or .vdb file.
        grid_name: which of the grids of a .nvdb or .vdb file.

    Raises:
        VoxelError: the file cannot be read as that.
    """
    ending = path.suffix.lower()
    try:
        if ending == ".nvdb":
            return read_nvdb(path, grid_name)
        if ending == ".vdb":
            return read_vdb(path, grid_name)
        return read_vol(path)
    except (OSError, MemoryError, struct.error, OverflowError) as problem:
        raise VoxelError(str(problem) or "it does not fit into memory") from None
