"""``wherry worlds``: list, print and edit world files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import WorldArgument, console_for, help_without_command
from wherry.commands.watching import DEFAULT_HOST, DEFAULT_PORT, PageHostOption, PagePortOption, serve_until_closed

worlds = typer.Typer(
    invoke_without_command=True,
    callback=help_without_command,
    rich_markup_mode=None,
    help="List, show and edit worlds.",
)


@worlds.command("list")
def list_worlds() -> None:
    """List the built-in worlds with their sizes."""
    from wherry.floorplan.world_files import built_in_worlds, find_world

    for name in built_in_worlds():
        plan = find_world(name)
        width, height = plan.width * plan.cell_size, plan.height * plan.cell_size
        count = len(plan.boxes) or plan.box_count
        typer.echo(
            f"{name:<10} {plan.width:>3} × {plan.height:<3} cells  {width:5.1f} × {height:4.1f} m  {count} boxes"
        )


@worlds.command("show")
def show_world(world: WorldArgument) -> None:
    """Print a world file."""
    from wherry.floorplan.world_files import find_world, format_world

    typer.echo(format_world(find_world(world)), nl=False)


@worlds.command("edit")
def edit_world(
    file: Annotated[Path, typer.Argument(help="A world file; it is created if it does not exist.")],
    host: PageHostOption = DEFAULT_HOST,
    port: PagePortOption = DEFAULT_PORT,
) -> None:
    """Edit a world on a page in the browser: walls, obstacles, boxes, warehouse, robot."""
    from wherry.views.web.editor import serve_editor

    console = console_for(as_json=False)
    with serve_editor(file, host=host, port=port) as server:
        serve_until_closed(server, console)
