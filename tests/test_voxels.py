"""Voxel files: .vol of all encodings, .nvdb and .vdb files that their own libraries wrote, and broken ones.

`volumes/grids.nvdb` was written by NanoVDB 32, what is in `volumes/openvdb.zip` by OpenVDB 10, with the
values that the functions below compute.
"""

from __future__ import annotations

import re
import shlex
import struct
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from statistics_tools import generator
from voxel_files import BOX, NANOVDB, first_grid, nvdb, vol

from lajolla.scene.formats.volumes import read_voxels
from lajolla.scene.formats.voxels import VoxelError


def write(folder: Path, data: bytes, name: str = "a.vol") -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("encoding, dtype", [(1, np.float32), (2, np.float16), (3, np.uint8)])
@pytest.mark.parametrize("channels", [1, 3, 6])
def test_vol_files_keep_their_type(tmp_path: Path, encoding: int, dtype: type, channels: int) -> None:
    array = (generator("vol").random((2, 3, 4, channels)) * 200).astype(dtype)
    voxels = read_voxels(write(tmp_path, vol(array, encoding)), "density")
    assert voxels.values.dtype == dtype
    np.testing.assert_array_equal(voxels.values, array)
    np.testing.assert_allclose(voxels.box @ (0, 0, 0, 1), [*BOX[:3], 1])
    np.testing.assert_allclose(voxels.box @ (1, 1, 1, 1), [*BOX[3:], 1])


ARRAY = np.ones((2, 3, 4, 1), np.float32)


@pytest.mark.parametrize(
    "data, message",
    [
        (b"", "not a .vol"),
        (b"VOL\3", "not a .vol"),
        (b"LOV" + vol(ARRAY)[3:], "not a .vol"),
        (vol(ARRAY, version=2), "version is 2"),
        (vol(ARRAY, 4), "encoding is 4"),
        (vol(ARRAY, -1), "encoding is -1"),
        (vol(ARRAY, cut=1), "cut short"),
        (vol(np.ones((2, 3, 4, 2), np.float32)), "2 channels"),
        (vol(ARRAY, box=(0, 0, 0, 1, 0, 1)), "is empty"),
        (vol(ARRAY, box=(0, 0, 0, 1, float("nan"), 1)), "is empty"),
        (struct.pack("<3sB5i6f", b"VOL", 3, 1, -4, -4, 4, 1, *BOX), "make no volume"),
        (struct.pack("<3sB5i6f", b"VOL", 3, 1, 2**31 - 1, 2**31 - 1, 2**31 - 1, 1, *BOX), "too many"),
        (struct.pack("<3sB5i6f", b"VOL", 3, 1, 1000, 1000, 1000, 1, *BOX), "cut short"),
    ],
)
def test_broken_vol_files_are_refused(tmp_path: Path, data: bytes, message: str) -> None:
    with pytest.raises(VoxelError, match=message):
        read_voxels(write(tmp_path, data), "density")


def indices(low: tuple[int, int, int], high: tuple[int, int, int]) -> tuple[np.ndarray, ...]:
    """x, y and z of the voxels from low to high, in the order of a volume's values."""
    z, y, x = np.meshgrid(
        *(np.arange(a, b + 1) for a, b in zip(low[::-1], high[::-1], strict=True)), indexing="ij"
    )
    return x, y, z


