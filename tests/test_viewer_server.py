"""The viewer's server: who may ask, and for what."""

from __future__ import annotations

import http.client
import json
import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from viewer_tools import SCENE, Client, origin_of, viewer
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from lajolla.cli import main
from lajolla.viewer import protocol
from lajolla.viewer.protocol import Picture, ProtocolError, bands, parse, readable


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    scene = tmp_path_factory.mktemp("viewer") / "scene.xml"
    scene.write_text(SCENE)
    with viewer(scene) as address:
        yield address


def answer(address: str, path: str, **headers: str) -> tuple[int, str]:
    """The status and the body of a request, which is sent as it is."""
    url = urlsplit(address)
    connection = http.client.HTTPConnection(url.netloc, timeout=20)
    connection.putrequest("GET", path, skip_host=True)
    for name, value in {"Host": url.netloc, **headers}.items():
        connection.putheader(name, value)
    connection.endheaders()
    response = connection.getresponse()
    return response.status, response.read().decode("utf-8", "replace")


# --- HTTP ---------------------------------------------------------------------------------------------------


def test_the_page_and_its_files_are_served(address: str) -> None:
    path = urlsplit(address).path
    status, page = answer(address, path)
    assert status == 200 and "<canvas" in page
    for name in ("style.css", "main.js", "display.js", "camera.js", "connection.js", "panels.js", "icon.svg"):
        assert answer(address, path + name)[0] == 200


def test_the_page_requests_nothing_from_outside(address: str) -> None:
    path = urlsplit(address).path
    for name in ("", "style.css", "main.js", "display.js", "camera.js", "connection.js", "panels.js"):
        _, text = answer(address, path + name)
        assert "https://" not in text and "http://" not in text and "//cdn" not in text


def test_it_listens_on_this_machine_alone(address: str) -> None:
    port = urlsplit(address).port
    assert urlsplit(address).hostname == "127.0.0.1"
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for host in others - {"127.0.0.1"}:
        with socket.socket() as attempt:
            attempt.settimeout(2)
            assert attempt.connect_ex((host, port)) != 0, f"it answers at {host}"


def test_requests_without_the_token_are_refused(address: str) -> None:
    path = urlsplit(address).path
    wrong = path[:1] + ("A" if path[1] != "A" else "B") + path[2:]
    for bad in ("/", wrong, "/main.js", path.upper() + "x", "//" + path.strip("/") + "/", path[:-5] + "/"):
        status, body = answer(address, bad)
        assert status == 404 and "canvas" not in body, bad


def test_other_hosts_are_refused(address: str) -> None:
    """A name of another site that leads to 127.0.0.1, as in DNS rebinding, even with the right token."""
    url = urlsplit(address)
    for host in ("evil.example", f"evil.example:{url.port}", "127.0.0.1", f"127.0.0.1:{url.port + 1}", ""):
        assert answer(address, url.path, Host=host)[0] == 421, host


def test_other_origins_are_refused(address: str) -> None:
    path = urlsplit(address).path
    for origin in ("http://evil.example", "null", origin_of(address).replace("http", "https"), "file://"):
        assert answer(address, path, Origin=origin)[0] == 403, origin


@pytest.mark.parametrize(
    "name",
    [
        *("../server.py", "%2e%2e/server.py", "..%2fserver.py", "....//server.py", "/etc/passwd"),
        *("page/index.html", "main.js/", "main.js%00", "socket/..", "..", "%2e", "picture", "scene.xml"),
    ],
)
def test_only_the_files_of_the_page_are_served(address: str, name: str) -> None:
    status, body = answer(address, urlsplit(address).path + name)
    assert status == 404 and "import" not in body and "root:" not in body


def test_the_page_may_not_be_framed_or_load_from_elsewhere(address: str) -> None:
    url = urlsplit(address)
    connection = http.client.HTTPConnection(url.netloc, timeout=20)
    connection.request("GET", url.path)
    headers = connection.getresponse().headers
    assert "default-src 'self'" in headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Access-Control-Allow-Origin"] is None


def test_other_methods_and_long_requests_are_refused(address: str) -> None:
    url = urlsplit(address)
    assert url.hostname is not None
    for request in (
        f"POST {url.path} HTTP/1.1\r\nHost: {url.netloc}\r\nContent-Length: 0\r\n\r\n",
        f"GET {url.path}{'x' * 100_000} HTTP/1.1\r\nHost: {url.netloc}\r\n\r\n",
        f"GET {url.path} HTTP/1.1\r\nHost: {url.netloc}\r\n" + "A: b\r\n" * 1000 + "\r\n",
        "nonsense\r\n\r\n",
    ):
        with socket.create_connection((url.hostname, url.port), timeout=20) as raw:
            try:
                raw.sendall(request.encode())
                found = raw.recv(1 << 16)
            except ConnectionError:
                found = b""
            assert b" 200 " not in found.split(b"\r\n")[0], request[:40]
    assert answer(address, url.path)[0] == 200


