"""The outputs of integrators: the picture and named channels."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from lajolla.film import Film

MOST_CHANNELS = 1024
COMPONENTS = {"rgb": "RGB", "xyz": "XYZ"}

Entry = dict[str, Any]  # an integrator of the core


@dataclass(frozen=True)
class Channel:
    """A channel beside red, green and blue: a component of an integrator's result, or alpha."""

    label: str
    entry: Entry
    recorded: str = "rgb"  # or "xyz", "alpha", "one"
    component: int = 0
    squared: bool = False

    def within(self, name: str) -> Channel:
        """The same channel as part of a larger output."""
        return replace(self, label=f"{name}.{self.label}")


@dataclass(frozen=True)
class Picture:
    """The integrator whose radiance is the picture, and the channels beside it."""

    entry: Entry
    channels: tuple[Channel, ...] = ()

    def __post_init__(self) -> None:
        """Raises ValueError if there are too many channels: nested integrators double them."""
        if len(self.channels) > MOST_CHANNELS:
            raise ValueError(f"more than {MOST_CHANNELS} channels")


@dataclass(frozen=True)
class Layer:
    """What a film of Mitsuba 0.6 says of one integrator inside `multichannel`."""

    name: str
    film: Film


def colours(name: str, entry: Entry, recorded: str = "rgb") -> tuple[Channel, ...]:
    """Three channels: `name.R` and so on."""
    letters = COMPONENTS[recorded]
    return tuple(Channel(f"{name}.{letter}", entry, recorded, i) for i, letter in enumerate(letters))


def description_of(picture: Picture, *, alpha: bool) -> dict[str, Any]:
    """The part of a description that defines what is rendered; every integrator in it runs once per sample.

    Args:
        picture: what is wanted.
        alpha: whether the film has an alpha channel.
    """
    own = (Channel("A", picture.entry, "alpha"),) if alpha else ()
    entries = [picture.entry]
    channels = []
    for channel in (*own, *picture.channels):
        if channel.entry not in entries:
            entries.append(channel.entry)
        channels.append(
            {
                "label": channel.label,
                "source": entries.index(channel.entry),
                "recorded": channel.recorded,
                "component": channel.component,
                "squared": channel.squared,
            }
        )
    result: dict[str, Any] = {"integrator": picture.entry}
    if channels:
        result |= {"other_integrators": entries[1:], "channels": channels}
    return result


def repeated(labels: Iterable[str]) -> str | None:
    """A label that is used twice."""
    seen: set[str] = set()
    for label in labels:
        if label in seen:
            return label
        seen.add(label)
    return None
