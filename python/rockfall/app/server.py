# SPDX-License-Identifier: BSD-3-Clause
"""Local server of the page: it serves the page's files, and a websocket for everything else.

Access is limited to this machine and page: the socket is bound to 127.0.0.1, Host and Origin must
match, and the first message must contain the key from the URL fragment (a cookie would be shared
by all ports of 127.0.0.1). The page cannot choose a path to open.
"""

from __future__ import annotations

import asyncio
import html
import os
import secrets
import socket
import webbrowser
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from rockfall.app.messages import MAX_BYTES, Message, Refused, read_message, text_message
from rockfall.app.outbox import Client, Outbox
from rockfall.app.web_map import origin_of
from rockfall.errors import RockfallError

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.types import ASGIApp, Receive, Scope
    from starlette.types import Send as Sends
    from starlette.websockets import WebSocket

    from rockfall.app.room import Room

HOST = "127.0.0.1"
PAGE = Path(__file__).with_name("page")
FILES = {  # URL paths of the page's files
    "/": ("index.html", "text/html"), "/app.js": ("app.js", "text/javascript"),
    "/app.css": ("app.css", "text/css"), "/licences.txt": ("licences.txt", "text/plain"),
}  # fmt: skip
HELLO_SECONDS = 5.0  # time limit of the first message [s]
TAKE_SECONDS = 30.0  # time for a page to accept a message [s]; below uvicorn's ping limit of 40 s
GRACE_SECONDS = 10.0  # wait after the last page closes [s], in case of a reload
WRONG_KEY = 4401  # websocket close code