def pattern(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    return (x * 7 + y * 13 + z * 29) % 64 / 64


def test_nanovdb_floats_in_several_nodes() -> None:
    """Voxels on both sides of zero, where nodes meet; a third of them have the background's value."""
    voxels = read_voxels(NANOVDB, "density")
    x, y, z = indices((-9, 3, -2), (14, 11, 17))
    expected = np.where((x + y + z) % 3, pattern(x + 9, y, z + 2), 0)
    np.testing.assert_array_equal(voxels.values[..., 0], expected)


def test_nanovdb_boxes_are_around_the_voxels() -> None:
    box = read_voxels(NANOVDB, "density").box  # voxels of a quarter, the first of index space at (1, 2, 3)
    np.testing.assert_allclose(box @ (0, 0, 0, 1), [1 - 9.5 / 4, 2 + 2.5 / 4, 3 - 2.5 / 4, 1])
    np.testing.assert_allclose(box @ (1, 1, 1, 1), [1 + 14.5 / 4, 2 + 11.5 / 4, 3 + 17.5 / 4, 1])


def test_nanovdb_vectors() -> None:
    voxels = read_voxels(NANOVDB, "color")
    np.testing.assert_array_equal(voxels.values, np.stack(indices((-3, 0, 0), (8, 4, 6)), axis=-1))


@pytest.mark.parametrize("name, error", [("fp4", 1 / 30), ("fp8", 1 / 510), ("fp16", 1e-5), ("fpn", 1 / 250)])
def test_nanovdb_quantised_values(name: str, error: float) -> None:
    values = read_voxels(NANOVDB, name).values[..., 0]
    np.testing.assert_allclose(values, pattern(*indices((0, 0, 0), (19, 8, 8))), atol=error)


def test_nanovdb_grids_are_named() -> None:
    with pytest.raises(VoxelError, match='no grid "smoke", only color, density, double, fp16'):
        read_voxels(NANOVDB, "smoke")
    with pytest.raises(VoxelError, match="values are of type 2; float, "):
        read_voxels(NANOVDB, "double")


def test_nanovdb_without_compression(tmp_path: Path) -> None:
    meta, grid = first_grid()
    voxels = read_voxels(write(tmp_path, nvdb(meta, grid), "a.nvdb"), "of any name")
    np.testing.assert_array_equal(voxels.values, read_voxels(NANOVDB, "density").values)


def test_broken_nanovdb_files_are_refused(tmp_path: Path) -> None:
    """Cut anywhere, and with any field overwritten: a clear answer, or voxels, and never anything else."""
    meta, grid = first_grid()
    whole = nvdb(meta, grid)
    rng = generator("broken")
    variants = [whole[:n] for n in (0, 4, 15, 16, 100, 195, 250, 1000, len(whole) - 1)]
    variants += [nvdb(meta, grid, codec=c) for c in (1, 3, 77)] + [nvdb(meta, grid, size=2**60)]
    for field in (0, 296, 384, 528, 636, 672, 680, 688, 696, 736, 740, 748, 760, 764, 800, 808):
        for value in (0, 1, 0xFF):
            variants.append(nvdb(meta, grid[:field] + bytes([value]) * 8 + grid[field + 8 :]))
    for _ in range(40):
        at = int(rng.integers(len(grid)))
        variants.append(nvdb(meta, grid[:at] + rng.bytes(16) + grid[at + 16 :]))
    refused = 0
    for data in variants:
        try:
            read_voxels(write(tmp_path, data, "b.nvdb"), "density")
        except VoxelError as problem:
            assert str(problem)
            refused += 1
    assert refused > 25


def test_missing_modules_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, openvdb: Path) -> None:
    monkeypatch.setitem(sys.modules, "blosc", None)
    meta, _ = first_grid()
    command = f"to read it: {shlex.quote(sys.executable)} -m pip install blosc"
    for path in (write(tmp_path, nvdb(meta, bytes(16), codec=2), "c.nvdb"), openvdb / "blosc.vdb"):
        with pytest.raises(VoxelError, match=re.escape(command)):
            read_voxels(path, "density")


def test_blosc_chunks_are_put_together(tmp_path: Path) -> None:
    blosc = pytest.importorskip("blosc")
    meta, grid = first_grid()
    chunks = [blosc.compress(part, 1) for part in (grid[:5000], grid[5000:])]
    packed = b"".join(struct.pack("<Q", len(chunk)) + chunk for chunk in chunks)
    sizes = struct.pack("<QQ", len(grid), len(packed))
    data = struct.pack("<8sIHH", b"NanoVDB0", 0, 1, 2) + sizes + meta[16:] + packed
    voxels = read_voxels(write(tmp_path, data, "d.nvdb"), "density")
    np.testing.assert_array_equal(voxels.values, read_voxels(NANOVDB, "density").values)


