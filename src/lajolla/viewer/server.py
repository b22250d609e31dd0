"""The viewer's web server: the page, and a WebSocket for the pictures and what the page asks for.

It listens on this machine alone. The address has a random token, which no other page of the browser and no
other user knows; the Host header must be ours, so that no name of another site leads here (DNS rebinding),
and so must be the Origin.
"""

from __future__ import annotations

import asyncio
import errno
import secrets
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from importlib import resources
from urllib.parse import urlsplit

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from lajolla.viewer.protocol import LONGEST_MESSAGE, Message, Picture, ProtocolError, bands, parse

HOST = "127.0.0.1"
MOST_CONNECTIONS = 16
MOST_WAITING = 256  # messages of a page that does not take them; it can connect again
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob: data:; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}

Answer = tuple[str, bytes]  # content type, body


@dataclass
class Handlers:
    """What the server calls, in its own thread.

    Attributes:
        received: for a message of a page; returns the answer, if there is one.
        download: for a file that a page asks for, by its name; None if there is none.
        greeting: returns what a new page has to know.
    """

    received: Callable[[Message], Awaitable[str | None]]
    download: Callable[[str], Awaitable[Answer | None]]
    greeting: Callable[[], list[Picture | str]]


@dataclass(eq=False)
class Page:
    """A connected page. It has at most one picture on its way; later ones replace each other."""

    connection: ServerConnection
    messages: asyncio.Queue[str] = field(default_factory=lambda: asyncio.Queue(MOST_WAITING))
    picture: Picture | None = None  # the next one
    may_send: bool = True  # it has shown the last one
    wake: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def is_idle(self) -> bool:
        """Whether it has all that was offered."""
        return self.messages.empty() and self.picture is None and self.may_send

    def offer(self, item: Picture | str) -> None:
        """Notes what to send."""
        if isinstance(item, Picture):
            self.picture = item
        elif self.messages.full():  # it is stuck
            self.connection.transport.abort()
        else:
            self.messages.put_nowait(item)
        self.wake.set()

    async def send(self) -> None:
        """Sends what was offered, until the connection ends."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            while not self.messages.empty():
                await self.connection.send(self.messages.get_nowait())
            if self.picture is not None and self.may_send:
                picture, self.picture, self.may_send = self.picture, None, False
                for band in bands(picture):
                    await self.connection.send(band)


class ViewServer:
    """Serves the page at `address`; pictures and messages are sent to all pages with `publish`."""

    def __init__(self, handlers: Handlers, port: int = 0) -> None:
        self.handlers = handlers
        self.port = port  # 0: any free one
        self.token = secrets.token_urlsafe(24)
        self.pages: set[Page] = set()
        self.files = _page_files()

    @property
    def origin(self) -> str:
        return f"http://{HOST}:{self.port}"

    @property
    def address(self) -> str:
        """What to open in the browser."""
        return f"{self.origin}/{self.token}/"

    @property
    def is_idle(self) -> bool:
        """Whether all pages have all that was published."""
        return all(page.is_idle for page in self.pages)

    async def start(self) -> Server:
        """Begins to listen. Raises OSError if the port cannot be used."""
        try:
            server = await serve(
                self._connected,
                HOST,
                self.port,
                process_request=self._answer,
                max_size=LONGEST_MESSAGE,
                max_queue=16,
                compression=None,  # of noise on one machine
                server_header=None,
            )
        except OSError as problem:
            reason = (
                "is taken" if problem.errno == errno.EADDRINUSE else f"cannot be used: {problem.strerror}"
            )
            raise OSError(f"port {self.port} {reason}; without --port, a free one is used") from None
        self.port = next(iter(server.sockets)).getsockname()[1]
        return server

    def publish(self, item: Picture | str) -> None:
        """Offers a picture or a message to all pages; called in the server's thread."""
        for page in self.pages:
            page.offer(item)

    # --- HTTP ---------------------------------------------------------------------------------------------

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The answer to a request; None opens a WebSocket."""
        problem = self._refusal(request)
        if problem is not None:
            return _response(problem, "text/plain", f"{problem.phrase}\n".encode())
        url = urlsplit(request.path)
        name = url.path.removeprefix(f"/{self.token}/")
        if name == "socket":
            if request.headers.get("Origin") != self.origin or len(self.pages) >= MOST_CONNECTIONS:
                return _response(HTTPStatus.FORBIDDEN, "text/plain", b"Forbidden\n")
            return None
        if name in self.files:
            return _response(HTTPStatus.OK, *self.files[name])
        answer = await self.handlers.download(name)
        if answer is None:
            return _response(HTTPStatus.NOT_FOUND, "text/plain", b"Not Found\n")
        return _response(HTTPStatus.OK, *answer)

    def _refusal(self, request: Request) -> HTTPStatus | None:
        """Why a request is not ours, if so."""
        if request.headers.get_all("Host") != [f"{HOST}:{self.port}"]:
            return HTTPStatus.MISDIRECTED_REQUEST
        if request.headers.get("Origin", self.origin) != self.origin:
            return HTTPStatus.FORBIDDEN
        if getattr(request, "method", "GET") != "GET":  # older versions of the library refuse others
            return HTTPStatus.METHOD_NOT_ALLOWED
        given = request.path.split("/")[1:2]
        if not given or not secrets.compare_digest(given[0].encode(), self.token.encode()):
            return HTTPStatus.NOT_FOUND
        return None

    # --- WebSocket ----------------------------------------------------------------------------------------

    async def _connected(self, connection: ServerConnection) -> None:
        page = Page(connection)
        self.pages.add(page)
        for item in self.handlers.greeting():
            page.offer(item)
        sender = asyncio.create_task(page.send())
        try:
            async for data in connection:
                await self._received(page, data)
        except ProtocolError as problem:
            await connection.close(1008, str(problem)[:100])
        except ConnectionClosed:  # the tab is gone; the render goes on
            pass
        finally:
            self.pages.discard(page)
            sender.cancel()
            with suppress(asyncio.CancelledError, ConnectionClosed):
                await sender

    async def _received(self, page: Page, data: str | bytes) -> None:
        message = parse(data)
        if message.type == "received":
            page.may_send = True
            page.wake.set()
            return
        answer = await self.handlers.received(message)
        if answer is not None:
            page.offer(answer)


def _response(status: HTTPStatus, content_type: str, body: bytes) -> Response:
    lengths = {"Content-Type": content_type, "Content-Length": str(len(body)), "Connection": "close"}
    return Response(status.value, status.phrase, Headers({**HEADERS, **lengths}), body)


def _page_files() -> dict[str, Answer]:
    """The files of the page by their names; "" is the page itself."""
    found = {}
    for file in resources.files("lajolla.viewer").joinpath("page").iterdir():
        kind = TYPES.get(file.name[file.name.rfind(".") :])
        if kind is not None:
            found[file.name] = (f"{kind}; charset=utf-8", file.read_bytes())
    return {**found, "": found["index.html"]}
