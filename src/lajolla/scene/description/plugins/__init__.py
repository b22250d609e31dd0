"""Plugins of scene files that the core does not have in the same form."""

from ..plugin import Plugin
from . import (
    adapters,
    bsdfs,
    colours,
    curves,
    daylight,
    disney,
    emitters,
    films,
    grids,
    integrators,
    measured,
    media,
    meshes,
    sensors,
    shapes,
    textures,
    volumes,
)

READER_PLUGINS: tuple[Plugin, ...] = (
    *bsdfs.PLUGINS,
    *disney.PLUGINS,
    *measured.PLUGINS,
    *adapters.PLUGINS,
    *colours.PLUGINS,
    *textures.PLUGINS,
    *emitters.PLUGINS,
    *daylight.PLUGINS,
    *meshes.PLUGINS,
    *shapes.PLUGINS,
    *curves.PLUGINS,
    *grids.PLUGINS,
    *sensors.PLUGINS,
    *films.PLUGINS,
    *integrators.PLUGINS,
    *media.PLUGINS,
    *volumes.PLUGINS,
)