@pytest.fixture(scope="module")
def openvdb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of OpenVDB files: grids.vdb (zlib, active values only), blosc.vdb, mask.vdb (no packing)."""
    folder = tmp_path_factory.mktemp("openvdb")
    zipfile.ZipFile(NANOVDB.with_name("openvdb.zip")).extractall(folder)
    return folder


@pytest.mark.parametrize(
    ("file", "grid"),
    [
        *(("grids.vdb", grid) for grid in ("density", "half", "double", "instance")),
        *((file, grid) for file in ("mask.vdb", "blosc.vdb") for grid in ("density", "half")),
    ],
)
def test_openvdb_floats_in_several_nodes(openvdb: Path, file: str, grid: str) -> None:
    """On both sides of zero, where nodes meet, however the values are kept."""
    if file == "blosc.vdb":
        pytest.importorskip("blosc")
    x, y, z = indices((-9, 3, -2), (14, 11, 17))
    expected = np.where((x + y + z) % 3, pattern(x + 9, y, z + 2), 0)
    np.testing.assert_array_equal(read_voxels(openvdb / file, grid).values[..., 0], expected)


def test_openvdb_vectors_and_whole_numbers(openvdb: Path) -> None:
    x, y, z = indices((-3, 0, 0), (8, 4, 6))
    filled = (x + y + z) % 3 > 0
    colours = np.where(filled[..., None], np.stack([x, y, z], axis=-1), 0)
    np.testing.assert_array_equal(read_voxels(openvdb / "grids.vdb", "color").values, colours)
    numbers = np.where(filled, x + 10 * y + 100 * z, 0)
    np.testing.assert_array_equal(read_voxels(openvdb / "grids.vdb", "int").values[..., 0], numbers)


def test_openvdb_regions_of_one_value(openvdb: Path) -> None:
    """Active and inactive ones, and a voxel that is another."""
    x, y, z = indices((8, 0, 0), (23, 7, 15))
    expected = np.where((x >= 16) & (z < 8), 3.0, 2.0)
    expected[(x == 9) & (y == 1) & (z == 1)] = 4
    np.testing.assert_array_equal(read_voxels(openvdb / "grids.vdb", "tiles").values[..., 0], expected)


def test_openvdb_inactive_values(openvdb: Path) -> None:
    """In one leaf all are stored, in the other a mask selects between two; a level set has both signs."""
    x, y, z = indices((0, 1, 0), (15, 7, 7))
    left = np.where((y == 1) & (z == 0), 9, 1)
    right = np.where((y == 7) & (z == 7), 7, np.where(y % 2, 5, 6))
    values = read_voxels(openvdb / "grids.vdb", "inactive").values[..., 0]
    np.testing.assert_array_equal(values, np.where(x < 8, left, right))
    x, y, z = indices((-4, -4, -4), (4, 4, 4))
    distance = np.clip(np.sqrt(x**2 + y**2 + z**2) - 3, -2, 2)
    np.testing.assert_allclose(
        read_voxels(openvdb / "grids.vdb", "level").values[..., 0], distance, atol=1e-5
    )


@pytest.mark.parametrize(
    ("grid", "low", "high"),
    [
        ("density", (1 - 9.5 / 4, 2 + 2.5 / 4, 3 - 2.5 / 4), (1 + 14.5 / 4, 2 + 11.5 / 4, 3 + 17.5 / 4)),
        ("color", (-3.5, -1, -1.5), (8.5, 9, 19.5)),  # scaled by 1, 2, 3
        ("double", (-9.5, 2.5, -2.5), (14.5, 11.5, 17.5)),
        ("instance", (-19, 5, -5), (29, 23, 35)),  # the tree of "density" at twice the size
        ("tiles", (1.125, 5.75, 2), (-0.875, 13.75, 34)),  # scaled by 1/2, 1/4, 2, turned, and moved
    ],
)
def test_openvdb_boxes(openvdb: Path, grid: str, low: tuple[float, ...], high: tuple[float, ...]) -> None:
    box = read_voxels(openvdb / "grids.vdb", grid).box
    np.testing.assert_allclose(box @ (0, 0, 0, 1), [*low, 1], atol=1e-12)
    np.testing.assert_allclose(box @ (1, 1, 1, 1), [*high, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("grid", "message"),
    [
        ("smoke", 'no grid "smoke", only bool, color, density, '),
        ("empty", "no active voxels"),
        ("bool", 'its grid is a "Tree_bool_5_4_3"; supported are trees of float, '),
        ("frustum", 'its transform is a "NonlinearFrustumMap"; only linear ones are supported'),
    ],
)
def test_openvdb_grids_that_are_no_volumes(openvdb: Path, grid: str, message: str) -> None:
    with pytest.raises(VoxelError, match=message):
        read_voxels(openvdb / "grids.vdb", grid)


def test_broken_openvdb_files_are_refused(openvdb: Path, tmp_path: Path) -> None:
    """Cut anywhere, and with any bytes overwritten: a clear answer, or voxels, and never anything else."""
    whole = (openvdb / "grids.vdb").read_bytes()
    rng = generator("broken vdb")
    variants = [whole[:n] for n in (0, 7, 8, 20, 21, 60, 200, 5000, len(whole) // 2)]
    variants.append(whole[:8] + struct.pack("<I", 220) + whole[12:])
    for _ in range(60):
        at = int(rng.integers(20_000) if rng.random() < 0.7 else rng.integers(300))
        variants.append(whole[:at] + rng.bytes(8) + whole[at + 8 :])
    refused = 0
    for data in variants:
        try:
            read_voxels(write(tmp_path, data, "b.vdb"), "density")
        except VoxelError as problem:
            assert str(problem)
            refused += 1
    assert refused > 25
