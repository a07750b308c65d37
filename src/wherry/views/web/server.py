"""The page server for live runs, recorded runs and the world editor; it runs in a thread of its own."""

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
from wherry.views.web.access import AccessMiddleware, AccessPolicy
from wherry.views.web.broadcast import TraceBroadcast
from wherry.views.web.page import player_page

DEFAULT_HOST = "127.0.0.1"
DEFAULT_PORT = 8642
WILDCARD_ADDRESSES = {"0.0.0.0", "::"}  # noqa: S104 - URLs contain the machine's name instead
MAX_REQUEST_SIZE = 4_096  # bytes of a message from a page
RUN_OVER, HAS_REPORT = 1, 2  # bits of the flags in a message to a page
REPORT_FILE_NAME = "report.html"
SEND_PERIOD = 0.03  # s between two messages to a page
RECONNECT_TIMEOUT = 2.0  # s without a connected page after which all pages count as closed; a reload takes less
POLL_PERIOD = 0.2  # s between two checks for connected pages


class PageServer:
    """A running server.

    Attributes:
        url: Address of the page, including the token if requests need one.
        occupied_port: The requested port, if another program uses it; otherwise None.
        page_count: Number of connected pages.
        was_opened: Whether any page was ever connected.
    """

    def __init__(self, url: str, occupied_port: int | None = None) -> None:
        self.url = url
        self.occupied_port = occupied_port
        self.page_count = 0
        self.was_opened = False

    def page_connected(self) -> None:
        """Count a page that has connected."""
        self.page_count, self.was_opened = self.page_count + 1, True

    def page_disconnected(self) -> None:
        """Count a page that has disconnected."""
        self.page_count -= 1

    def wait_until_unwatched(self, timeout: float = math.inf) -> bool:
        """Wait until at least one page was opened and all pages are closed.

        Args:
            timeout: Time to wait for the first page, s.

        Returns:
            Whether a page was opened before the timeout.
        """
        waited = unwatched = 0.0
        while unwatched < RECONNECT_TIMEOUT:
            if not self.was_opened and waited >= timeout:
                return False
            time.sleep(POLL_PERIOD)
            waited += POLL_PERIOD
            unwatched = unwatched + POLL_PERIOD if self.was_opened and self.page_count == 0 else 0.0
        return True


@contextlib.contextmanager
def serve_run(
    broadcast: TraceBroadcast,
    title: str,
    *,
    host: str = DEFAULT_HOST,
    port: int = DEFAULT_PORT,
    folder: Path | None = None,
) -> Iterator[PageServer]:
    """Serve a page that shows a run until the context ends.

    Args:
        broadcast: The buffer of the run's frames.
        title: Title of the window.
        host: Address to listen on; pages need a token unless it is a loopback address.
        port: Port to listen on; another one is used if it is occupied. 0 for any free port.
        folder: Folder of the run's results, to which the page links.

    Raises:
        InputError: The address cannot be listened on.
    """

    async def page(request: Request) -> Response:
        return HTMLResponse(player_page(title, {"source": "socket"}))

    async def frames(websocket: WebSocket) -> None:
        await websocket.accept()
        with _counted(server):
            await _send_frames(websocket, broadcast, None if folder is None else folder / REPORT_FILE_NAME)

    routes: list[BaseRoute] = [Route("/", page), WebSocketRoute("/socket", frames)]
    if folder is not None:
        routes.append(Mount("/files", StaticFiles(directory=folder, html=True)))
    with run_server(routes, host=host, port=port) as server:
        yield server


@contextlib.contextmanager
def serve_recording(
    frames: bytes, title: str, *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT, folder: Path | None = None
) -> Iterator[PageServer]:
    """Serve a page that plays a recorded run until the context ends.

    Args:
        frames: Frames as from `recordings.load_frames`.
        title: Title of the window.
        host: Address to listen on; pages need a token unless it is a loopback address.
        port: Port to listen on; another one is used if it is occupied. 0 for any free port.
        folder: Folder of the run's results, to which the page links.

    Raises:
        InputError: The address cannot be listened on.
    """
    broadcast = TraceBroadcast()
    for frame in split_frames(frames):
        broadcast.add(frame, is_snapshot=False)  # a recording keeps all its snapshots
    broadcast.end()
    with serve_run(broadcast, title, host=host, port=port, folder=folder) as server:
        yield server


