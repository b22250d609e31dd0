"""Builds the site from docs/: `./lajolla docs [FOLDER]`."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import shutil
import sys
import tempfile
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
SITE = Path(os.environ.get("LAJOLLA_SITE", ROOT / "build" / "site"))  # the launcher sets it
KATEX = Path("/usr/share/javascript/katex")  # of Debian's and Ubuntu's package libjs-katex
MARK = ".buildinfo"  # a file that Sphinx writes into every site


class SiteError(Exception):
    """The site cannot be built; the message states why."""


def build(target: Path, *, strict: bool = True) -> None:
    """Builds the site in a folder, which it replaces. Raises SiteError.

    Args:
        target: a folder that does not exist, is empty, or has an older site.
        strict: warnings, such as those of links that lead nowhere, are errors.
    """
    if sys.version_info < (3, 11):
        raise SiteError("Sphinx 9 needs Python 3.11 or newer")
    _check_target(target)
    katex = katex_folder()
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".site-") as folder:
        staged = Path(folder)
        (staged / "site").mkdir()
        _run_sphinx(staged, katex, strict=strict)
        _replace(target, staged / "site", staged / "old")


def _replace(target: Path, new: Path, old: Path) -> None:
    """Moves a folder to another one's place, and that one to `old`."""
    if target.exists():
        target.rename(old)
    try:
        new.rename(target)
    except OSError:
        if old.exists():
            old.rename(target)
        raise


def _check_target(target: Path) -> None:
    if target.exists() and not target.is_dir():
        raise SiteError(f"{target}: is a file")
    if target.is_dir() and any(target.iterdir()) and not (target / MARK).is_file():
        raise SiteError(f"{target}: holds other files than a site, which would be lost")


def katex_folder() -> Path:
    """The folder of KaTeX with its fonts; the variable KATEX names another one. Raises SiteError."""
    folder = Path(os.environ.get("KATEX") or KATEX)
    needed = ("katex.min.js", "katex.min.css", "fonts/KaTeX_Main-Regular.woff2")
    if not all((folder / name).is_file() for name in needed):
        raise SiteError(
            f"{folder}: has no KaTeX; install libjs-katex, or set KATEX to the folder dist of another copy"
        )
    return folder


def _run_sphinx(folder: Path, katex: Path, *, strict: bool) -> None:
    try:
        from sphinx.cmd.build import build_main
    except ImportError as error:
        raise SiteError(f"Sphinx is not installed ({error}): pip install -e '.[docs]'") from error
    from reference import write_reference
    from staging import LinkError, stage

    stage_folder = folder / "stage"
    stage_folder.mkdir()
    try:
        docs = stage(ROOT, stage_folder)
    except LinkError as error:
        raise SiteError(str(error)) from error
    write_reference(docs / "reference")
    _copy_katex(katex, docs / "site" / "static" / "katex")
    options = ["-W", "--keep-going"] if strict else []
    words = [*options, "-q", "-b", "html", "-d", str(folder / "doctrees"), str(docs), str(folder / "site")]
    messages = io.StringIO()
    with contextlib.redirect_stderr(messages):
        code = build_main(words)
    sys.stderr.write(messages.getvalue().replace(str(stage_folder), str(ROOT)))  # not of the copy
    if code != 0:
        raise SiteError("the site has the mistakes above")


def _copy_katex(katex: Path, target: Path) -> None:
    (target / "fonts").mkdir(parents=True)
    for name in ("katex.min.js", "katex.min.css"):
        shutil.copy(katex / name, target)
    for font in sorted((katex / "fonts").glob("*.woff2")):
        shutil.copy(font, target / "fonts")


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="lajolla docs", description="Builds the site from docs/; it can be read without a network."
    )
    folder_help = "for the site (default: build/site)"
    parser.add_argument("folder", nargs="?", type=Path, default=SITE, metavar="FOLDER", help=folder_help)
    parser.add_argument(
        "--lenient", action="store_true", help="go on after warnings, such as of missing pictures"
    )
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")  # of libraries
    try:
        build(arguments.folder.resolve(), strict=not arguments.lenient)
    except (SiteError, OSError) as error:
        print(f"lajolla: error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("lajolla: interrupted; nothing was written", file=sys.stderr)
        return 130
    print(f"wrote {arguments.folder / 'index.html'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
