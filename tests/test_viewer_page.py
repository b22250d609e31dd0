"""The viewer's page in a headless Chromium."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from browser_tools import chromium
from OpenImageIO import ImageInput
from viewer_tools import SCENE, SENSORS, render, viewer

import lajolla

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


@pytest.fixture(scope="module")
def browser() -> Iterator[Chrome]:
    with chromium(1200, 800) as browser:
        yield browser


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


class Page:
    """An open page of a viewer."""

    def __init__(self, browser: Chrome, address: str, file: Path) -> None:
        self.browser = browser
        self.file = file  # for pictures of the screen
        browser.get(address)
        self.until("window.lajolla?.panels.last")

    def run(self, script: str, *values: object) -> Any:  # noqa: ANN401
        return self.browser.execute_script(script, *values)

    def until(self, condition: str, seconds: float = 30) -> None:
        """Waits until a condition in JavaScript holds."""
        end = time.monotonic() + seconds
        while not self.run(f"return Boolean({condition})"):
            assert time.monotonic() < end, f"never: {condition}"
            time.sleep(0.05)

    def finished(self, view: int = 0) -> None:
        """Waits until a view, or a later one, is rendered."""
        self.until(
            "((shown, last) => shown && last.state === 'finished' && shown.number >= last.picture &&"
            f"shown.view >= {view})(window.lajolla.display.pictures.picture, window.lajolla.panels.last)"
        )

    def text(self, name: str) -> str:
        return str(self.run("return document.getElementById(arguments[0]).textContent", name))

    def set(self, name: str, value: object, event: str = "change") -> None:
        """Sets the value of a control as a user does."""
        self.run(
            "const e = document.getElementById(arguments[0]); e.value = arguments[1];"
            "e.dispatchEvent(new Event(arguments[2], {bubbles: true}))",
            *(name, value, event),
        )

    def click(self, name: str) -> None:
        self.run("document.getElementById(arguments[0]).click()", name)

    def screen(self) -> np.ndarray:
        """The pixels of the film on the canvas, one for each, in 0 to 1: (64, 96, 3)."""
        encoded = self.browser.execute_async_script(
            "const done = arguments[0]; window.lajolla.display.png().then((blob) => {"
            "const r = new FileReader(); r.onload = () => done(r.result); r.readAsDataURL(blob) })"
        )
        self.file.write_bytes(base64.b64decode(encoded.partition(",")[2]))
        picture = ImageInput.open(str(self.file))
        return np.asarray(picture.read_image("uint8"))[..., :3] / 255

    def problems(self) -> list[str]:
        return [entry["message"] for entry in self.browser.get_log("browser") if entry["level"] == "SEVERE"]

    def pointer(self, path: list[tuple[int, int]], button: str = "left", pause: float = 0.02) -> None:
        """Presses at the first position, relative to the canvas' middle, and drags to the others."""
        from selenium.webdriver import ActionChains
        from selenium.webdriver.common.by import By

        canvas = self.browser.find_element(By.ID, "canvas")
        actions = ActionChains(self.browser, duration=20).move_to_element_with_offset(canvas, *path[0])
        actions.click_and_hold()
        for (x, y), (before_x, before_y) in zip(path[1:], path, strict=False):
            actions.move_by_offset(x - before_x, y - before_y).pause(pause)
        actions.release().perform()


@pytest.fixture
def page(browser: Chrome, scene: Path) -> Iterator[Page]:
    with viewer(scene) as address:
        browser.get_log("browser")
        page = Page(browser, address, scene.with_name("screen.png"))
        page.finished()
        yield page
        assert page.problems() == []
        browser.get("about:blank")


def assert_near(found: np.ndarray, expected: np.ndarray) -> None:
    """Two pictures with 8 bits for each channel, up to rounding by half floats and by the browser."""
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() <= 2 / 255


def test_the_page_shows_the_picture(page: Page, scene: Path) -> None:
    linear = np.clip(lajolla.load(scene).render(spp=32).array, 0, 1)
    expected = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    assert_near(page.screen(), expected)


def test_exposure_and_curves(page: Page) -> None:
    shown = {}
    for name in ("srgb", "linear", "filmic", "aces", "agx", "false"):
        page.set("curve", name)
        shown[name] = page.screen()
    pictures = list(shown.values())
    assert all(np.abs(a - b).mean() > 0.005 for i, a in enumerate(pictures) for b in pictures[:i])
    page.set("curve", "linear")
    page.set("exposure", -1, "input")
    np.testing.assert_allclose(page.screen(), shown["linear"] / 2, atol=2 / 255, err_msg="one stop")