# --- WebSocket ----------------------------------------------------------------------------------------------


def refused_status(address: str, **options: object) -> int:
    with pytest.raises(InvalidStatus) as refusal:
        connect(address.replace("http:", "ws:") + "socket", **options)  # type: ignore[arg-type]
    return refusal.value.response.status_code


def test_sockets_of_other_origins_are_refused(address: str) -> None:
    for origin in (None, "http://evil.example", "null", origin_of(address) + ".evil.example"):
        assert refused_status(address, origin=origin) == 403, origin


def test_sockets_without_the_token_are_refused(address: str) -> None:
    url = urlsplit(address)
    for path in ("/", "/wrong/", url.path[:-4] + "/"):
        assert refused_status(f"http://{url.netloc}{path}", origin=origin_of(address)) == 404


MALFORMED = [
    *("", "{", "null", "[]", "1", '"text"', "{}", '{"type": 1}', '{"type": "unknown"}', "[" * 50_000),
    *('{"type": "__init__"}', '{"type": "run"}', '{"type": "pause", "more": 1}', '{"type": "edit"}'),
    *('{"type": "inspect", "x": 0}', '{"type": "inspect", "x": -1, "y": 0}'),
    *('{"type": "inspect", "x": 1e99, "y": 0}', '{"type": "inspect", "x": true, "y": 0}'),
    *('{"type": "inspect", "x": NaN, "y": 0}', '{"type": "crop", "window": [0, 0, 1]}'),
    *('{"type": "save"}', '{"type": "save", "name": 1}', '{"type": "look", "sensor": null}'),
    *('{"type": "edit", "values": {}}', '{"type": "edit", "values": {"a": {"type": "bitmap"}}}'),
    *('{"type": "edit", "values": {"a": [[[1]]]}}', '{"type": "edit", "values": {"a": Infinity}}'),
    *('{"type": "edit", "values": {"a": null}}', '{"type": "samples", "limit": 0}'),
    json.dumps({"type": "edit", "values": {f"p{i}": 1 for i in range(1000)}}),
    json.dumps({"type": "show", "layer": "x" * 10_000}),
]


@pytest.mark.parametrize("text", MALFORMED, ids=lambda text: text[:40])
def test_malformed_messages_are_refused(text: str) -> None:
    with pytest.raises(ProtocolError):
        parse(text)


def test_binary_messages_are_refused() -> None:
    with pytest.raises(ProtocolError):
        parse(b'{"type": "pause"}')


@pytest.mark.parametrize("data", ["{", '{"type": "unknown"}', b"\x00\x01", "x" * 100_000])
def test_a_bad_message_ends_its_connection_alone(address: str, data: str | bytes) -> None:
    with Client(address) as good, Client(address) as bad:
        good.wait_for_picture(0)
        with pytest.raises(ConnectionClosed) as closed:
            bad.socket.send(data)
            while True:
                bad.socket.recv(timeout=20)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == (1009 if len(data) > protocol.LONGEST_MESSAGE else 1008)
        good.send("show", layer="depth")
        good.wait_for("progress", state="finished")


# --- pictures -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("height", "width"), [(1, 1), (3, 5), (700, 512)])
def test_pictures_arrive_as_they_were_sent(height: int, width: int) -> None:
    values = np.random.default_rng(1).uniform(0, 10, (height, width, 3)).astype(np.float32)
    sent = Picture(values, 7, 3, (1, 2, 30, 40), limits=(-1.0, 2.0))
    data = list(bands(sent))
    assert all(len(band) < 2 * protocol.BAND_BYTES for band in data)
    found = readable(data)
    assert (found.number, found.view, found.window, found.limits) == (7, 3, (1, 2, 30, 40), (-1.0, 2.0))
    np.testing.assert_array_equal(found.pixels, values.astype(np.float16).astype(np.float32))


def test_numbers_beyond_half_floats_are_their_largest() -> None:
    values = np.array([[[1e9, -1e9, 0]]], np.float32)
    np.testing.assert_array_equal(
        readable(list(bands(Picture(values, 0, 0, (0, 0, 1, 1))))).pixels, [[[65504, -65504, 0]]]
    )


def test_a_port_that_is_taken(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SCENE)
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert main(["view", str(tmp_path / "scene.xml"), "--no-browser", "--port", str(port)]) == 1
    assert f"error: port {port} is taken; without --port, a free one is used" in capfd.readouterr().err


def test_a_scene_that_is_missing(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["view", str(tmp_path / "missing.xml"), "--no-browser"]) == 1
    assert "missing.xml" in capfd.readouterr().err
