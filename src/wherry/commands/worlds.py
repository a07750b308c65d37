"""``wherry worlds``: the worlds that come with wherry, and an editor for your own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import WorldArgument, console_for, help_without_command
from wherry.commands.watching import LOOPBACK, PORT, PageHostOption, PagePortOption, show

worlds = typer.Typer(
    invoke_without_command=True,
    callback=help_without_command,
    rich_markup_mode=None,
    help="List, show and draw worlds.",
)


@worlds.command("list")
def list_worlds() -> None:
    """List the built-in worlds with their sizes."""
    from wherry.floorplan.world_files import built_in_worlds, find_world

    for name in built_in_worlds():
        plan = find_world(name)
        wide, high = plan.width * plan.cell_size, plan.height * plan.cell_size
        count = len(plan.boxes) or plan.box_count
        typer.echo(f"{name:<10} {plan.width:>3} × {plan.height:<3} cells  {wide:5.1f} × {high:4.1f} m  {count} boxes")


@worlds.command("show")
def show_world(world: WorldArgument) -> None:
    """Print a world as text, the way it can be saved and changed."""
    from wherry.floorplan.world_files import find_world, format_world

    typer.echo(format_world(find_world(world)), nl=False)


@worlds.command("edit")
def edit_world(
    file: Annotated[Path, typer.Argument(help="A world file; a new one is begun where there is none.")],
    host: PageHostOption = LOOPBACK,
    port: PagePortOption = PORT,
) -> None:
    """Draw a world on a page in the browser: walls, boxes, warehouse, robot."""
    import contextlib

    from wherry.views.web.editor import serve_editor

    console = console_for(as_json=False)
    with serve_editor(file, host=host, port=port) as server:
        show(server, console)
        console.print("Close the page, or press Ctrl-C, to end.")
        with contextlib.suppress(KeyboardInterrupt):
            server.wait_until_nobody_watches()