def bind(port: int) -> socket.socket:
    """Bind a socket on this machine only; port 0 selects any free port. Raises a RockfallError if
    the port cannot be used."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((HOST, port))
    except (OSError, OverflowError) as error:
        bound.close()
        reason = getattr(error, "strerror", None) or error
        raise RockfallError(f"--port {port}: cannot be used: {reason}") from error
    return bound


def check_page(page: Path) -> None:
    """Raise a RockfallError if the page is missing: it is built, not stored in the repository."""
    if not (page / "app.js").is_file():
        raise RockfallError("the page of the window is not built: run `./run page`")


class Server:
    """Server of a room on a bound socket, until the last page closes. It starts before the room is
    open: pages wait for `admit`."""

    def __init__(
        self, bound: socket.socket, *, page: Path | None = None, keep: bool = False, wms: str = "",
        grace: float = GRACE_SECONDS,
    ) -> None:  # fmt: skip
        import uvicorn

        page = page or PAGE
        check_page(page)
        self._bound, self._keep, self._grace = bound, keep, grace
        self.port, self.key = bound.getsockname()[1], secrets.token_urlsafe(24)
        self._opening: Future[Room] = Future()
        self._left: asyncio.TimerHandle | None = None
        bound.listen()  # clients may connect now; they are served once the server runs
        app = _Guard(self._app(page), self.port, origin_of(wms))
        config = uvicorn.Config(
            app, log_level="error", access_log=False, lifespan="off", server_header=False,
            date_header=False, ws="websockets-sansio", ws_max_size=MAX_BYTES,
            ws_per_message_deflate=False, timeout_graceful_shutdown=1,
        )  # fmt: skip
        self._server = uvicorn.Server(config)

    @property
    def url(self) -> str:
        """Address of the page; the key is in the fragment, which browsers do not send."""
        return f"http://{HOST}:{self.port}/#key={self.key}"

    def run(self) -> None:
        """Serve until the last page closes or `stop` is called."""
        try:
            self._server.run(sockets=[self._bound])
        finally:
            if self._opening.done() and not self._opening.exception():
                self._opening.result().close()
            self._bound.close()

    def stop(self) -> None:
        """Stop serving; may be called from any thread."""
        self._server.should_exit = True

    def admit(self, room: Room) -> None:
        """Connect waiting and later pages to a room; may be called from any thread."""
        self._opening.set_result(room)

    def refuse(self, error: RockfallError) -> None:
        """Report to the first page why there is no document, then stop; callable from any
        thread."""
        self._opening.set_exception(error)

    def _app(self, page: Path) -> Starlette:
        from starlette.applications import Starlette
        from starlette.requests import Request
        from starlette.responses import Response
        from starlette.routing import Route, WebSocketRoute

        def served(file: str, kind: str) -> Callable[[Request], Response]:
            def respond(_: Request) -> Response:
                return Response((page / file).read_bytes(), media_type=kind)

            return respond

        there = {path: entry for path, entry in FILES.items() if (page / entry[0]).is_file()}
        routes = [Route(path, served(*entry), methods=["GET"]) for path, entry in there.items()]
        return Starlette(routes=[*routes, WebSocketRoute("/live", self._live)])

    async def _live(self, socket: WebSocket) -> None:
        """Handle the websocket of a page."""
        from starlette.websockets import WebSocketDisconnect

        await socket.accept()
        try:
            hello = await self._hello(socket)
            if hello is None:
                await socket.close(WRONG_KEY)
                return
            try:
                room = await asyncio.shield(asyncio.wrap_future(self._opening))
            except RockfallError as error:
                await socket.send_text(text_message("fault", text=str(error)))
                self.stop()
                return
            await self._serve(socket, room, hello)
        except WebSocketDisconnect:
            pass

    async def _hello(self, socket: WebSocket) -> dict[str, Any] | None:
        """First message if it contains the key, else None."""
        try:
            given = read_message(await asyncio.wait_for(_text(socket), HELLO_SECONDS))
        except (TimeoutError, Refused):
            return None
        key = given.get("key")
        valid = isinstance(key, str) and key.isascii() and secrets.compare_digest(key, self.key)
        return given if valid and given["type"] == "hello" else None

    async def _serve(self, socket: WebSocket, room: Room, hello: dict[str, Any]) -> None:
        """Pass messages both ways until the page closes or stops reading."""
        outbox = Outbox(asyncio.get_running_loop())
        client = Client(outbox.put)
        if self._left is not None:
            self._left.cancel()
            self._left = None
        sender = asyncio.ensure_future(_send_all(socket, outbox))
        try:
            await asyncio.to_thread(room.enter, client, hello)
            listener = asyncio.ensure_future(_listen(socket, room, client))
            both = sender, listener
            done, others = await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            for task in others:
                task.cancel()
            for task in done - {sender}:
                task.result()
        finally:
            sender.cancel()
            await asyncio.shield(asyncio.to_thread(room.leave, client))
            if not self._keep and room.is_empty:
                self._end_later(room)

    def _end_later(self, room: Room) -> None:
        """Stop after some seconds without a page; running tasks finish first."""

        def end() -> None:
            if not room.is_empty:  # a page connected meanwhile
                return
            if room.is_busy:
                self._end_later(room)
            else:
                self.stop()

        self._left = asyncio.get_running_loop().call_later(self._grace, end)


async def _listen(socket: WebSocket, room: Room, client: Client) -> None:
    """Perform the requests of a page in order."""
    while True:
        text = await _text(socket)
        await asyncio.to_thread(room.take, client, text)


async def _text(socket: WebSocket) -> str:
    """Text of the next message of a page; "" for a binary message."""
    from starlette.websockets import WebSocketDisconnect

    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1000))
    return message.get("text") or ""


async def _send_all(socket: WebSocket, outbox: Outbox) -> None:
    """Send messages as fast as the page accepts them; give up if it stalls."""
    while True:
        message: Message = await outbox.get()
        sent = socket.send_text(message) if isinstance(message, str) else socket.send_bytes(message)
        await asyncio.wait_for(sent, TAKE_SECONDS)


class _Guard:
    """Middleware that accepts requests from this page only, and adds headers to responses."""

    def __init__(self, app: ASGIApp, port: int, images: str) -> None:
        self._app = app
        self._hosts = {f"{name}:{port}".encode() for name in (HOST, "localhost")}
        sockets = " ".join(f"ws://{host.decode()}" for host in sorted(self._hosts))
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; "
            f"img-src 'self' blob: data: {images}; "
            f"connect-src {sockets}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        )
        self._headers = [
            (name.encode(), value.encode())
            for name, value in {
                "content-security-policy": policy, "x-content-type-options": "nosniff",
                "referrer-policy": "no-referrer", "cache-control": "no-store",
                "cross-origin-opener-policy": "same-origin",
                "cross-origin-resource-policy": "same-origin",
            }.items()
        ]  # fmt: skip

    async def __call__(self, scope: Scope, receive: Receive, send: Sends) -> None:
        if scope["type"] not in ("http", "websocket"):
            return
        socket = scope["type"] == "websocket"
        if not self._admits(scope["headers"], socket):
            if socket:
                await send({"type": "websocket.close", "code": 1008})  # sent as HTTP 403
                return
            headers = [*self._headers, (b"content-type", b"text/plain")]
            await send({"type": "http.response.start", "status": 403, "headers": headers})
            await send({"type": "http.response.body", "body": b"forbidden"})
            return

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *self._headers]
            await send(message)

        await self._app(scope, receive, with_headers)

    def _admits(self, headers: list[tuple[bytes, bytes]], socket: bool) -> bool:
        """Return True if the Host header and (for a websocket) the Origin header match this
        server."""
        hosts = [value for name, value in headers if name == b"host"]
        origins = [value for name, value in headers if name == b"origin"]
        if len(hosts) != 1 or hosts[0] not in self._hosts or len(origins) > 1:
            return False
        return origins == [b"http://" + hosts[0]] if origins or socket else True


def open_browser(url: str) -> TemporaryDirectory[str]:
    """Open the page in the user's browser, if any, through a temporary redirect file, because
    command lines are visible to all users and must not contain the key. Return the folder of the
    file (readable only by this user), to be removed once the page is open."""
    folder = TemporaryDirectory(prefix="rockfall-")
    path = Path(folder.name) / "window.html"
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(
            '<!doctype html><meta charset="utf-8"><title>rockfall</title>'
            f'<meta http-equiv="refresh" content="0; url={html.escape(url)}">'
        )
    webbrowser.open(path.as_uri())
    return folder
