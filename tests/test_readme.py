"""README.md tells the truth: its commands parse, its Python compiles, its links lead somewhere."""

import re
import shlex
from pathlib import Path

import pytest

from lajolla.arguments import parse


@pytest.fixture(scope="module")
def readme(repository: Path) -> str:
    return (repository / "README.md").read_text()


def blocks(text: str, *languages: str) -> list[str]:
    return [
        code for language, code in re.findall(r"```(\w*)\n(.*?)```", text, re.DOTALL) if language in languages
    ]


def test_commands_parse(readme: str) -> None:
    lines = [line for block in blocks(readme, "sh", "console", "") for line in block.splitlines()]
    commands = [shlex.split(line, comments=True) for line in lines if re.match(r"(\$ )?(\./)?lajolla ", line)]
    assert commands, "README shows no command"
    for words in commands:
        arguments = words[2:] if words[0] == "$" else words[1:]
        if arguments[0] != "test":  # the launcher's own
            parse(arguments)


def test_python_compiles(readme: str) -> None:
    for block in blocks(readme, "python"):
        compile(block, "README.md", "exec")


def test_links_lead_somewhere(readme: str, repository: Path) -> None:
    targets = re.findall(r"\]\(([^)#\s]+)", readme) + re.findall(r'src="([^"]+)"', readme)
    missing = [target for target in targets if "://" not in target and not (repository / target).exists()]
    assert missing == []
