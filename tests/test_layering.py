"""The rooms of docs/architecture.md: what each folder of the core may include."""

import re
from pathlib import Path

import pytest

SCENE = set("base scatter images geometry textures materials lights sensors media accel scene".split())
MAY_INCLUDE = {
    "base": {"base"},
    "scatter": {"base", "scatter"},
    "images": {"base", "images"},
    "geometry": {"base", "images", "geometry"},
    "textures": {"base", "images", "geometry", "textures"},
    "materials": {"base", "scatter", "images", "geometry", "textures", "materials"},
    "lights": {"base", "images", "geometry", "textures", "lights"},
    "sensors": {"base", "geometry", "sensors"},
    "media": {"base", "scatter", "images", "geometry", "media"},
    "accel": {"base", "geometry", "accel"},
    "scene": SCENE,
    "transport": {*SCENE, "transport"},
    "meshio": {"base", "meshio"},
    "engine": {*SCENE, "transport", "meshio", "engine"},
    "python": {*SCENE, "transport", "meshio", "engine", "python"},
}
# Third-party headers that stay in one place.
KEPT_IN = {"embree3/": "accel/accel", "embree4/": "accel/accel", "nanobind/": "python/", "zlib": "meshio/"}

CORE = Path(__file__).resolve().parent.parent / "core"
SOURCES = sorted(path for path in CORE.rglob("*") if path.suffix in {".h", ".cpp"})


def test_every_folder_is_known() -> None:
    assert {path.relative_to(CORE).parts[0] for path in SOURCES} <= set(MAY_INCLUDE)


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: str(path.relative_to(CORE)))
def test_includes_point_downwards(source: Path) -> None:
    here = source.relative_to(CORE).as_posix()
    text = source.read_text()
    for included in re.findall(r'^\s*#\s*include\s+"([^"]+)"', text, re.MULTILINE):
        assert (CORE / included).is_file(), f'{here}: "{included}" is not a path below core/'
        assert included.split("/")[0] in MAY_INCLUDE[here.split("/")[0]], (
            f'{here} must not include "{included}"'
        )
    for included in re.findall(r"^\s*#\s*include\s+<([^>]+)>", text, re.MULTILINE):
        for header, home in KEPT_IN.items():
            assert not included.startswith(header) or here.startswith(home), (
                f"{here} must not include <{included}>"
            )
