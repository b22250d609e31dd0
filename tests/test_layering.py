"""The rooms of docs/architecture.md: what each folder of the core may include, and of the package import."""

import ast
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
# Third-party headers, and one that includes them, stay in one place.
KEPT_IN = {"embree3/": "accel/embree_scene.h", "embree4/": "accel/embree_scene.h"}
KEPT_IN |= {"accel/embree_scene.h": "accel/", "nanobind/": "python/", "zlib": "meshio/"}

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


# The rooms of the scene reader, and modules beside them, by what they may import.
MAY_IMPORT = {
    "scene/syntax": {"colour", "messages"},
    "scene/data": {"colour", "scene/syntax"},
    "scene/formats": {"_core", "colour", "messages", "picture_files", "scene/syntax"},
    "scene/schema": {"_core"},
    "scene/versions": {"scene/schema", "scene/syntax"},
    "scene/description": {
        *("_core", "colour", "film", "picture_files"),
        *("scene/data", "scene/formats", "scene/schema", "scene/syntax"),
    },
    "scene/editing": {
        *("_core", "scene/description", "scene/schema", "scene/syntax", "scene/versions"),
    },
    "scene/export": {
        *("_core", "picture_files"),
        *("scene/description", "scene/formats", "scene/schema", "scene/syntax"),
    },
}
# The viewer stands beside the command line, above the rest of the package.
VIEWER = {
    *("_core", "aovs", "arguments", "colour", "display", "holes", "image", "interrupts", "layers", "limits"),
    *("loaded_scene", "messages", "params", "picture_files", "render", "scene", "scene/schema", "tev"),
}
PACKAGE = CORE.parent / "src" / "lajolla"
MODULES = {
    ".".join(["lajolla", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}


def imported(module: str) -> set[str]:
    """The package's modules that one imports, anywhere in it, for type checkers too."""
    path = MODULES[module]
    package = module.split(".") if path.stem == "__init__" else module.split(".")[:-1]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            origin = ".".join([*base, *(node.module.split(".") if node.module else [])])
            names = {f"{origin}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES or name == "lajolla._core" else origin for name in names}
    return {name for name in found if name.split(".")[0] == "lajolla" and name != module}


def room_of(module: str) -> str:
    """The folder of a module in the scene reader; other modules are rooms of their own."""
    parts = module.split(".")[1:]
    return "/".join(parts[:2] if parts[:1] == ["scene"] else parts[:1])


def test_imports_point_downwards() -> None:
    rooms = {room_of(module) for module in MODULES if module.startswith("lajolla.scene.")}
    assert rooms == set(MAY_IMPORT)
    wrong = [
        f"{module} must not import {name}"
        for module in MODULES
        if (room := room_of(module)) in MAY_IMPORT
        for name in sorted(imported(module))
        if room_of(name) not in MAY_IMPORT[room] | {room}
    ]
    assert wrong == []


def test_the_viewer_is_at_the_top() -> None:
    inside = {module for module in MODULES if room_of(module) == "viewer"}
    assert {room_of(name) for module in inside for name in imported(module)} <= VIEWER | {"viewer"}
    above = {module for module in MODULES if imported(module) & inside} - inside
    assert above == {"lajolla.cli", "lajolla.render_command"}


def test_no_imports_go_in_a_circle() -> None:
    below: dict[str, set[str]] = {}
    left = {module: imported(module) & MODULES.keys() for module in MODULES}
    while free := {module for module, names in left.items() if names <= below.keys()}:
        below |= {module: left.pop(module) for module in free}
    assert sorted(left) == [], "these modules, or others that import them, import each other"


def test_the_version_of_a_file_is_asked_for_in_one_room() -> None:
    asking = {
        path.relative_to(PACKAGE).as_posix()
        for path in MODULES.values()
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and node.attr == "version"
    }
    assert asking == {"scene/syntax/expand.py", "scene/versions/upgrade.py"}
