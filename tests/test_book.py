"""The site: it builds without warnings, its links lead somewhere, its figures render, its examples load."""

from __future__ import annotations

import fcntl
import os
import re
import subprocess
import sys
import warnings
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from browser_tools import chromium
from measured_tools import synthetic, write_tensors
from mesh_files import SQUARE, serialized, serialized_payload
from voxel_files import vol

import lajolla
from lajolla import Image, arguments
from lajolla.catalog import catalog

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

ROOT = Path(__file__).resolve().parent.parent
sys.path += [str(ROOT / "bench"), str(ROOT / "docs" / "site")]

import figures as bench_figures  # noqa: E402
import weekend  # noqa: E402
from command_line import text as escaped  # noqa: E402
from figure_list import FigureError, find, read_figures  # noqa: E402
from reference import PAGES, example_of, read_examples  # noqa: E402

BUILD = ROOT / "docs" / "site" / "build.py"
FIGURES = read_figures()
EXAMPLES = read_examples()
MOST_LINES = 5000


def build_site(*words: object, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(BUILD), *map(str, words)]
    variables = {**os.environ, **environment}
    return subprocess.run(command, env=variables, capture_output=True, text=True, timeout=900, check=False)


def require(present: bool, what: str) -> None:
    """Skips a test without something; in CI it fails."""
    if not present:
        pytest.fail(what) if os.environ.get("CI") else pytest.skip(what)


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built once for all processes of the tests."""
    if sys.version_info < (3, 11):
        pytest.skip("Sphinx 9 needs Python 3.11")
    require(find_spec("sphinx") is not None, "Sphinx is not installed (the extra docs)")
    katex = Path(os.environ.get("KATEX", "/usr/share/javascript/katex"), "katex.min.js")
    require(katex.is_file(), "KaTeX is not installed (libjs-katex)")
    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    with (folder / "site.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "site.log").exists():
            result = build_site(folder / "site")
            (folder / "site.log").write_text(result.stderr)
    assert (folder / "site").is_dir(), (folder / "site.log").read_text()
    return folder / "site"


# --- the site -----------------------------------------------------------------------------------------------


class Page(HTMLParser):
    """The ids and links of a page, and the texts of its blocks of code."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.named_code: list[str] = []  # below the name of a source
        self._state = ""
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.ids |= {value for key in ("id", "name") if (value := given.get(key))}
        self.links += [value for key in ("href", "src") if (value := given.get(key))]
        if tag == "p" and given.get("class") == "source":
            self._state = "named"
        elif tag == "pre" and self._state == "named":
            self._state = "inside"
            self.named_code.append("")

    def handle_data(self, data: str) -> None:
        if self._state == "inside":
            self.named_code[-1] += data

    def handle_endtag(self, tag: str) -> None:
        if tag == "pre":
            self._state = ""


def test_links_of_the_site_lead_somewhere(site: Path) -> None:
    """Also to anchors; and nothing but links in texts leads out of the site."""
    sources = site / "source"
    pages = {path: Page(path) for path in site.rglob("*.html") if not path.is_relative_to(sources)}
    assert len(pages) > 60
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or link == "#":
                continue
            target = Path(os.path.normpath(path.parent / unquote(parts.path))) if parts.path else path
            anchors = pages[target].ids if target in pages else None
            found = target.exists() and (not parts.fragment or anchors is None or parts.fragment in anchors)
            if not found:
                broken.append(f"{path.relative_to(site)}: {link}")
    assert broken == []


def test_pages_show_lines_of_our_sources(site: Path) -> None:
    for path in sorted((site / "book").glob("[0-9]*.html")):
        code = Page(path).named_code
        assert code and all(lines.strip() for lines in code), path.name


def test_answers_are_folded(site: Path) -> None:
    for path in (site / "book").glob("[0-9]*.html"):
        text = path.read_text()
        assert re.search(r"<details[^>]*>\s*<summary[^>]*>Answer", text), path.name


def test_pages_of_the_reference_have_every_plugin(site: Path) -> None:
    for kind, models in catalog().items():
        name = PAGES[kind][0] if kind in PAGES else "aovs"
        text = (site / "reference" / f"{name}.html").read_text()
        assert [model for model in models if model not in text] == []
        ids = Page(site / "reference" / f"{name}.html").ids
        assert kind not in PAGES or {f"{kind}-{model.lower().replace('_', '-')}" for model in models} <= ids


@pytest.fixture(scope="module")
def browser() -> Iterator[Chrome]:
    with chromium(1280, 900) as found:
        yield found


