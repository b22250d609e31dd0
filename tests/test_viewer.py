"""The viewer's render loop, as a page sees it: pictures, edits, layers, and what happens to failures."""

from __future__ import annotations

import json
import queue
import shlex
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from viewer_tools import SCENE, Client, finished, moved, viewer

import lajolla
from lajolla.cli import main
from lajolla.render import StopRules
from lajolla.viewer.pace import FIRST_SECONDS, Pace
from lajolla.viewer.protocol import Message, Picture
from lajolla.viewer.session import ALWAYS, Session, merged
from lajolla.viewer.view import View

RED = np.array([0.6, 0.05, 0.05])


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "scene.xml"
    path.write_text(SCENE)
    return path


@pytest.fixture
def client(scene: Path) -> Iterator[Client]:
    with viewer(scene, "--size", "192x128") as address, Client(address) as client:
        yield client


# --- pictures -----------------------------------------------------------------------------------------------


def test_the_last_picture_is_that_of_render(client: Client, scene: Path) -> None:
    pixels = finished(client, 0)
    expected = lajolla.load(scene, size=(192, 128)).render(spp=32).array
    np.testing.assert_array_equal(pixels, expected.astype(np.float16).astype(np.float32))


def test_moving_the_camera_shows_another_view(client: Client, scene: Path) -> None:
    before = finished(client, 0)
    client.send("edit", values=moved(0.7))
    after = finished(client, 1)
    expected = lajolla.load(scene, size=(192, 128)).with_params(moved(0.7)).render(spp=32).array
    np.testing.assert_array_equal(after, expected.astype(np.float16).astype(np.float32))
    assert np.abs(after - before).mean() > 0.01


def test_a_view_never_loses_pixels(client: Client) -> None:
    """A preview comes first, and only pictures with as many pixels or more replace it."""
    finished(client, 0)
    for step in range(1, 6):
        client.send("edit", values=moved(0.1 * step))
    sizes: dict[int, list[int]] = {}
    while (
        client.messages.get("viewed", {}).get("view", 0) == 0
        or client.messages["progress"]["state"] != "finished"
    ):
        if client.receive() == "picture" and client.picture is not None:
            sizes.setdefault(client.picture.view, []).append(client.picture.pixels.size)
    assert all(found == sorted(found) for found in sizes.values())


def test_a_colour_changes_at_once(client: Client) -> None:
    finished(client, 0)
    client.send("edit", values={"red.reflectance": [0.05, 0.05, 0.6]})
    pixels = finished(client, 1)
    red, _, blue = pixels[64, 96]
    assert blue > 5 * red


def test_layers(client: Client) -> None:
    finished(client, 0)
    client.send("show", layer="albedo")
    finished(client, 0)
    assert client.picture is not None
    assert client.picture.limits == (0, 1)
    np.testing.assert_allclose(client.picture.pixels[64, 96], RED, rtol=1e-3)
    client.send("show", layer="shape")
    finished(client, 0)
    colours = {tuple(pixel) for row in client.picture.pixels.tolist() for pixel in row}
    assert len(colours) == 2 and (0, 0, 0) in colours  # the ball, and nothing
    client.send("show", layer="normal")
    finished(client, 0)
    np.testing.assert_allclose(client.picture.pixels[64, 96], (0, 0, 1), atol=0.02)
    client.send("show", layer="")
    samples = client.wait_for("progress", state="finished")["samples"]
    assert samples == 32, "the picture was rendered before"


def test_a_crop_window(client: Client) -> None:
    whole = finished(client, 0)
    client.send("crop", window=[80, 40, 32, 48])
    picture = finished(client, 1)
    assert picture.shape == (48, 32, 3)
    np.testing.assert_array_equal(picture, whole[40:88, 80:112])
    client.send("crop", window=None)
    np.testing.assert_array_equal(finished(client, 2), whole)


def test_the_number_of_samples(client: Client) -> None:
    assert client.wait_for("progress", state="finished")["samples"] == 32
    client.send("limit", samples=64)
    assert client.wait_for("progress", state="finished", samples=64)["limit"] == 64


