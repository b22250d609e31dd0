"""The figures of the book: what docs/book/figures.toml declares."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lajolla.messages import suggestion

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DOCS = Path(__file__).resolve().parent.parent
DECLARATIONS = DOCS / "book" / "figures.toml"
KEYS = {"figure": ("size", "panels", "by_name"), "panel": ("label", "command", "commands", "file")}


class FigureError(Exception):
    """A mistake in figures.toml, or in the name of a figure."""


@dataclass(frozen=True)
class Panel:
    """One picture of a figure.

    Attributes:
        name: of the figure, and the number of the panel, from 1.
        label: the words below the picture.
        commands: of `lajolla`. {name} stands for the name of the panel.
        size: width and height, in pixels.
        file: the picture, relative to docs/.
    """

    name: str
    label: str
    commands: tuple[str, ...]
    size: tuple[int, int]
    file: Path

    def shown(self) -> Iterator[str]:
        """The commands as a reader types them."""
        for command in self._completed():
            yield f"./lajolla {command.replace('{name}', self.name)}"

    def words(self, folder: Path) -> Iterator[list[str]]:
        """The words of the commands, with their files in a folder."""
        for command in self._completed():
            yield [word.replace("{name}", str(folder / self.name)) for word in shlex.split(command)]

    def _completed(self) -> Iterator[str]:
        """The commands with the size of the picture, and with its name in the last one."""
        for command in self.commands:
            words = shlex.split(command)
            if words[0] == "render" and "--size" not in words:
                command += f" --size {self.size[0]}x{self.size[1]}"
            if len(self.commands) == 1 and "{name}" not in command:
                command += " -o {name}.png"
            yield command


@dataclass(frozen=True)
class Figure:
    """Pictures that are shown side by side; `by_name`: rendered only if they are named."""

    name: str
    panels: tuple[Panel, ...]
    by_name: bool


def read_figures(path: Path = DECLARATIONS) -> dict[str, Figure]:
    """The figures by their names. Raises FigureError."""
    try:
        declared = tomllib.loads(path.read_text())
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise FigureError(f"{path}: {error}") from error
    try:
        return {name: _figure(name, table) for name, table in declared.items()}
    except FigureError as error:
        raise FigureError(f"{path}: {error}") from error


def find(figures: Mapping[str, Figure], name: str) -> Figure:
    """The figure of a name. Raises FigureError with the nearest name."""
    if name not in figures:
        raise FigureError(f"unknown figure {name!r}{suggestion(name, figures)}")
    return figures[name]


def _figure(name: str, table: object) -> Figure:
    where = f"figure {name!r}"
    if not isinstance(table, dict):
        raise FigureError(f"{where} is not a table")
    _check_keys(where, table, "figure")
    size = re.fullmatch(r"(\d+)x(\d+)", str(table.get("size")))
    if size is None:
        raise FigureError(f'{where}: size must be like "480x320"')
    panels = table.get("panels")
    if not isinstance(panels, list) or not panels:
        raise FigureError(f"{where} has no panels")
    pixels = (int(size[1]), int(size[2]))
    made = tuple(_panel(f"{name}-{number}", panel, pixels) for number, panel in enumerate(panels, 1))
    return Figure(name, made, bool(table.get("by_name", False)))


def _panel(name: str, table: dict[str, Any], size: tuple[int, int]) -> Panel:
    where = f"panel {name!r}"
    _check_keys(where, table, "panel")
    if ("command" in table) == ("commands" in table):
        raise FigureError(f'{where} needs either "command" or "commands"')
    commands = tuple(table.get("commands", [table.get("command")]))
    if not commands or not all(isinstance(command, str) and command.strip() for command in commands):
        raise FigureError(f"{where}: a command is a text such as 'render scene.xml'")
    if len(commands) > 1 and "{name}.png" not in commands[-1]:
        raise FigureError(f"{where}: the last command must write {{name}}.png")
    if not isinstance(table.get("label"), str):
        raise FigureError(f"{where} has no label")
    file = Path(table.get("file", f"images/book/{name}.jpg"))
    return Panel(name, table["label"], commands, size, file)


def _check_keys(where: str, table: Mapping[str, Any], kind: str) -> None:
    for key in table:
        if key not in KEYS[kind]:
            raise FigureError(f"{where}: unknown key {key!r}{suggestion(key, KEYS[kind])}")
