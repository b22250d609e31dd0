"""What the translation of one plugin may ask of that of the scene."""

from __future__ import annotations

from typing import Protocol

from ..description.builder import Builder
from ..description.instances import Contents
from ..description.plugin import Entry
from ..formats.images import Pixels
from ..syntax.nodes import Node


class Translation(Protocol):
    """The translation of a scene, as far as plugins know it."""

    builder: Builder
    groups: dict[Node, Contents[Node]]

    def entry(self, node: Node) -> Entry:
        """The entry of the description that was made of a node, as it was read."""

    def shapes(self, node: Node) -> list[Node]:
        """What is written for a shape."""

    def nearest(self, node: Node) -> Node | None:
        """What comes nearest to a plugin that Mitsuba 3 does not have."""

    def replaced(self, node: Node, used: str) -> None:
        """Notes what is written for an object whose plugin Mitsuba 3 does not have."""

    def lose(self, *names: str) -> None:
        """Notes properties of the object that is being translated which Mitsuba 3 does not have."""

    def warn(self, node: Node, message: str) -> None:
        """Reports something that is not written as it was read."""

    def linear_image(self, node: Node, gamma: float, channel: str) -> str:
        """Packs a bitmap's pixels as linear floating-point numbers; the name of the file."""

    def pack(self, ending: str, content: bytes | Pixels) -> str:
        """Adds a file to those that are written beside the scene; its name."""