def test_a_drag_turns_the_camera(page: Page) -> None:
    before = page.screen()
    page.pointer([(0, 0), (40, 10), (120, 30)])
    page.until("window.lajolla.display.pictures.picture.view > 0")
    page.finished(1)
    placement = page.run("return window.lajolla.camera.matrix")
    assert abs(placement[0][3]) > 0.5, "it moved around the ball"
    position = np.array([row[3] for row in placement[:3]])
    assert np.linalg.norm(position - (0, 0, 1)) == pytest.approx(3, abs=0.05), "about what is in the middle"
    page.set("layer", "normal")
    page.finished(1)
    assert np.abs(page.screen() - before).mean() > 0.01


@pytest.mark.parametrize("key", ["w", "a", "q", "ARROW_LEFT"])
def test_keys_move_the_camera(page: Page, key: str) -> None:
    from selenium.webdriver import ActionChains, Keys

    before = page.run("return window.lajolla.camera.matrix")
    page.run("document.getElementById('canvas').focus()")
    code = getattr(Keys, key, key)
    ActionChains(page.browser).key_down(code).pause(0.3).key_up(code).perform()
    page.finished(1)
    assert page.run("return window.lajolla.camera.matrix") != before


def test_the_wheel_moves_forward(page: Page) -> None:
    page.run("document.getElementById('canvas').dispatchEvent(new WheelEvent('wheel', {deltaY: -200}))")
    page.finished(1)
    assert page.run("return window.lajolla.camera.matrix")[2][3] < 3.9
    page.click("home")
    page.finished(2)
    assert page.run("return window.lajolla.camera.matrix")[2][3] == pytest.approx(4)


def test_touch_turns_the_camera(page: Page) -> None:
    for kind, x in (("touchStart", 300), ("touchMove", 330), ("touchMove", 420), ("touchEnd", None)):
        points = [] if x is None else [{"x": x, "y": 300}]
        page.browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    page.finished(1)
    assert abs(page.run("return window.lajolla.camera.matrix")[0][3]) > 0.3


def test_a_click_inspects_the_pixel(page: Page, scene: Path) -> None:
    page.pointer([(0, 0)])
    page.until("document.getElementById('pixel').textContent.includes('ball')")
    text = page.text("pixel")
    assert "red, diffuse" in text and f"{scene}:10" in text
    assert "lajolla render" in page.text("replay")


def test_an_edit_changes_the_picture(page: Page) -> None:
    before = page.screen()
    page.run("document.getElementById('objects-section').open = true")
    page.until("document.querySelector('[data-name=red]')")
    page.run("document.querySelector('[data-name=red]').open = true")
    page.until("document.querySelector('[data-path=\"red.reflectance\"]')")
    page.run(
        "const [picker, ...numbers] = document.querySelectorAll('[data-path=\"red.reflectance\"]');"
        "picker.value = '#1020f0'; picker.dispatchEvent(new Event('input', {bubbles: true}))"
    )
    page.finished(1)
    after = page.screen()
    assert before[32, 48, 0] > before[32, 48, 2] and after[32, 48, 2] > 2 * after[32, 48, 0]


def test_a_value_out_of_range_is_refused(page: Page) -> None:
    page.until("document.querySelector('[data-path=\"sensor.fov\"]')")
    page.run(
        "const fov = document.querySelector('[data-path=\"sensor.fov\"]'); fov.value = 500;"
        "fov.dispatchEvent(new Event('input', {bubbles: true}))"
    )
    assert page.run("return document.querySelector('[data-path=\"sensor.fov\"]').classList.contains('wrong')")


def test_comparison(page: Page) -> None:
    before = page.screen()
    page.click("keep")
    assert page.run("return document.getElementById('compare').value") == "split"
    page.set("compare", "difference")
    assert page.screen().min() > 0.99, "no difference is white"
    page.set("layer", "albedo")
    page.finished()
    page.until("window.lajolla.display.pictures.picture.limits")
    assert page.screen().min() < 0.5
    page.set("compare", "flip")
    assert_near(page.screen(), before)  # with its own mapping to colours


def test_cropping(page: Page) -> None:
    page.click("crop")
    page.pointer([(-60, -40), (0, 0), (60, 40)])
    page.finished(1)
    left, top, width, height = page.run("return window.lajolla.display.pictures.picture.window")
    assert width < 96 and height < 64 and left > 0 and top > 0
    page.click("whole")
    page.finished(2)
    assert page.run("return window.lajolla.display.pictures.picture.window") == [0, 0, 96, 64]


def test_a_page_connects_again(browser: Chrome, scene: Path) -> None:
    with viewer(scene) as address:
        page = Page(browser, address, scene.with_name("screen.png"))
        page.finished()
        page.run("window.lajolla.connection.socket.close()")
        page.until("document.getElementById('notice').textContent.includes('does not answer')")
        page.until("document.getElementById('notice').textContent === ''")
        page.pointer([(0, 0), (40, 10), (120, 30)])
        page.finished(1)
    page.until("document.getElementById('notice').textContent.includes('does not answer')")


