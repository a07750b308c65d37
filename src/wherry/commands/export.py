"""``wherry export``: worlds for other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import BoxesOption, JsonOption, SeedOption, WorldArgument, console_for, print_json

export_app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Write a world for another simulator.")


@export_app.callback()
def export() -> None:
    """Write a world for another simulator."""


@export_app.command()
def gazebo(
    world: WorldArgument,
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to write; new, empty, or an earlier export.")],
    generation: Annotated[
        str, typer.Option(help="Of Gazebo Sim: fortress, or harmonic, which is for Garden and all later ones.")
    ] = "fortress",
    boxes: BoxesOption = None,
    seed: SeedOption = 0,
    force: Annotated[bool, typer.Option("--force", help="Write even if the folder holds something else.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a world, the robot, and launch files for Gazebo Sim with ROS 2 and for classic Gazebo with ROS 1."""
    from wherry.ros import gazebo as exporter

    files = exporter.export(
        exporter.Settings(world=world, folder=folder, generation=generation, boxes=boxes, seed=seed, force=force)
    )
    console = console_for(as_json=as_json)
    console.print(f"Written to {folder}: {', '.join(path.name for path in files)}", highlight=False)
    console.print(f"Gazebo Sim and ROS 2: ros2 launch {folder / 'gazebo.launch.py'}", highlight=False)
    console.print(f"Classic Gazebo and ROS 1: roslaunch {folder / 'classic.launch'}", highlight=False)
    if as_json:
        print_json({"folder": str(folder), "files": [path.name for path in files]})
