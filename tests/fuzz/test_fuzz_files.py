"""Files with mistakes, of every format that scenes name: a picture, or one message."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from answers import outcome, search
from file_formats import Format, edited, formats, mistakes
from hypothesis import strategies as st

import lajolla

CORPUS = Path(__file__).parent / "corpus"
NAMES = ("obj", "mtl", "ply", "serialized", "curves", "hair", "vol", "nvdb", "vdb", "ptx", "tensors",
         "spectrum", "exr", "hdr", "pfm", "png", "jpg")  # fmt: skip


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Format]]:
    """A folder, and the formats whose scenes find in it what else they need."""
    folder = tmp_path_factory.mktemp("fuzz")
    return folder, formats(folder)


def answer(folder: Path, form: Format, use: int, data: bytes) -> str:
    """What becomes of a scene that needs a file of these bytes, in one of the ways there are."""
    path = folder / f"broken{form.ending}"
    path.unlink(missing_ok=True)  # much faster than writing over the file
    path.write_bytes(data)
    if form.beside:
        (folder / "beside.obj").write_bytes(form.beside)
    scene = form.uses[use % len(form.uses)](path.name)
    return outcome(partial(lajolla.load_dict, scene, base_path=folder))


@pytest.mark.parametrize("name", NAMES)
def test_right_files_are_read(name: str, known: tuple[Path, dict[str, Format]]) -> None:
    folder, by_name = known
    form = by_name[name]
    assert set(by_name) == set(NAMES)
    told = [answer(folder, form, use, data) for data in form.samples for use in range(len(form.uses))]
    assert name == "vdb" or "picture" in told, told


@pytest.mark.parametrize("name", NAMES)
def test_broken_files(name: str, known: tuple[Path, dict[str, Format]], fuzz_minutes: float | None) -> None:
    folder, by_name = known
    form = by_name[name]

    def check(sample: bytes, use: int, edits: list[tuple[str, int, int, bytes]]) -> None:
        answer(folder, form, use, edited(sample, edits))

    search(
        check, 30 if name == "nvdb" else 125, fuzz_minutes,
        sample=st.sampled_from(form.samples), use=st.integers(0, 3), edits=mistakes(),
    )  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_faults_of_the_past(name: str, known: tuple[Path, dict[str, Format]]) -> None:
    folder, by_name = known
    for path in sorted((CORPUS / name).glob("*")):
        for use in range(len(by_name[name].uses)):
            answer(folder, by_name[name], use, path.read_bytes())
