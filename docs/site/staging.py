"""Copies the pages of the site to a folder for Sphinx, with links that work there.

The pages are plain Markdown with relative links, as code hosts show them. On the site, those that leave
docs/ would lead nowhere. Therefore a few Markdown files from outside become pages of the site, and every
other file that a page links, or includes lines of, becomes a page with its text.
"""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path, PurePosixPath

import notebooks
import weekend

PAGES = {  # from outside of docs/
    "README.md": "index.md",  # a link to it leads to the first page
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "bench/README.md": "benchmarks.md",
    "scenes/README.md": "example-scenes.md",
}
LANGUAGES = {
    **{
        ".h": "cpp",
        ".cpp": "cpp",
        ".py": "python",
        ".xml": "xml",
        ".toml": "toml",
        ".sh": "sh",
        ".yml": "yaml",
    },
    **{".js": "js", ".css": "css", ".html": "html"},
}
LINK = re.compile(r"""(?P<before>\]\(|src="|href=")(?P<path>[^)"\s#]+)(?P<anchor>#[^)"\s]*)?(?=[)"])""")
INCLUDE = re.compile(r"^ *(?:`{3,}|:{3,})\{literalinclude\} +(\S+)", re.MULTILINE)
CODE = re.compile(r"^(?P<fence>`{3,})(?![`{])[^\n]*\n.*?^(?P=fence)[ \t]*$", re.MULTILINE | re.DOTALL)
SOURCE_PAGE = """\
---
orphan: true
nosearch: true
---
# `{name}`

```{{literalinclude}} {path}
:language: {language}
:linenos:
```
"""


class LinkError(Exception):
    """A relative link that leads nowhere."""


def stage(root: Path, target: Path) -> Path:
    """Fills an empty folder with the pages of a checkout; returns its folder docs. Raises LinkError.

    Beside docs there are links to the other folders of the checkout, so that pages include lines of sources
    by the same relative paths as in the checkout.
    """
    for path in root.iterdir():
        if path.name != "docs":
            (target / path.name).symlink_to(path)
    docs = target / "docs"
    shutil.copytree(root / "docs", docs, ignore=shutil.ignore_patterns("__pycache__"))
    for path in sorted(docs.glob("notebooks/*.ipynb")):
        notebooks.write_page(path)
    for source, name in PAGES.items():
        if name != "index.md":
            shutil.copy(root / source, docs / name)
    sources = _Sources(root, docs)
    for page in sorted(docs.rglob("*.md")):
        sources.relink(page)
    return docs


class _Sources:
    """The files that pages link and that become pages themselves."""

    def __init__(self, root: Path, docs: Path) -> None:
        self.root, self.docs = root, docs
        self.origins = {name: source for source, name in PAGES.items() if source != "README.md"}

    def relink(self, page: Path) -> None:
        """Rewrites the links of a page."""
        name = page.relative_to(self.docs).as_posix()
        origin = PurePosixPath(self.origins.get(name, f"docs/{name}"))
        text = self._changed(name, page.read_text())
        parts = []
        end = 0
        for code in CODE.finditer(text):
            parts += [self._relinked(text[end : code.start()], origin, page), code[0]]
            end = code.end()
        page.write_text("".join([*parts, self._relinked(text[end:], origin, page)]))
        for path in INCLUDE.findall(text):
            self._page(os.path.normpath(origin.parent / path))

    def _changed(self, name: str, text: str) -> str:
        """A page with what only the site adds: numbers of chapters, and of lines."""
        if chapter := re.match(r"book/(\d\d)-", name):
            return re.sub(r"^# ", f"# {int(chapter[1])}. ", text, count=1, flags=re.MULTILINE)
        return weekend.with_lines(text, self.root) if name == weekend.NAME else text

    def _relinked(self, text: str, origin: PurePosixPath, page: Path) -> str:
        def changed(link: re.Match[str]) -> str:
            path, anchor = link["path"], link["anchor"] or ""
            if ":" in path or path.startswith("{"):
                return link[0]
            leads_to = os.path.normpath(origin.parent / path)
            target = self._page(leads_to)
            if target is None:
                raise LinkError(f"{origin}: the link {path} leads nowhere")
            if target.is_relative_to(self.docs / "source"):
                anchor = ""  # a number of a line
            return f"{link['before']}{os.path.relpath(target, page.parent)}{anchor}"

        return LINK.sub(changed, text)

    def _page(self, name: str) -> Path | None:
        """The file of the site for a file of the checkout."""
        if name in PAGES:
            return self.docs / PAGES[name]
        inside = self.docs / os.path.relpath(name, "docs")
        if name.startswith("docs/") and inside.is_file():
            return inside.with_suffix(".md") if inside.suffix == ".ipynb" else inside
        if (self.root / name).is_file():
            return self._source_page(name)
        return None

    def _source_page(self, name: str) -> Path:
        page = self.docs / "source" / f"{name}.md"
        if not page.exists():
            page.parent.mkdir(parents=True, exist_ok=True)
            path = os.path.relpath(self.docs.parent / name, page.parent)
            language = LANGUAGES.get(Path(name).suffix, "text")
            page.write_text(SOURCE_PAGE.format(name=name, path=path, language=language))
        return page
