"""A web server in a thread of its own, for as long as a run or a person needs it."""

from __future__ import annotations

import asyncio
import contextlib
import math
import secrets
import socket
import struct
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from wherry.errors import InputError
from wherry.trace.framing import split_frames
from wherry.views.web.broadcast import Broadcast
from wherry.views.web.guard import Door, Guard
from wherry.views.web.page import player_page

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8642
ANY_ADDRESS = {"0.0.0.0", "::"}  # noqa: S104 - to say how such a server is reached
LARGEST_REQUEST = 4_096  # bytes, of a message that a page may send
OVER, HAS_REPORT = 1, 2  # bits of a message
REPORT = "report.html"
SENT_EVERY = 0.03  # s between two messages to a page
LEAVING = 2.0  # s without a page after which everybody has gone
ASKED_EVERY = 0.2  # s between two looks at whether anybody is there


class Server:
    """A running server.

    Attributes:
        url: Where to look.
        pages: How many pages are connected.
        had_pages: Whether any ever was.
        taken_port: The port that was wished for, if it was taken.
    """

    def __init__(self, url: str, taken_port: int | None = None) -> None:
        self.url = url
        self.taken_port = taken_port
        self.pages = 0
        self.had_pages = False

    def page_came(self) -> None:
        """Count a page."""
        self.pages, self.had_pages = self.pages + 1, True

    def page_left(self) -> None:
        """Count one less."""
        self.pages -= 1

    def wait_until_nobody_watches(self, patience: float = math.inf) -> bool:
        """Wait until at least one page was there and all have been gone for a while.

        Args:
            patience: S to wait for the first page, if there was none yet.

        Returns:
            Whether there ever was a page.
        """
        waited = gone = 0.0
        while gone < LEAVING:
            if not self.had_pages and waited >= patience:
                return False
            time.sleep(ASKED_EVERY)
            waited += ASKED_EVERY
            gone = gone + ASKED_EVERY if self.had_pages and self.pages == 0 else 0.0
        return True


@contextlib.contextmanager
def serve(
    broadcast: Broadcast,
    title: str,
    *,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    folder: Path | None = None,
) -> Iterator[Server]:
    """Show a run on a page for as long as the context lasts.

    Args:
        broadcast: The sink that the run writes to.
        title: Of the window.
        host: The address to listen on; on another one than this machine's own, pages need a token.
        port: The port; where it is taken, any other. 0 for any.
        folder: The run's results, which the page links to.

    Raises:
        InputError: There is no listening on this address.
    """

    async def page(request: Request) -> Response:
        return HTMLResponse(player_page(title, {"source": "socket"}))

    async def frames(page: WebSocket) -> None:
        await page.accept()
        server.page_came()
        try:
            await _send_frames(page, broadcast, None if folder is None else folder / REPORT)
        finally:
            server.page_left()

    routes: list[BaseRoute] = [Route("/", page), WebSocketRoute("/socket", frames)]
    if folder is not None:
        routes.append(Mount("/files", StaticFiles(directory=folder, html=True)))
    with running(routes, host=host, port=port) as server:
        yield server


@contextlib.contextmanager
def serve_recording(
    frames: bytes, title: str, *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT, folder: Path | None = None
) -> Iterator[Server]:
    """Play a recorded trace on a page for as long as the context lasts.

    Args:
        frames: As from `recordings.load_frames`.
        title: As for `serve`, like the rest.
        host: The address.
        port: The port.
        folder: The run's results.

    Raises:
        InputError: There is no listening on this address.
    """
    broadcast = Broadcast()
    for frame in split_frames(frames):
        broadcast.add(frame, is_moment=False)
    broadcast.end()
    with serve(broadcast, title, host=host, port=port, folder=folder) as server:
        yield server


@contextlib.contextmanager
def running(routes: Sequence[BaseRoute], *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT) -> Iterator[Server]:
    """Run a server with these routes in a thread.

    Raises:
        InputError: There is no listening on this address.
    """
    listener, wanted = _listen(host, port), port
    port = listener.getsockname()[1]
    loopback = host in {"127.0.0.1", "localhost", "::1"}
    token = None if loopback else secrets.token_urlsafe(16)
    named = socket.gethostname() if host in ANY_ADDRESS else host
    shown_host = f"[{named}]" if ":" in named else named
    url = f"http://{shown_host}:{port}/" + (f"?token={token}" if token else "")
    server = Server(url, None if wanted in (0, port) else wanted)
    config = uvicorn.Config(
        Guard(Starlette(routes=routes), Door(port, token)),
        ws="websockets-sansio",
        ws_max_size=LARGEST_REQUEST,
        ws_per_message_deflate=False,
        lifespan="off",
        log_level="critical",
        access_log=False,
        server_header=False,
        date_header=False,
        timeout_graceful_shutdown=1,
    )
    engine = uvicorn.Server(config)
    thread = threading.Thread(target=engine.run, args=([listener],), name="web server", daemon=True)
    thread.start()
    try:
        yield server
    finally:
        engine.should_exit = True
        thread.join()
        listener.close()


def _listen(host: str, port: int) -> socket.socket:
    """A socket on the port or, where that is taken, on any.

    Raises:
        InputError: There is no such address on this machine.
    """
    error: OSError | None = None
    for wanted in (port, 0):
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            return socket.create_server((host, wanted), family=family)
        except OSError as problem:
            error = problem
    raise InputError("--host", host, f"cannot be listened on: {error.strerror if error else ''}") from error


async def _send_frames(page: WebSocket, broadcast: Broadcast, report: Path | None) -> None:
    """Send what there is and what comes, until the page goes.

    A message is the number of the first frame that is not in it, `OVER` and `HAS_REPORT` as bits, and frames.

    Args:
        page: Where to.
        broadcast: Whose frames.
        report: Where the run leaves its report, if it does.
    """
    query = page.query_params
    known = query.get("run") == broadcast.name and query.get("from", "").isdecimal()
    at = min(int(query["from"]), len(broadcast)) if known else 0
    with contextlib.suppress(WebSocketDisconnect):
        await page.send_json({"run": broadcast.name, "from": at})
        listening = asyncio.create_task(_until_it_leaves(page))
        told_end = False
        while not listening.done():
            ended = broadcast.ended  # asked first, so that nothing can come in between
            batch = broadcast.after(at) if at < len(broadcast) else None
            if batch is not None:
                at = batch.following
            over = ended and at == len(broadcast)
            if batch is not None or over != told_end:
                told_end = over
                bits = OVER * over | HAS_REPORT * (over and report is not None and report.is_file())
                await page.send_bytes(struct.pack("<II", at, bits) + (batch.frames if batch else b""))
            await asyncio.sleep(SENT_EVERY)


async def _until_it_leaves(page: WebSocket) -> None:
    """Wait for a page to go; nothing that it says matters."""
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            await page.receive_text()
