"""``wherry view``: a recorded run, played again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import console_for, say
from wherry.commands.watching import LOOPBACK, PORT, PageHostOption, PagePortOption, show


def view(
    run: Annotated[Path, typer.Argument(help="A run's folder, or its trace.wherry.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Write the page to this HTML file, which needs no server, instead of showing it."),
    ] = None,
    host: PageHostOption = LOOPBACK,
    port: PagePortOption = PORT,
) -> None:
    """Play a recorded run on a page, with a timeline to move in."""
    import contextlib

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
        show(server, console)
        console.print("Close the page, or press Ctrl-C, to end.")
        with contextlib.suppress(KeyboardInterrupt):
            server.wait_until_nobody_watches()
