"""Options of commands that show a run on a page, and the trace sinks that implement them."""

from __future__ import annotations

import contextlib
import os
import sys
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import say

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.simulation import Simulation
    from wherry.trace.records import Sink
    from wherry.views.web.server import PageServer

ViewOption = Annotated[bool, typer.Option("--view", help="Show the run live on a page in the browser.")]
HostOption = Annotated[
    str, typer.Option(help="With --view: address to serve the page on; pages of other machines need a token.")
]
PortOption = Annotated[int, typer.Option(min=0, max=65535, help="With --view: port of the page.")]
PageHostOption = Annotated[
    str, typer.Option("--host", help="Address to serve the page on; pages of other machines need a token.")
]
PagePortOption = Annotated[int, typer.Option("--port", min=0, max=65535, help="Port of the page.")]

DEFAULT_HOST, DEFAULT_PORT = "127.0.0.1", 8642
MANUAL_OPEN_TIMEOUT = 10.0  # s to wait after a run for a first page if no browser was started
BROWSER_OPEN_TIMEOUT = 60.0  # s to wait after a run for a first page if a browser was started


@dataclass(frozen=True, slots=True)
class PageOptions:
    """Options of the live page.

    Attributes:
        view: Whether to show the run on a page.
        host: Address to serve the page on.
        port: Port to serve the page on.
    """

    view: ViewOption = False
    host: HostOption = DEFAULT_HOST
    port: PortOption = DEFAULT_PORT


@contextlib.contextmanager
def trace_sink(title: str, out: Path | None, console: Console, page: PageOptions) -> Iterator[Sink]:
    """A sink that records the run and, with ``--view``, shows it on a page.

    After the run the page is served until all pages are closed or Ctrl-C is pressed. If no page was opened, it is
    served for `BROWSER_OPEN_TIMEOUT` or `MANUAL_OPEN_TIMEOUT`.

    Args:
        title: Title of the page.
        out: Folder for trace.wherry; None to record no trace.
        console: Console on which the address of the page is printed.
        page: Options of the page.

    Raises:
        InputError: The folder or the address cannot be used, or an address is given without ``--view``.
    """
    from wherry.errors import InputError
    from wherry.trace.records import combine_sinks, null_sink

    for option, value, default in (("--host", page.host, DEFAULT_HOST), ("--port", page.port, DEFAULT_PORT)):
        if value != default and not page.view:
            raise InputError(option, str(value), "needs --view")
    with contextlib.ExitStack() as stack:
        sinks: list[Sink] = []
        if out is not None:
            from wherry.files import ensure_writable_folder
            from wherry.trace.recordings import TRACE_FILE_NAME, TraceRecorder

            ensure_writable_folder(out)
            sinks.append(stack.enter_context(TraceRecorder(out / TRACE_FILE_NAME)))
        if page.view:
            from wherry.views.web.broadcast import TraceBroadcast
            from wherry.views.web.server import serve_run

            broadcast = TraceBroadcast()
            server = stack.enter_context(serve_run(broadcast, title, host=page.host, port=page.port, folder=out))
            has_browser = open_page(server, console)
            sinks.append(broadcast)
        yield combine_sinks(*sinks) if sinks else null_sink
        if page.view:
            broadcast.end()
            _serve_finished_run(server, BROWSER_OPEN_TIMEOUT if has_browser else MANUAL_OPEN_TIMEOUT, console)


def _serve_finished_run(server: PageServer, timeout: float, console: Console) -> None:
    """Serve the page of a finished run until all pages are closed or Ctrl-C is pressed.

    Args:
        server: The server of the page.
        timeout: Time to wait for a first page, s.
        console: Console for messages.
    """
    say(console, f"The run is over. Close the page, or press Ctrl-C: {server.url}")
    if not server.was_opened:
        say(console, f"The page was not opened yet; waiting for {timeout:g} s.")
    with contextlib.suppress(KeyboardInterrupt):
        if not server.wait_until_unwatched(timeout):
            console.print("The page was not opened; stopping.")


@contextlib.contextmanager
def recording_sink(simulation: Simulation, *, rerun: Path | None, video: Path | None) -> Iterator[Sink]:
    """A sink that records a run for the Rerun viewer, as a video of the simulated world, or both.

    Args:
        simulation: The simulated world.
        rerun: Path of the .rrd file; None to write none.
        video: Path of the .mp4 file; None to write none.

    Raises:
        InputError: An optional dependency is not installed, or a file cannot be written.
    """
    from wherry.trace.records import combine_sinks, null_sink

    with contextlib.ExitStack() as stack:
        sinks: list[Sink] = []
        if rerun is not None:
            from wherry.views.rerun_recording import rerun_recording

            sinks.append(stack.enter_context(rerun_recording(rerun)))
        if video is not None:
            from wherry.pipelines.delivery.film import film_recording

            sinks.append(stack.enter_context(film_recording(video, simulation)))
        yield combine_sinks(*sinks) if sinks else null_sink


def open_page(server: PageServer, console: Console) -> bool:
    """Print the address of a page and open it in a browser if there is a screen.

    Returns:
        Whether a browser was started.
    """
    if server.occupied_port is not None:
        say(console, f"Port {server.occupied_port} is occupied; another one is used.")
    say(console, f"Page: {server.url}")
    has_screen = sys.platform != "linux" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if has_screen or os.environ.get("BROWSER"):
        return webbrowser.open(server.url)
    return False


def serve_until_closed(server: PageServer, console: Console) -> None:
    """Open a page and wait until all pages are closed or Ctrl-C is pressed."""
    open_page(server, console)
    console.print("Close the page, or press Ctrl-C, to end.")
    with contextlib.suppress(KeyboardInterrupt):
        server.wait_until_unwatched()
