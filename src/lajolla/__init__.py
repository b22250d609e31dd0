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
    from lajolla import checkpoint as checkpoint
    from lajolla import comparison as comparison
    from lajolla import completion as completion
    from lajolla import denoising as denoising
    from lajolla import film as film
    from lajolla import image as image
    from lajolla import outputs as outputs
    from lajolla import picture_formats as picture_formats
    from lajolla import render as render
    from lajolla import report as report
    from lajolla import scene as scene
    from lajolla import series as series
    from lajolla import survey as survey
    from lajolla import tev as tev
    from lajolla import whole_files as whole_files
    from lajolla.denoising import DenoiseError
    from lajolla.image import Image
    from lajolla.limits import OptionError
    from lajolla.loaded_scene import Scene
    from lajolla.loading import load, load_dict
    from lajolla.messages import ClusterError, ClusterWarning, Error, LajollaWarning
    from lajolla.models import Bsdf, BsdfSamples, Light, LightSamples, Phase
    from lajolla.params import ParamError
    from lajolla.picture_files import ImageError, ImageWarning
    from lajolla.queries import Intersections
    from lajolla.render import Progress, Rendering
    from lajolla.scene import SceneError, SceneWarning
    from lajolla.transforms import look_at, rotate, scale, translate

    __version__: str

__all__ = [
    "Bsdf",
    "BsdfSamples",
    "ClusterError",
    "ClusterWarning",
    "DenoiseError",
    "Error",
    "Image",
    "ImageError",
    "ImageWarning",
    "Intersections",
    "LajollaWarning",
    "Light",
    "LightSamples",
    "OptionError",
    "ParamError",
    "Phase",
    "Progress",
    "Rendering",
    "Scene",
    "SceneError",
    "SceneWarning",
    "load",
    "load_dict",
    "look_at",
    "rotate",
    "scale",
    "translate",
]

# Modules and names are imported when they are first used: `lajolla --help` does without NumPy and the core.
_MODULES = tuple(
    "_core catalog checkpoint comparison completion denoising film image outputs picture_formats render "
    "report scene series survey tev whole_files".split()
)
_HOMES = {
    "DenoiseError": "denoising",
    "Image": "image",
    **dict.fromkeys(("ImageError", "ImageWarning"), "picture_files"),
    "Intersections": "queries",
    "OptionError": "limits",
    **dict.fromkeys(("Bsdf", "BsdfSamples", "Light", "LightSamples", "Phase"), "models"),
    **dict.fromkeys(("Progress", "Rendering"), "render"),
    "Scene": "loaded_scene",
    **dict.fromkeys(("load", "load_dict"), "loading"),
    "ParamError": "params",
    **dict.fromkeys(("SceneError", "SceneWarning"), "scene"),
    **dict.fromkeys(("look_at", "rotate", "scale", "translate"), "transforms"),
    **dict.fromkeys(("ClusterError", "ClusterWarning", "Error", "LajollaWarning"), "messages"),
}

with suppress(processor.LevelError):  # an error when the core is used, not for --help
    __path__ += processor.core_folders(__path__)


def __getattr__(name: str) -> Any:  # noqa: ANN401
    from importlib import import_module

    if name == "_core":
        processor.core_folders(__path__)  # raises LevelError where no build can be used
    if name in _MODULES:
        return import_module(f"lajolla.{name}")
    if name == "__version__":
        from importlib.metadata import version  # takes long

        return version("lajolla")
    if name in _HOMES:
        return getattr(import_module(f"lajolla.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'lajolla' has no attribute {name!r}")


def __dir__() -> list[str]:
    hidden = (name for name in globals() if name.startswith("__"))
    return sorted({*hidden, *__all__, "__version__"})
