"""Options of the commands whose runs can be watched, and what they mean."""

from __future__ import annotations

import contextlib
import os
import sys
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import say

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.simulation import Simulation
    from wherry.trace.records import Sink
    from wherry.views.web.server import Server

ViewOption = Annotated[bool, typer.Option("--view", help="Show the run on a page in the browser, live.")]
HostOption = Annotated[
    str, typer.Option(help="With --view: the address to serve the page on; elsewhere than here it needs a token.")
]
PortOption = Annotated[int, typer.Option(min=0, max=65535, help="With --view: the port of the page.")]
PageHostOption = Annotated[
    str, typer.Option("--host", help="The address to serve the page on; elsewhere than here it needs a token.")
]
PagePortOption = Annotated[int, typer.Option("--port", min=0, max=65535, help="The port of the page.")]

LOOPBACK, PORT = "127.0.0.1", 8642
FIRST_VISITOR = 10.0  # s that a run which is over waits for one where no browser could be opened
OPENED_VISITOR = 60.0  # s where one was opened, which may never get there


@contextlib.contextmanager
def watched(
    title: str, out: Path | None, console: Console, *, view: bool, host: str = LOOPBACK, port: int = PORT
) -> Iterator[Sink]:
    """A sink that records the run in its folder and, if wished, shows it on a page.

    Args:
        title: Of the page.
        out: The folder for trace.wherry; None to record nothing.
        console: Where to say where the page is.
        view: Whether to show the run. The page then stays until everybody has closed it, or until Ctrl-C; where nobody
            opens it, for `OPENED_VISITOR` or `FIRST_VISITOR`.
        host: The address to serve on.
        port: The port.

    Raises:
        InputError: The folder cannot be written to, or the address cannot be served on, or there is one without a page.
    """
    from wherry.errors import InputError
    from wherry.trace.records import combine_sinks, null_sink

    for option, given, usual in (("--host", host, LOOPBACK), ("--port", port, PORT)):
        if given != usual and not view:
            raise InputError(option, str(given), "is of the page, and needs --view")
    with contextlib.ExitStack() as stack:
        sinks: list[Sink] = []
        if out is not None:
            from wherry.files import make_folder
            from wherry.trace.recordings import TRACE_FILE_NAME, TraceRecorder

            make_folder(out)
            sinks.append(stack.enter_context(TraceRecorder(out / TRACE_FILE_NAME)))
        if view:
            from wherry.views.web.broadcast import Broadcast
            from wherry.views.web.server import serve

            broadcast = Broadcast()
            server = stack.enter_context(serve(broadcast, title, host=host, port=port, folder=out))
            opened = show(server, console)
            sinks.append(broadcast)
        yield combine_sinks(*sinks) if sinks else null_sink
        if view:
            broadcast.end()
            _wait_for_visitors(server, OPENED_VISITOR if opened else FIRST_VISITOR, console)


def _wait_for_visitors(server: Server, patience: float, console: Console) -> None:
    """Let people look at a run that is over, until they have closed the page or press Ctrl-C.

    Args:
        server: The page's.
        patience: S to wait for the first page, if there was none yet.
        console: Where to say what is waited for.
    """
    say(console, f"The run is over. Close the page, or press Ctrl-C: {server.url}")
    if not server.had_pages:
        say(console, f"Nobody has opened it yet: it waits for {patience:g} s.")
    with contextlib.suppress(KeyboardInterrupt):
        if not server.wait_until_nobody_watches(patience):
            console.print("Nobody has opened the page, so that it ends here.")


@contextlib.contextmanager
def films(simulation: Simulation, *, rerun: Path | None, video: Path | None) -> Iterator[Sink]:
    """A sink that records a run for others: for the Rerun viewer, and as a film of the simulated world.

    Args:
        simulation: The world.
        rerun: A .rrd file; None for none.
        video: An .mp4 file; None for none.

    Raises:
        InputError: Something that this needs is not installed, or a file cannot be written.
    """
    from wherry.trace.records import combine_sinks, null_sink

    with contextlib.ExitStack() as stack:
        sinks: list[Sink] = []
        if rerun is not None:
            from wherry.views.rerun_recording import rerun_recording

            sinks.append(stack.enter_context(rerun_recording(rerun)))
        if video is not None:
            from wherry.pipelines.delivery.film import filmed

            sinks.append(stack.enter_context(filmed(video, simulation)))
        yield combine_sinks(*sinks) if sinks else null_sink


def show(server: Server, console: Console) -> bool:
    """Say where a page is, and open it where there is a screen; whether a browser took it."""
    if server.taken_port is not None:
        say(console, f"Port {server.taken_port} is taken: the page is on another one.")
    say(console, f"Page: {server.url}")
    has_screen = sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if has_screen or os.environ.get("BROWSER"):
        return webbrowser.open(server.url)
    return False