def test_a_lost_graphics_context_is_restored(page: Page) -> None:
    before = page.screen()
    page.click("keep")
    page.run("window.lost = window.lajolla.display.gl.getExtension('WEBGL_lose_context')")
    page.run("window.lost.loseContext()")
    page.until("document.getElementById('notice').textContent.includes('graphics context')")
    page.run("window.lost.restoreContext()")
    page.until("document.getElementById('notice').textContent === ''")
    for mode in ("off", "flip"):
        page.set("compare", mode)
        assert_near(page.screen(), before)


def test_another_sensor_and_saving(browser: Chrome, scene: Path) -> None:
    from selenium.webdriver import Keys
    from selenium.webdriver.common.by import By

    scene.write_text(SENSORS)
    with viewer(scene) as address:
        page = Page(browser, address, scene.with_name("screen.png"))
        page.finished()
        page.set("sensor", "side")
        page.finished(1)
        assert page.run("return window.lajolla.camera.matrix")[0][3] == 4
        page.run("document.querySelectorAll('details').forEach((d) => (d.open = true))")
        name = browser.find_element(By.ID, "save-name")
        assert name.get_attribute("value") == "scene-edited.xml"
        name.send_keys(Keys.ENTER)
        page.until("document.getElementById('notice').textContent.startsWith('wrote')")
        shown = page.screen()
        page.set("sensor", "front")
        page.finished(2)
        assert page.run("return window.lajolla.camera.matrix")[2][3] == 4
        assert np.abs(page.screen() - shown).mean() > 0.01
        name.send_keys(Keys.ENTER)
        page.until("document.getElementById('notice').textContent.includes('scene-edited.xml exists')")
        assert page.problems() == []
    assert lajolla.load(scene.with_name("scene-edited.xml"))["sensor.to_world"][0, 3] == 4


def test_a_page_of_a_render_keeps_the_last_picture(browser: Chrome, scene: Path) -> None:
    with render(scene, 1 << 16) as (address, process):
        page = Page(browser, address, scene.with_name("screen.png"))
        page.until("window.lajolla.display.pictures.picture && document.querySelector('[data-path]')")
        assert page.run("return document.querySelectorAll('[data-path]:not(:disabled)').length") == 0
        assert not page.run("return document.getElementById('pause').offsetParent")
        process.terminate()
        page.until("document.getElementById('notice').textContent.startsWith('The render has ended; wrote')")
        assert process.wait(timeout=20) == 143
        page.until("window.lajolla.connection.socket.readyState === WebSocket.CLOSED")
        assert page.run("return window.lajolla.display.pictures.picture.number") > 0
        assert [
            text for text in page.problems() if "ERR_CONNECTION_REFUSED" not in text
        ] == []  # it reconnects


def test_every_control_can_be_reached_with_the_keyboard(page: Page) -> None:
    page.run("document.querySelectorAll('details').forEach((d) => (d.open = true))")
    reachable = page.run(
        "return [...document.querySelectorAll('button, input, select, summary, a, canvas')]"
        ".filter((e) => e.offsetParent !== null && e.tabIndex < 0).map((e) => e.outerHTML)"
    )
    assert reachable == []
    unnamed = page.run(
        "return [...document.querySelectorAll('input, select')].filter((e) => e.offsetParent !== null &&"
        "!e.labels?.length && !e.getAttribute('aria-label') && !e.getAttribute('aria-labelledby'))"
        ".map((e) => e.outerHTML)"
    )
    assert unnamed == []


@pytest.mark.parametrize("scheme", ["dark", "light"])
@pytest.mark.parametrize("size", [(1200, 800), (390, 844)])
def test_it_fits_the_window_in_dark_and_light(page: Page, scheme: str, size: tuple[int, int]) -> None:
    media = [{"name": "prefers-color-scheme", "value": scheme}]
    page.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": media})
    metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 500}
    page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        wider = page.run("return document.documentElement.scrollWidth - innerWidth")
        assert wider <= 0
        colours = [
            page.run(f"return getComputedStyle(document.body).{name}")
            for name in ("color", "backgroundColor")
        ]
        text, back = (sum(int(c) for c in colour[4:-1].split(",")) for colour in colours)
        assert text > back if scheme == "dark" else text < back
        assert page.run("return document.getElementById('canvas').clientHeight") > 0.4 * size[1]
    finally:
        page.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        page.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_it_requests_nothing_from_elsewhere(browser: Chrome, scene: Path) -> None:
    browser.get_log("performance")
    with viewer(scene) as address:
        Page(browser, address, scene.with_name("screen.png")).finished()
        events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    requested = {e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"}
    assert requested and all(url.startswith(address) or url.startswith("data:") for url in requested)