def test_the_integrator(client: Client) -> None:
    finished(client, 0)
    client.send("edit", values=moved(0.3))
    client.wait_for("progress", state="finished")
    client.send("choose", integrator="direct")
    found = client.wait_for("viewed", integrator="direct")
    assert found["sensor"]["to_world"][0][3] == 0.3, "the camera stays"
    client.send("choose", integrator="nonsense")
    assert "nonsense" in client.wait_for("refused")["message"]


def test_pausing(client: Client) -> None:
    client.send("limit", samples=1 << 20)
    client.wait_for_picture(0, whole=True)
    client.send("pause")
    client.wait_for("progress", state="paused")
    before = client.pictures
    with pytest.raises(TimeoutError):
        while True:
            client.receive(timeout=0.5)
    assert client.pictures <= before + 1
    client.send("resume")
    client.wait_for("progress", state="rendering")


def test_messages_in_any_order_end_no_render(client: Client) -> None:
    """Cancelled passes, wherever they were, are no failures."""
    random = np.random.default_rng(3)
    kinds = [
        lambda: {"type": "show", "layer": str(random.choice(["", "albedo", "shape", "samples"]))},
        lambda: {"type": "edit", "values": {"sensor.fov": float(random.uniform(10, 90))}},
        lambda: {"type": "inspect", "x": int(random.integers(192)), "y": int(random.integers(128))},
        lambda: {"type": "crop", "window": [None, [10, 10, 50, 60], [0, 0, 1, 1]][random.integers(3)]},
        lambda: {"type": str(random.choice(["pause", "resume"]))},
        lambda: {"type": "limit", "samples": [None, 1, 64, 100000][random.integers(4)]},
    ]
    for _ in range(300):
        client.send(**kinds[random.integers(len(kinds))]())
        for _ in range(random.integers(4)):
            with suppress(TimeoutError):
                client.receive(timeout=0.02)
    for message in ({"type": "resume"}, {"type": "limit", "samples": 4}, {"type": "show", "layer": ""}):
        client.send(**message)
    client.wait_for("progress", state="finished", limit=4)
    assert "failed" not in client.messages and "refused" not in client.messages


# --- pixels and objects -------------------------------------------------------------------------------------


def test_a_pixel_tells_what_it_shows(client: Client, scene: Path) -> None:
    pixels = finished(client, 0)
    client.send("inspect", x=96, y=64)
    found = client.wait_for("inspected")
    np.testing.assert_allclose(found["value"], pixels[64, 96], rtol=1e-3)
    assert (found["shape"], found["material"], found["model"]) == ("ball", "red", "diffuse")
    assert found["samples"] == 32 and 0 < found["error"] < 1
    assert found["distance"] == pytest.approx(3, abs=0.01)
    assert found["place"] == f"{scene}:10" and found["material_place"] == f"{scene}:9"
    client.send("inspect", x=0, y=0)
    assert client.wait_for("inspected", x=0)["shape"] is None


