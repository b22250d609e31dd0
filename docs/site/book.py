"""Sphinx extension: the directive `figures`, formulas by KaTeX, and the names of files above their lines."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from figure_list import FigureError, Panel, find, read_figures
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)
KATEX = ("katex/katex.min.css", "katex/katex.min.js", "formulas.js")
PATH = re.compile(r"[\w.-]+(/[\w.-]+)+")


class Figures(SphinxDirective):
    """```{figures} NAME: the panels of a figure in figures.toml, a caption, the commands that render them."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar = {"commands": lambda word: directives.choice(word, ("shown", "hidden"))}

    def run(self) -> list[nodes.Node]:
        try:
            figure = find(read_figures(), self.arguments[0])
        except FigureError as error:
            raise self.error(str(error)) from None
        row = nodes.container(classes=["panels", f"panels-{len(figure.panels)}"])
        row += [self._panel(panel) for panel in figure.panels]
        caption = nodes.container(classes=["figures-caption"])
        caption += self.parse_content_to_nodes()
        whole: list[nodes.Node] = [row, caption]
        if self.options.get("commands") != "hidden":
            whole.append(_commands(figure.panels))
        result = nodes.container("", *whole, classes=["figures"])
        self.set_source_info(result)
        return [result]

    def _panel(self, panel: Panel) -> nodes.Node:
        text, _ = self.parse_inline(panel.label)
        label = nodes.paragraph("", "", *text, classes=["label"])
        if not Path(self.env.srcdir, panel.file).is_file():
            logger.warning("%s is not rendered: bench/figures.py", panel.file, location=self.get_location())
            return nodes.container("", label, classes=["panel", "absent"])
        image = nodes.image(uri=f"/{panel.file.as_posix()}", alt=panel.label, width=f"{panel.size[0]}px")
        return nodes.container("", image, label, classes=["panel"])


def _commands(panels: tuple[Panel, ...]) -> nodes.Node:
    lines = [line for panel in panels for line in panel.shown()]
    return nodes.literal_block("\n".join(lines), "\n".join(lines), language="text", classes=["commands"])


# --- formulas -----------------------------------------------------------------------------------------------


def _inline(translator: HTML5Translator, node: nodes.math) -> None:
    _write(translator, node, "span")


def _display(translator: HTML5Translator, node: nodes.math_block) -> None:
    _write(translator, node, "div")


def _write(translator: HTML5Translator, node: nodes.Element, tag: str) -> None:
    translator.body.append(translator.starttag(node, tag, "", CLASS="math notranslate nohighlight"))
    translator.body.append(translator.encode(node.astext().strip()) + f"</{tag}>")
    raise nodes.SkipNode


def _add_katex(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document) -> None:
    """To the pages that need it."""
    if tree is not None and tree.next_node(lambda node: isinstance(node, nodes.math | nodes.math_block)):
        style, library, ours = KATEX
        app.add_css_file(style)
        app.add_js_file(library, loading_method="defer")
        app.add_js_file(ours, loading_method="defer")


# --- lines of our sources -----------------------------------------------------------------------------------


def _name_sources(app: Sphinx, tree: nodes.document) -> None:
    """Puts the name of the file above the lines of it that a page includes, as a link to the whole file."""
    page = app.env.docname
    for block in list(tree.findall(nodes.literal_block)):
        source = Path(block.get("source", ""))
        if not source.is_file() or source.suffix == ".md" or page.startswith("source/"):
            continue
        name = os.path.relpath(source, checkout(app))
        uri = app.builder.get_relative_uri(page, f"source/{name}")
        link = nodes.reference("", "", nodes.literal("", name), refuri=uri, internal=True)
        block.parent.insert(block.parent.index(block), nodes.paragraph("", "", link, classes=["source"]))


def _let_paths_break(app: Sphinx, tree: nodes.document, page: str) -> None:
    """Lines may end after the slashes of a path, in place of inside a word."""
    for text in list(tree.findall(nodes.Text)):
        if isinstance(text.parent, nodes.literal | nodes.inline | nodes.reference) and PATH.fullmatch(text):
            pieces: list[nodes.Node] = []
            for folder in text.split("/")[:-1]:
                pieces += [nodes.Text(f"{folder}/"), nodes.raw("", "<wbr>", format="html")]
            text.parent.replace(text, [*pieces, nodes.Text(text.split("/")[-1])])


def checkout(app: Sphinx) -> Path:
    """The root of the checkout; the pages are copies (staging.py) beside links to its folders."""
    return Path(app.srcdir).parent.joinpath("core").resolve().parent


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_directive("figures", Figures)
    app.add_html_math_renderer("katex", (_inline, None), (_display, None))
    app.connect("html-page-context", _add_katex)
    app.connect("doctree-read", _name_sources)
    app.connect("doctree-resolved", _let_paths_break)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
