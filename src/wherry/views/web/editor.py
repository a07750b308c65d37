"""The world editor: a page that edits a world file; `wherry.floorplan` checks the file before it is saved."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path

from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from wherry.errors import InputError
from wherry.files import write_atomically
from wherry.floorplan.plan import Cell, Direction, FloorPlan
from wherry.floorplan.world_files import MAX_FILE_SIZE, format_world, load_world, parse_world
from wherry.views.web.page import render_page
from wherry.views.web.server import DEFAULT_HOST, DEFAULT_PORT, PageServer, hold_connection, run_server

EDITOR_SCRIPTS = ("dom.js", "editor.js")
EDITOR_STYLES = ("style.css", "editor.css")
ERROR_POSITION = re.compile(r"line (\d+)(?:, column (\d+))?")


def new_plan(name: str) -> FloorPlan:
    """The plan of a new file: an empty hall with a robot and a warehouse."""
    return FloorPlan(
        name,
        width=10,
        height=8,
        warehouse=frozenset({Cell(8, 0), Cell(9, 0), Cell(8, 1), Cell(9, 1)}),
        start=Cell(1, 6),
        heading=Direction.EAST,
    )


def check_world(text: str, source: str) -> dict[str, object]:
    """Check the text of a world file.

    Args:
        text: Content of the file.
        source: Name of the file in errors.

    Returns:
        JSON for the page: ``error`` with its ``line`` and ``column`` or, for a valid text, the plan's size and boxes.
    """
    try:
        plan = parse_world(text, source)
    except InputError as error:
        position = ERROR_POSITION.match(error.field)
        line, column = position.groups() if position else (None, None)
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


def save_world(text: str, path: Path) -> dict[str, object]:
    """Write the text of a world file if it is valid.

    Args:
        text: Content of the file.
        path: The file.

    Returns:
        JSON for the page, as from `check_world`; ``error`` is also set if the file cannot be written.
    """
    result = check_world(text, path.name)
    if result["error"] is None:
        try:
            write_atomically(path, text)
        except InputError as error:
            return {"error": str(error), "line": None, "column": None}
    return result


@contextlib.contextmanager
def serve_editor(path: Path, *, host: str = DEFAULT_HOST, port: int = DEFAULT_PORT) -> Iterator[PageServer]:
    """Serve a page that edits a world file until the context ends.

    Args:
        path: The file; one that does not exist is created when the world is saved.
        host: Address to listen on; pages need a token unless it is a loopback address.
        port: Port to listen on; another one is used if it is occupied. 0 for any free port.

    Raises:
        InputError: The file is not a valid world file, or the address cannot be listened on.
    """
    is_new = not path.exists()
    if is_new:
        text = format_world(new_plan(path.stem))
    else:
        load_world(path)
        text = path.read_text(encoding="utf-8")

    async def page(request: Request) -> Response:
        current = text if not path.exists() else path.read_text(encoding="utf-8")
        settings = {"file": path.name, "path": str(path), "text": current, "new": not path.exists()}
        title = f"{path.name} - wherry"
        return HTMLResponse(
            render_page("editor.html.j2", EDITOR_SCRIPTS, title=title, settings=settings, styles=EDITOR_STYLES)
        )

    async def check(request: Request) -> Response:
        return JSONResponse(check_world(await _body(request), path.name))

    async def save(request: Request) -> Response:
        return JSONResponse(save_world(await _body(request), path))

    async def connection(websocket: WebSocket) -> None:
        await hold_connection(websocket, server)

    routes = [
        Route("/", page),
        Route("/check", check, methods=["POST"]),
        Route("/save", save, methods=["POST"]),
        WebSocketRoute("/socket", connection),
    ]
    with run_server(routes, host=host, port=port) as server:
        yield server


async def _body(request: Request) -> str:
    """Text of a request, truncated to `MAX_FILE_SIZE`; a truncated world fails the check."""
    parts, size = [], 0
    async for part in request.stream():
        parts.append(part)
        size += len(part)
        if size > MAX_FILE_SIZE:
            break
    return b"".join(parts)[:MAX_FILE_SIZE].decode("utf-8", errors="replace")
