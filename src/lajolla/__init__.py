"""lajolla, a physically based renderer.

import lajolla

scene = lajolla.load("scene.xml", spp=64)
image = scene.render(seed=1)
image.save("scene.exr")
"""

from lajolla.image import Image, ImageError, ImageWarning
from lajolla.render import OptionError, Progress, Rendering, Scene, load, load_dict
from lajolla.scene import SceneError

__all__ = [
    "Image",
    "ImageError",
    "ImageWarning",
    "OptionError",
    "Progress",
    "Rendering",
    "Scene",
    "SceneError",
    "load",
    "load_dict",
]
