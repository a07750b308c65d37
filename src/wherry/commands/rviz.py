"""``wherry rviz``: the user's RViz, showing what a robot sees and the agent thinks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def rviz(
    options: Annotated[list[str] | None, typer.Argument(help="Options of RViz's own, after --.")] = None,
    ros: Annotated[int | None, typer.Option(min=1, max=2, help="Of which ROS; without it, the sourced one's.")] = None,
    names: Annotated[Path | None, typer.Option(help="A YAML file with the robot's names of topics and frames.")] = None,
    namespace: Annotated[str, typer.Option(envvar="ROS_NAMESPACE", help="The robot's namespace.")] = "",
    remap: Annotated[list[str] | None, typer.Option(help="NAME:=NEW, as in ROS; several times for several.")] = None,
    centre: Annotated[tuple[float, float], typer.Option(help="What to look at, m, in the map frame.")] = (0.0, 0.0),
    scale: Annotated[float, typer.Option(min=1.0, max=2000.0, help="Pixels a metre.")] = 80.0,
    robot_model: Annotated[
        bool, typer.Option(help="Describe wherry's own robot to RViz, where no robot has described itself.")
    ] = True,
    write: Annotated[
        Path | None, typer.Option(help="Write the configuration to this file instead of starting RViz.")
    ] = None,
) -> None:
    """Start RViz: the map, the laser in blue, particles in red, the predicted path in green, robot, boxes and cells."""
    import contextlib
    import subprocess
    import tempfile

    from wherry.files import write_atomically
    from wherry.ros import rviz as viewer
    from wherry.ros.description import robot_description
    from wherry.ros.names import load_names
    from wherry.simulation.model import robot_urdf

    called = load_names(names, namespace=namespace, remappings=remap or ())
    view = viewer.View(*centre, scale)
    if write is not None:
        write_atomically(write, viewer.configuration(ros or 2, called, view))
        return
    generation, program = viewer.find_rviz(ros)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        config = Path(folder) / "wherry.rviz"
        config.write_text(viewer.configuration(generation, called, view), encoding="utf-8")
        if robot_model:
            description = robot_description(robot_urdf())
            trouble = stack.enter_context(viewer.robot_model(generation, description, Path(folder)))
            if trouble:
                typer.echo(f"wherry: {trouble}", err=True)
        with contextlib.suppress(KeyboardInterrupt):
            finished = subprocess.run([program, "-d", config, *(options or ())], check=False)  # noqa: S603
            raise typer.Exit(finished.returncode)
