"""``wherry view``: replay a recorded run on a page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import console_for, say
from wherry.commands.watching import DEFAULT_HOST, DEFAULT_PORT, PageHostOption, PagePortOption, serve_until_closed


def view(
    run: Annotated[Path, typer.Argument(help="Folder of a run, or its trace.wherry.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Write the page to this self-contained HTML file instead of serving it."),
    ] = None,
    host: PageHostOption = DEFAULT_HOST,
    port: PagePortOption = DEFAULT_PORT,
) -> None:
    """Replay a recorded run on a page with a timeline."""
    from wherry.files import write_atomically
    from wherry.trace.recordings import find_trace, load_frames
    from wherry.views.web.page import player_page
    from wherry.views.web.server import serve_recording

    path = find_trace(run)
    frames = load_frames(path)
    title = f"wherry: {path.resolve().parent.name}"
    console = console_for(as_json=False)
    if out is not None:
        write_atomically(out, player_page(title, {"source": "file"}, frames))
        say(console, f"Written: {out}")
        return
    with serve_recording(frames, title, host=host, port=port, folder=path.parent) as server:
        serve_until_closed(server, console)
