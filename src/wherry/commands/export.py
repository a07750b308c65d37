"""``wherry export``: worlds for other simulators."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import (
    BoxesOption,
    JsonOption,
    SeedOption,
    WorldArgument,
    console_for,
    help_without_command,
    print_json,
    say,
)

export_app = typer.Typer(
    invoke_without_command=True,
    callback=help_without_command,
    rich_markup_mode=None,
    help="Write a world for another simulator.",
)


@export_app.command()
def gazebo(
    world: WorldArgument,
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder to write to: new, empty, or an earlier export.")
    ],
    generation: Annotated[
        str, typer.Option(help="Generation of Gazebo Sim: fortress, or harmonic for Garden and all later ones.")
    ] = "fortress",
    boxes: BoxesOption = None,
    seed: SeedOption = 0,
    force: Annotated[bool, typer.Option("--force", help="Write even if the folder contains other files.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Write a world, the robot, and launch files for Gazebo Sim with ROS 2 and for classic Gazebo with ROS 1."""
    from wherry.floorplan.world_files import find_world
    from wherry.gazebo.export import GazeboExportSettings, export_world
    from wherry.realization.mission import order_from_plan

    files = export_world(
        GazeboExportSettings(world=world, folder=folder, generation=generation, boxes=boxes, seed=seed, force=force)
    )
    console = console_for(as_json=as_json)
    say(console, f"Written to {folder}: {', '.join(path.name for path in files)}")
    say(console, f"Gazebo Sim and ROS 2: ros2 launch {folder / 'gazebo.launch.py'}")
    say(console, f"Classic Gazebo and ROS 1: roslaunch {folder / 'classic.launch'}")
    cells = " ".join(f"--warehouse {x:g},{y:g}" for x, y in order_from_plan(find_world(world)).warehouse.tolist())
    say(console, f"The agent: wherry ros2 deliver {cells}")
    if as_json:
        print_json({"folder": str(folder), "files": [path.name for path in files]})
