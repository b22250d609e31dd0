"""`lajolla completion`: scripts that complete commands, options and their values in a shell."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import shtab

from lajolla.arguments import build_parser
from lajolla.catalog import catalog
from lajolla.picture_formats import ENDINGS


def script(shell: str) -> str:
    """The script for a shell, to be run or kept where the shell looks for it."""
    parser, commands = build_parser()
    plugins = catalog()
    known: dict[str, Sequence[str]] = {
        "kind": list(plugins),
        "name": sorted({name for models in plugins.values() for name in models}),
        "integrator": sorted(plugins["integrator"]),
        "format": [ending.removeprefix(".") for ending in ENDINGS],
    }
    for command in commands.values():
        for action in command._actions:
            _complete(action, known)
    return shtab.complete(parser, shell)


def _complete(action: argparse.Action, known: dict[str, Sequence[str]]) -> None:
    if action.type is Path:
        action.complete = shtab.FILE
    elif action.dest in known and not action.choices:
        action.choices = list(known[action.dest])
