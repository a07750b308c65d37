"""``wherry rviz``: RViz, configured for a robot and its agent."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def rviz(
    options: Annotated[list[str] | None, typer.Argument(help="Options passed on to RViz, after --.")] = None,
    ros: Annotated[
        int | None, typer.Option(min=1, max=2, help="ROS version; by default that of the sourced environment.")
    ] = None,
    names: Annotated[Path | None, typer.Option(help="A YAML file with the names of topics and frames.")] = None,
    namespace: Annotated[str, typer.Option(envvar="ROS_NAMESPACE", help="Prefix of every relative topic name.")] = "",
    remap: Annotated[list[str] | None, typer.Option(help="NAME:=NEW for a topic; may be repeated.")] = None,
    centre: Annotated[tuple[float, float], typer.Option(help="Centre of the view in the map frame, m.")] = (0.0, 0.0),
    scale: Annotated[float, typer.Option(min=1.0, max=2000.0, help="Pixels per metre.")] = 80.0,
    robot_model: Annotated[
        bool, typer.Option(help="Show wherry's own robot if no robot has published its description.")
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

    robot_names = load_names(names, namespace=namespace, remappings=remap or ())
    view = viewer.RvizView(*centre, scale)
    if write is not None:
        write_atomically(write, viewer.configuration(ros or 2, robot_names, view))
        return
    ros_version, program = viewer.find_rviz(ros)
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        config = Path(folder) / "wherry.rviz"
        config.write_text(viewer.configuration(ros_version, robot_names, view), encoding="utf-8")
        if robot_model:
            urdf = robot_description(robot_urdf())
            reason = stack.enter_context(viewer.robot_model(ros_version, urdf, Path(folder)))
            if reason:
                typer.echo(f"wherry: {reason}", err=True)
        with contextlib.suppress(KeyboardInterrupt):
            finished = subprocess.run([program, "-d", config, *(options or ())], check=False)  # noqa: S603
            raise typer.Exit(finished.returncode)
