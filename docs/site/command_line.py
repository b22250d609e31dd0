"""The reference of the command line, from its parsers."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

from lajolla.arguments import build_parser


def page() -> str:
    """The page of all commands."""
    _, commands = build_parser()
    parts = [
        "# Command line",
        "In a checkout, `lajolla` is `./lajolla`. `lajolla COMMAND --help` prints the same.",
    ]
    for name, parser in commands.items():
        parts += _command(name, parser)
    return "\n\n".join(parts) + "\n"


def text(words: str) -> str:
    """Words that have no meaning for Markdown."""
    return re.sub(r"([\\`*_<>$\[\]|{}~#])", r"\\\1", words)


def _command(name: str, parser: argparse.ArgumentParser) -> Iterator[str]:
    yield f"## lajolla {name}"
    yield text(parser.description or "")
    usage = re.sub(r"\s+", " ", parser.format_usage().removeprefix("usage:")).strip()
    yield f"```text\n{_shortened(usage)}\n```"
    for group in parser._action_groups:
        actions = [action for action in group._group_actions if action.dest != "help"]
        if actions:
            title = "arguments" if group.title == "positional arguments" else group.title or "options"
            yield f"**{text(title[0].upper() + title[1:])}**"
            yield "\n\n".join(_option(action) for action in actions)
    examples = parser.epilog or ""
    if examples:
        yield f"```text\n{examples.strip()}\n```"


def _shortened(usage: str) -> str:
    """The usage without its options, which are listed below it."""
    words = re.sub(r" \[-[^\[\]]*(\[[^\]]*\][^\[\]]*)*\]", "", usage)
    return words.replace("lajolla ", "lajolla ", 1) if words == usage else words + " [OPTIONS]"


def _option(action: argparse.Action) -> str:
    """A term and its definition."""
    value = action.metavar or ("|".join(map(str, action.choices)) if action.choices else "")
    names = ", ".join(action.option_strings) or str(value)
    takes = action.option_strings and action.nargs != 0 and value
    meaning = (action.help or "") % {"default": action.default, "prog": "lajolla"}
    return f"`{names}{f' {value}' if takes else ''}`\n: {text(meaning)}"