@contextlib.contextmanager
def run_server(
    routes: Sequence[BaseRoute], *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT
) -> Iterator[PageServer]:
    """Serve the given routes from a thread until the context ends.

    Raises:
        InputError: The address cannot be listened on.
    """
    listener, requested_port = _listen(host, port), port
    port = listener.getsockname()[1]
    is_loopback = host in {"127.0.0.1", "localhost", "::1"}
    token = None if is_loopback else secrets.token_urlsafe(16)
    server = PageServer(_url(host, port, token), None if requested_port in (0, port) else requested_port)
    config = uvicorn.Config(
        AccessMiddleware(Starlette(routes=routes), AccessPolicy(port, token)),
        ws="websockets-sansio",
        ws_max_size=MAX_REQUEST_SIZE,
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


def _url(host: str, port: int, token: str | None) -> str:
    """The URL of a server's page."""
    name = socket.gethostname() if host in WILDCARD_ADDRESSES else host
    authority = f"[{name}]:{port}" if ":" in name else f"{name}:{port}"
    return f"http://{authority}/" + (f"?token={token}" if token else "")


def _listen(host: str, port: int) -> socket.socket:
    """A socket that listens on a port or, if it is occupied, on any free one.

    Raises:
        InputError: The address cannot be listened on.
    """
    error: OSError | None = None
    for candidate in (port, 0):
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            return socket.create_server((host, candidate), family=family)
        except OSError as failure:
            error = failure
    raise InputError("--host", host, f"cannot be listened on: {error.strerror if error else ''}") from error


@contextlib.contextmanager
def _counted(server: PageServer) -> Iterator[None]:
    """Count a page as connected until the context ends."""
    server.page_connected()
    try:
        yield
    finally:
        server.page_disconnected()


async def hold_connection(websocket: WebSocket, server: PageServer) -> None:
    """Accept a page's socket and count the page as connected until it disconnects."""
    await websocket.accept()
    with _counted(server):
        await _wait_for_disconnection(websocket)


async def _send_frames(websocket: WebSocket, broadcast: TraceBroadcast, report: Path | None) -> None:
    """Send all buffered frames, then new ones, until the page disconnects.

    A message consists of the index of the first frame after it, the flags `RUN_OVER` and `HAS_REPORT`, and frames.

    Args:
        websocket: The page's socket; its query names the run and the frame to continue from, if the page has any.
        broadcast: The buffer of the run's frames.
        report: Path of the run's report; None if the run has none.
    """
    query = websocket.query_params
    can_continue = query.get("run") == broadcast.run_id and query.get("from", "").isdecimal()
    index = min(int(query["from"]), len(broadcast)) if can_continue else 0
    with contextlib.suppress(WebSocketDisconnect):
        await websocket.send_json({"run": broadcast.run_id, "from": index})
        disconnected = asyncio.create_task(_wait_for_disconnection(websocket))
        sent_end = False
        while not disconnected.done():
            ended = broadcast.ended  # read before the frames, since none is added once it is set
            batch = broadcast.batch_from(index) if index < len(broadcast) else None
            if batch is not None:
                index = batch.next_index
            over = ended and index == len(broadcast)
            if batch is not None or over != sent_end:
                sent_end = over
                flags = RUN_OVER * over | HAS_REPORT * (over and report is not None and report.is_file())
                await websocket.send_bytes(struct.pack("<II", index, flags) + (batch.frames if batch else b""))
            await asyncio.sleep(SEND_PERIOD)


async def _wait_for_disconnection(websocket: WebSocket) -> None:
    """Wait until a page disconnects; its messages are ignored."""
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            await websocket.receive_text()