def test_the_command_of_a_pixel_repeats_it(
    client: Client, scene: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    finished(client, 0)
    client.send("inspect", x=96, y=64)
    found = client.wait_for("inspected")
    words = shlex.split(found["command"])
    assert words[:2] == ["lajolla", "render"] and main(words[1:]) == 0
    np.testing.assert_allclose([float(x) for x in capfd.readouterr().out.split()], found["value"], rtol=1e-4)
    client.send("edit", values={"red.reflectance": [0.1, 0.2, 0.3]})
    finished(client, 1)
    client.send("inspect", x=96, y=64)
    found = client.wait_for("inspected")
    words = shlex.split(found["command"])
    assert words[:2] == ["python", "-c"]
    exec(words[2], {})
    np.testing.assert_allclose([float(x) for x in capfd.readouterr().out.split()], found["value"], rtol=1e-4)


def test_objects_and_their_parameters(client: Client) -> None:
    client.send("objects", search="")
    names = [found["name"] for found in client.wait_for("objects")["objects"]]
    assert {"sensor", "film", "ball", "red", "sky"} <= set(names)
    client.send("objects", search="diff")
    assert [found["name"] for found in client.wait_for("objects")["objects"]] == ["red"]
    client.send("parameters", object="red")
    found = client.wait_for("parameters")
    (reflectance,) = [p for p in found["parameters"] if p["name"] == "reflectance"]
    np.testing.assert_allclose(reflectance["value"], RED)
    assert found["place"].endswith("scene.xml:9") and reflectance["doc"]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        ({"type": "edit", "values": {"red.reflectence": [1, 0, 0]}}, "red.reflectance"),
        ({"type": "edit", "values": {"sensor.fov": 500.0}}, "fov"),
        ({"type": "edit", "values": {"sensor.to_world": "nonsense"}}, "to_world"),
        ({"type": "crop", "window": [0, 0, 65536, 65536]}, "film"),
        ({"type": "show", "layer": "nonsense"}, "nonsense"),
        ({"type": "parameters", "object": "nonsense"}, "nonsense"),
        ({"type": "focus", "x": 96, "y": 64}, "lens"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_what_cannot_be_done_is_refused(client: Client, message: dict[str, object], reason: str) -> None:
    finished(client, 0)
    client.send(**message)  # type: ignore[arg-type]
    text = client.wait_for("refused")["message"]
    assert reason in text and "\n" not in text
    client.send("edit", values=moved(0.5))
    finished(client, 1)


def test_a_lens_is_focused_on_what_is_clicked(scene: Path) -> None:
    lens = '<sensor type="thinlens"><float name="aperture_radius" value="0.1"/>'
    scene.write_text(SCENE.replace('<sensor type="perspective">', lens))
    with viewer(scene) as address, Client(address) as client:
        finished(client, 0)
        client.send("focus", x=48, y=32)
        assert client.wait_for("viewed", view=1)["sensor"]["focus_distance"] == pytest.approx(3, abs=0.05)
        client.send("focus", x=0, y=0)
        assert "nothing" in client.wait_for("refused")["message"]


# --- files --------------------------------------------------------------------------------------------------


def test_the_picture_is_saved(scene: Path, tmp_path: Path) -> None:
    with viewer(scene) as address, Client(address) as client:
        finished(client, 0)
        with urllib.request.urlopen(f"{address}picture.exr") as answer:
            (tmp_path / "saved.exr").write_bytes(answer.read())
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(f"{address}reference")
    expected = lajolla.load(scene).render(spp=32)
    np.testing.assert_array_equal(lajolla.Image.open(tmp_path / "saved.exr").array, expected.array)


def test_a_picture_to_compare_with(scene: Path, tmp_path: Path) -> None:
    lajolla.load(scene).render(spp=1).save(tmp_path / "other.exr")
    with viewer(scene, "--compare", str(tmp_path / "other.exr")) as address, Client(address) as client:
        client.wait_for_picture(0)
        assert client.messages["hello"]["reference"]
        with urllib.request.urlopen(f"{address}reference") as answer:
            assert len(answer.read()) == 56 + 96 * 64 * 6


def test_a_changed_file_is_read_again_and_the_camera_stays(scene: Path) -> None:
    with viewer(scene) as address, Client(address) as client:
        finished(client, 0)
        client.send("edit", values={**moved(0.4), "red.reflectance": [0.3, 0.3, 0.3]})
        finished(client, 1)
        scene.write_text(SCENE.replace("0.6, 0.05, 0.05", "0.05, 0.6, 0.05"))
        found = client.wait_for("viewed", view=2)
        assert found["sensor"]["to_world"][0][3] == 0.4
        red, green, _ = finished(client, 2)[32, 40]
        assert green > 3 * red


def test_a_broken_file_keeps_the_last_scene_and_says_why(scene: Path) -> None:
    with viewer(scene) as address, Client(address) as client:
        finished(client, 0)
        scene.write_text(SCENE.replace('id="red"/></shape>', 'id="rad"/></shape>'))
        assert 'did you mean "red"' in client.wait_for("failed")["message"]
        client.send("edit", values=moved(0.4))
        finished(client, 1)
        scene.write_text(SCENE)
        client.wait_for("opened")


def test_warnings_come_with_their_excerpts(scene: Path) -> None:
    scene.write_text(SCENE.replace('"diffuse"', '"diffus"'))
    with viewer(scene) as address, Client(address) as client:
        client.wait_for_picture(0)
        (warning,) = client.messages["opened"]["warnings"]
        assert "diffus" in warning and "<bsdf" in warning and "^" in warning


def test_a_scene_that_cannot_be_opened(scene: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scene.write_text("<scene>")
    assert main(["view", str(scene), "--no-browser"]) == 1
    assert "scene.xml:1" in capfd.readouterr().err


# --- connections --------------------------------------------------------------------------------------------


def test_a_dead_page_does_not_stop_the_render(scene: Path) -> None:
    with viewer(scene) as address:
        with Client(address) as client:
            client.wait_for_picture(0)
        with Client(address) as client:
            client.wait_for("progress", state="finished", samples=32)


def test_a_page_that_comes_back_sees_the_last_view(scene: Path) -> None:
    with viewer(scene) as address:
        with Client(address) as client:
            finished(client, 0)
            client.send("edit", values=moved(0.4))
            last = finished(client, 1)
        with Client(address) as client:
            picture = client.wait_for_picture(1, whole=True)
            assert client.messages["viewed"]["sensor"]["to_world"][0][3] == 0.4
            np.testing.assert_array_equal(picture.pixels, last)


def test_two_pages_see_the_same(scene: Path) -> None:
    with viewer(scene) as address, Client(address) as one, Client(address) as other:
        one.send("edit", values=moved(0.4))
        assert other.wait_for("viewed", view=1)["sensor"]["to_world"][0][3] == 0.4


def test_a_page_that_takes_no_pictures_gets_one_alone(scene: Path) -> None:
    with viewer(scene) as address, Client(address) as slow:
        slow.send = lambda *words, **fields: None  # type: ignore[method-assign]
        with Client(address) as client:
            for step in range(5):
                client.send("edit", values=moved(0.1 * step))
                client.wait_for_picture(step + 1)
        time.sleep(0.2)
        with pytest.raises(TimeoutError):
            while True:
                slow.receive(timeout=0.5)
        assert slow.pictures <= 1


# --- parts --------------------------------------------------------------------------------------------------


def test_a_render_that_fails_says_why_and_goes_on_after_a_change(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: queue.Queue[Picture | str] = queue.Queue()
    rules = StopRules(spp=2, noise=ALWAYS, adaptive=False)
    session = Session(lambda integrator: lajolla.load(scene, integrator=integrator), rules, 1, told.put)
    with monkeypatch.context() as patch:
        patch.setattr(View, "picture", lambda view, layer: 1 / 0)
        session.start()
        while not isinstance(text := told.get(timeout=20), str) or json.loads(text)["type"] != "failed":
            pass
        assert "the render ended: ZeroDivisionError" in json.loads(text)["message"]
    session.post(Message("edit", {"values": {"sensor.fov": 30.0}}))
    while not isinstance(picture := told.get(timeout=20), Picture) or not picture.is_whole:
        pass
    assert picture.view == 1 and "failed" not in session.state
    session.close()


def test_edits_that_wait_become_one() -> None:
    a, b = (Message("edit", {"values": {"x": value, str(value): 0}}) for value in (1, 2))
    found = merged([a, b, Message("pause", {}), a])
    assert [message.type for message in found] == ["edit", "pause", "edit"]
    assert found[0]["values"] == {"x": 2, "1": 0, "2": 0}


def test_previews_fit_their_time() -> None:
    pace = Pace()
    pace.measure("", 1e5, 1.0)
    first, *others = pace.divisors("", 512 * 512)
    assert 512 * 512 / first**2 <= 1e5 * FIRST_SECONDS < 512 * 512 / (first / 2) ** 2
    assert others == [first // 4]
    assert list(Pace().divisors("", 32 * 32)) == []


def test_views_of_a_fast_scene_need_no_preview() -> None:
    pace = Pace()
    pace.measure("", 1e9, 1.0)
    assert list(pace.divisors("", 512 * 512)) == []
