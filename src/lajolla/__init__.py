"""lajolla, a physically based renderer.

import lajolla

scene = lajolla.load("scene.xml", spp=64)
image = scene.render(seed=1)
image.save("scene.exr")
"""

from __future__ import annotations

from contextlib import suppress

from lajolla import processor

TYPE_CHECKING = False  # as in `typing`, which takes long to load: an interrupt may come before it is heard
if TYPE_CHECKING:
    from typing import Any

    from lajolla import _core as _core
    from lajolla import catalog as catalog
    from lajolla import completion as completion
    from lajolla import film as film
    from lajolla import image as image
    from lajolla import render as render
    from lajolla import report as report
    from lajolla import scene as scene
    from lajolla import survey as survey
    from lajolla.image import Image, ImageError, ImageWarning
    from lajolla.messages import LajollaWarning
    from lajolla.render import OptionError, Progress, Rendering, Scene, load, load_dict
    from lajolla.scene import SceneError, SceneWarning

__all__ = [
    "Image",
    "ImageError",
    "ImageWarning",
    "LajollaWarning",
    "OptionError",
    "Progress",
    "Rendering",
    "Scene",
    "SceneError",
    "SceneWarning",
    "load",
    "load_dict",
]

# Modules and names are imported when they are first used: `lajolla --help` does without NumPy and the core.
_MODULES = ("_core", "catalog", "completion", "film", "image", "render", "report", "scene", "survey")
_HOMES = {
    **dict.fromkeys(("Image", "ImageError", "ImageWarning"), "image"),
    **dict.fromkeys(("OptionError", "Progress", "Rendering", "Scene", "load", "load_dict"), "render"),
    **dict.fromkeys(("SceneError", "SceneWarning"), "scene"),
    "LajollaWarning": "messages",
}

with suppress(processor.LevelError):  # who asks for the core is told, not who asks for help
    __path__ += processor.core_folders(__path__)


def __getattr__(name: str) -> Any:  # noqa: ANN401
    from importlib import import_module

    if name == "_core":
        processor.core_folders(__path__)  # raises LevelError where no build can be used
    if name in _MODULES:
        return import_module(f"lajolla.{name}")
    if name in _HOMES:
        return getattr(import_module(f"lajolla.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'lajolla' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULES, *_HOMES})