FAULTS = """
const broken = [...document.images].filter(i => i.loading !== "lazy" && !i.naturalWidth).map(i => i.src);
const formulas = [...document.querySelectorAll(".math")].filter(m => !m.querySelector(".katex-html"));
const errors = [...document.querySelectorAll(".katex-error")].map(e => e.textContent);
const raw = document.querySelector("article").innerText.match(/\\$\\$|\\\\(?:frac|int|sum)/g) || [];
const width = document.documentElement.scrollWidth - innerWidth;
return [broken, formulas.map(f => f.textContent), errors, raw, Math.max(0, width)];
"""


def test_pages_in_a_browser(site: Path, browser: Chrome) -> None:
    """On a desk and on a phone: pictures, formulas, no overflow, and nothing from another place."""
    chapters = sorted(f"book/{path.name}" for path in (site / "book").glob("[0-9]*.html"))
    pages = ["index.html", "reference/bsdfs.html", chapters[0]]
    visits = [(1280, page) for page in pages]
    visits += [(390, page) for page in (*pages, *chapters[1:], "book/weekend.html", "gallery.html")]
    wrong = []
    for width, page in visits:
        settings = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", settings)
        browser.get(f"file://{site}/{page}")
        faults = browser.execute_script(FAULTS)
        if faults != [[], [], [], [], 0]:
            wrong.append((page, width, faults))
    assert wrong == []
    messages = [entry["message"] for entry in browser.get_log("performance")]
    requests = [message for message in messages if 'Network.requestWillBeSent"' in message]
    schemes = {
        scheme for message in requests for scheme in re.findall(r'"request":.*?"url":"(\w+):', message)
    }
    assert "file" in schemes and schemes <= {"file", "data"}
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_search_finds_a_term_without_a_server(site: Path, browser: Chrome) -> None:
    browser.get(f"file://{site}/search.html?q=Minnaert")
    browser.implicitly_wait(10)
    browser.find_element("css selector", "ul.search li a[href*='extending.html']")
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


