"""Renders the pictures that docs/book/figures.toml declares, into docs/images.

.venv/bin/python bench/figures.py                       all figures of the book
.venv/bin/python bench/figures.py estimators-mis        the named ones
.venv/bin/python bench/figures.py --draft -o folder     thumbnails, to try the commands
"""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
import time
from pathlib import Path

import OpenImageIO as oiio

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "docs" / "site"))

from figure_list import DOCS, Figure, FigureError, Panel, find, read_figures  # noqa: E402

from lajolla.cli import main as run_lajolla  # noqa: E402
from lajolla.whole_files import replacing  # noqa: E402

DRAFT_WIDTH = 48  # pixels
QUALITY = 85  # of JPEG files, of 100


def render_panel(panel: Panel, target: Path, *, draft: bool) -> None:
    """Runs the commands of a panel, in the root of the checkout, and writes its picture.

    Drafts are small and have one sample per pixel. Raises FigureError if a command fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        for words in panel.words(Path(folder)):
            settings = [*_draft(panel), "--quiet"] if draft else ["--quiet"]
            with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
                code = run_lajolla([*words, *settings] if words[0] == "render" else words)
            if code != 0:
                raise FigureError(f"{panel.name}: lajolla {' '.join(words)}: ended with {code}")
        write_jpeg(Path(folder, f"{panel.name}.png"), target)


def _draft(panel: Panel) -> list[str]:
    """Options that make a render small; the last of equal options counts."""
    width, height = panel.size
    return ["--size", f"{DRAFT_WIDTH}x{max(1, round(DRAFT_WIDTH * height / width))}", "--spp", "1"]


def write_jpeg(source: Path, target: Path) -> None:
    """Stores a picture as JPEG without what its file says beside the pixels; raises FigureError."""
    picture = oiio.ImageBuf(str(source))
    pixels = picture.get_pixels(oiio.UINT8)
    if picture.has_error or pixels is None:
        raise FigureError(f"{source.name}: {picture.geterror()}")
    height, width, channels = pixels.shape
    written = oiio.ImageBuf(oiio.ImageSpec(width, height, min(channels, 3), oiio.UINT8))
    written.set_pixels(oiio.ROI(), pixels[..., :3].copy())
    written.specmod().attribute("Compression", f"jpeg:{QUALITY}")
    written.specmod().attribute("jpeg:subsampling", "4:2:0")
    target.parent.mkdir(parents=True, exist_ok=True)
    with replacing(target) as temporary:
        if not written.write(str(temporary)):
            raise FigureError(f"{target}: {written.geterror()}")


def render_figures(figures: list[Figure], folder: Path, *, draft: bool) -> None:
    """Renders figures into a folder that is laid out like docs/, and prints how long each panel takes."""
    begin = time.perf_counter()
    panels = [panel for figure in figures for panel in figure.panels]
    for number, panel in enumerate(panels, 1):
        start = time.perf_counter()
        render_panel(panel, folder / panel.file, draft=draft)
        seconds = time.perf_counter() - start
        print(f"{number} of {len(panels)}: {panel.name}: {seconds:.1f} s", flush=True)
    print(f"{len(panels)} pictures in {time.perf_counter() - begin:.0f} s")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="figure (default: all, but for by_name ones)"
    )
    parser.add_argument("--draft", action="store_true", help="thumbnails with one sample per pixel")
    parser.add_argument("-o", dest="folder", type=Path, default=DOCS, help="instead of docs/")
    arguments = parser.parse_args()
    if arguments.draft and arguments.folder == DOCS:
        parser.error("--draft needs -o FOLDER: thumbnails do not replace the pictures of the book")
    try:
        figures = read_figures()
        chosen = [find(figures, name) for name in arguments.names]
        chosen = chosen or [figure for figure in figures.values() if not figure.by_name]
        folder = arguments.folder.resolve()
        os.chdir(ROOT)  # where the commands find the scenes
        render_figures(chosen, folder, draft=arguments.draft)
    except FigureError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
