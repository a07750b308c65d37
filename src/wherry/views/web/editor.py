"""The world editor: a page that draws a world file, checked and saved by `wherry.floorplan.plan` alone."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from wherry.errors import InputError
from wherry.files import write_atomically
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import MAX_FILE_SIZE, format_world, load_world, parse_world
from wherry.views.web.page import assemble
from wherry.views.web.server import DEFAULT_HOST, DEFAULT_PORT, Server, running

PLACE = re.compile(r"line (\d+)(?:, column (\d+))?")


def first_draft(name: str) -> FloorPlan:
    """An empty hall with a robot and a warehouse, to begin drawing in."""
    return FloorPlan(
        name,
        width=10,
        height=8,
        warehouse=frozenset({Cell(8, 0), Cell(9, 0), Cell(8, 1), Cell(9, 1)}),
        start=Cell(1, 6),
        heading=Direction.EAST,
    )


def checked(text: str, source: str) -> dict[str, object]:
    """What there is to say about a world's text: what is wrong and where, or what it holds."""
    try:
        plan = parse_world(text, source)
    except InputError as error:
        place = PLACE.match(error.field)
        line, column = place.groups() if place else (None, None)
        return {
            "error": f"{error.field}: {error.reason}",
            "line": None if line is None else int(line),
            "column": None if column is None else int(column),
        }
    return {
        "error": None,
        "width": plan.width,
        "height": plan.height,
        "metres": [round(plan.width * plan.cell_size, 2), round(plan.height * plan.cell_size, 2)],
        "boxes": len(plan.boxes) or plan.box_count,
        "drawn": len(plan.boxes),
        "unreachable": [[cell.x, cell.y] for cell in plan.unreachable_boxes()],
        "connected": plan.is_connected(),
    }


@contextlib.contextmanager
def serve_editor(path: Path, *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT) -> Iterator[Server]:
    """Edit a world file on a page for as long as the context lasts.

    Args:
        path: The file; where there is none, it is made when it is first saved.
        host: The address to listen on.
        port: The port; where it is taken, any other.

    Raises:
        InputError: The file is there but is no world, or there is no listening on this address.
    """
    is_new = not path.exists()
    if is_new:
        text = format_world(first_draft(path.stem))
    else:
        load_world(path)
        text = path.read_text(encoding="utf-8")

    async def page(request: Request) -> Response:
        current = text if not path.exists() else path.read_text(encoding="utf-8")
        settings = {"file": path.name, "path": str(path), "text": current, "new": not path.exists()}
        values = {"title": f"{path.name} - wherry", "settings": settings}
        return HTMLResponse(assemble("editor.html", ("editor.js",), values, styles=("style.css", "editor.css")))

    async def check(request: Request) -> Response:
        return JSONResponse(checked(await _body(request), path.name))

    async def save(request: Request) -> Response:
        wanted = await _body(request)
        found = checked(wanted, path.name)
        if found["error"] is None:
            try:
                write_atomically(path, wanted)
            except InputError as error:
                found = {"error": str(error), "line": None, "column": None}
        return JSONResponse(found)

    async def stay(page: WebSocket) -> None:
        await page.accept()
        server.page_came()
        try:
            with contextlib.suppress(WebSocketDisconnect):
                while True:
                    await page.receive_text()
        finally:
            server.page_left()

    routes = [
        Route("/", page),
        Route("/check", check, methods=["POST"]),
        Route("/save", save, methods=["POST"]),
        WebSocketRoute("/socket", stay),
    ]
    with running(routes, host=host, port=port) as server:
        yield server


async def _body(request: Request) -> str:
    """A request's text; what is too long is cut off, so that it is refused as no world."""
    parts, size = [], 0
    async for part in request.stream():
        parts.append(part)
        size += len(part)
        if size > MAX_FILE_SIZE:
            break
    return b"".join(parts)[:MAX_FILE_SIZE].decode("utf-8", errors="replace")