def test_other_files_are_not_lost(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    result = build_site(tmp_path)
    assert result.returncode == 1
    assert (
        result.stderr == f"lajolla: error: {tmp_path}: holds other files than a site, which would be lost\n"
    )
    assert (tmp_path / "letter.txt").exists()


def test_a_missing_katex_is_one_message(tmp_path: Path) -> None:
    result = build_site(tmp_path / "site", KATEX=str(tmp_path))
    assert result.returncode == 1
    assert "libjs-katex" in result.stderr and result.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


# --- figures ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FIGURES)
def test_figures_render(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As thumbnails."""
    monkeypatch.chdir(ROOT)
    warnings.simplefilter("ignore")
    for panel in FIGURES[name].panels:
        bench_figures.render_panel(panel, tmp_path / panel.file, draft=True)
        assert (tmp_path / panel.file).stat().st_size > 0


@pytest.mark.parametrize("name", FIGURES)
def test_pictures_are_there_in_the_size_that_is_declared(name: str) -> None:
    for panel in FIGURES[name].panels:
        path = ROOT / "docs" / panel.file
        assert path.is_file(), f"bench/figures.py {name}"
        height, width = Image.open(path).array.shape[:2]
        assert (width, height) == panel.size, panel.name


@pytest.mark.parametrize("name", FIGURES)
def test_commands_of_figures_are_valid(name: str, tmp_path: Path) -> None:
    for panel in FIGURES[name].panels:
        for words in panel.words(tmp_path):
            parsed = arguments.parse(words)
            assert getattr(parsed, "scene", None) is None or (ROOT / parsed.scene).is_file()
        assert all(line.startswith("./lajolla ") for line in panel.shown())


def test_every_figure_is_shown_and_every_shown_figure_declared() -> None:
    pages = [path.read_text() for path in (ROOT / "docs").rglob("*.md")]
    shown = {name for text in pages for name in re.findall(r"^`{3,}\{figures\} (\S+)", text, re.M)}
    assert shown == set(FIGURES)


PANEL = '[[f.panels]]\nlabel = "a"\n'
MISTAKES = {
    'size = "4x4"\n[f]\n': "figure 'size' is not a table",
    '[f]\nsize = "4"\n': "figure 'f': size must be like \"480x320\"",
    '[f]\nsize = "4x4"\n': "figure 'f' has no panels",
    f'[f]\nsize = "4x4"\n{PANEL}': 'panel \'f-1\' needs either "command" or "commands"',
    f'[f]\nsize = "4x4"\n{PANEL}comand = "b"\n': "panel 'f-1': unknown key 'comand'; did you mean 'command'?",
    f'[f]\nsize = "4x4"\n{PANEL}commands = ["b", "c"]\n': "the last command must write {name}.png",
    "[f": "Expected",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_mistakes_in_declarations_are_one_message(text: str, tmp_path: Path) -> None:
    path = tmp_path / "figures.toml"
    path.write_text(text)
    with pytest.raises(FigureError) as caught:
        read_figures(path)
    assert str(path) in str(caught.value) and MISTAKES[text] in str(caught.value)


def test_unknown_names_have_the_nearest() -> None:
    with pytest.raises(FigureError, match=r"unknown figure 'galery-mis'; did you mean 'gallery-mis'\?"):
        find(FIGURES, "galery-mis")


def test_a_command_that_fails_keeps_the_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    panel = FIGURES["gallery-mis"].panels[0]
    (tmp_path / "a.jpg").write_bytes(b"old")
    with pytest.raises(FigureError, match=r"gallery-mis-1: lajolla render scenes/mis.xml .*: ended with 1"):
        bench_figures.render_panel(panel, tmp_path / "a.jpg", draft=True)
    assert (tmp_path / "a.jpg").read_bytes() == b"old"


# --- the reference ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the examples name."""
    folder = tmp_path_factory.mktemp("examples")
    for name in ("meshes", "textures", "volumes"):
        (folder / name).symlink_to(ROOT / "scenes" / name)
    write_tensors(folder / "satin.bsdf", synthetic())
    grid = np.linspace(0, 1, 8, dtype=np.float32).reshape(2, 2, 2, 1)
    for name, values in {
        "ball.vol": grid - 0.5,
        "flame.vol": 1500 * grid,
        "block_000_000_000.vol": grid,
    }.items():
        (folder / name).write_bytes(vol(values))
    box = np.array([0, 0, 0, 1, 1, 1], "<f4").tobytes()
    (folder / "blocks.bin").write_bytes(box + np.array([1, 1, 1, 0, 0, 0], "<i4").tobytes())
    strand = "\n".join(f"{x} {x} 0 0.1" for x in range(5))
    (folder / "strands.txt").write_text(strand)
    (folder / "hair.txt").write_text("\n".join(f"{x} {x} 0" for x in range(5)))
    mesh = serialized_payload(SQUARE, np.array([[0, 1, 2], [0, 2, 3]], np.uint32), "square")
    (folder / "square.serialized").write_bytes(serialized([mesh], 4))
    return folder


PLACES = {
    "bsdf": '<shape type="sphere">{}</shape>',
    "texture": '<shape type="sphere"><bsdf type="diffuse">{}</bsdf></shape>',
    "medium": '<shape type="sphere"><bsdf type="null"/>{}</shape>',
    "phase": '<shape type="sphere"><medium type="homogeneous" name="interior">{}</medium></shape>',
    "volume": '<shape type="sphere"><medium type="heterogeneous" name="interior">{}</medium></shape>',
    "film": '<sensor type="perspective">{}</sensor>',
    "rfilter": '<sensor type="perspective"><film type="hdrfilm">{}</film></sensor>',
    "sampler": '<sensor type="perspective">{}</sensor>',
    "ptex": '<shape type="obj"><string name="filename" value="meshes/knob.obj"/>'
    '<bsdf type="diffuse">{}</bsdf></shape>',
    "area": '<shape type="sphere">{}</shape>',
    "shapegroup": '{}<shape type="instance"><ref id="tree"/></shape>',
}
MODELS = [(kind, name) for kind in PAGES for name in catalog()[kind]]


@pytest.mark.parametrize(("kind", "name"), MODELS)
def test_examples_load(kind: str, name: str, scenes: Path) -> None:
    """Without a warning, except where there is one for the plugin in any scene."""
    example = example_of(kind, name, catalog()[kind][name]["fields"], EXAMPLES)
    if example is None:
        assert (kind, name) in {("shape", "mesh"), ("shape", "curves")}
        return
    place = PLACES.get(name, PLACES.get(kind, "{}"))
    path = scenes / f"{kind}-{name}-{os.getpid()}.xml"
    body = place.format(example)
    sensor = "" if "<sensor" in body else '<sensor type="perspective"/>'
    path.write_text(f'<scene version="3.0.0">{sensor}{body}</scene>')
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        scene = lajolla.load(path, size=(2, 2))
    scene.render(spp=1)
    assert [str(warning.message) for warning in found if name not in str(warning.message)] == []


def test_examples_are_of_plugins() -> None:
    assert set(EXAMPLES) <= set(MODELS)


def test_text_is_free_of_markup() -> None:
    assert escaped("a*b_c|d $x <y>") == r"a\*b\_c\|d \$x \<y\>"


# --- the weekend --------------------------------------------------------------------------------------------


def test_the_weekend_is_short(repository: Path) -> None:
    text = (repository / "docs" / weekend.NAME).read_text()
    files = weekend.files(text)
    assert len(files) == len(set(files)) > 20
    total = sum(weekend.lines_of(repository / name) for name in files)
    assert total <= MOST_LINES
    shown = weekend.with_lines(text, repository)
    assert f"In all, they\nhave {total} lines" in shown
    numbers = [int(number) for number in re.findall(r"^\| \[.*\| (\d+) \|$", shown, re.M)]
    assert len(numbers) == len(files) and sum(numbers) == total
