"""RViz of ROS 1 and ROS 2, configured to show what wherry publishes.

It shows the map, the robot, the laser in blue, the particles in red, the predicted path in green, boxes and cells. Each
version has a configuration file in the package, since RViz 2 renamed the displays and their properties; this module
fills in topics, frames and the view.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from wherry.errors import InputError
from wherry.ros.names import RosNames, Topics, load_names
from wherry.ros.transports.ros1_master import Master, choose_interface, wait_for_master

PROGRAMS = {1: "rviz", 2: "rviz2"}
INSTALL = {
    1: "apt install rviz ros-robot-state-publisher",
    2: "apt install ros-$ROS_DISTRO-rviz2, and source /opt/ros/$ROS_DISTRO/setup.bash",
}
PUBLISHER_PATH = Path("lib") / "robot_state_publisher" / "robot_state_publisher"
PREFIX_VARIABLES = {1: "CMAKE_PREFIX_PATH", 2: "AMENT_PREFIX_PATH"}  # set by a sourced ROS environment
PUBLISHER_NODE = "robot_state_publisher"
DESCRIPTION_PARAMETER = "/robot_description"


@dataclass(frozen=True, slots=True)
class RvizView:
    """The initial view: straight down, without perspective.

    Attributes:
        x: x of the centre in the map frame, m.
        y: y of the centre in the map frame, m.
        scale: Pixels per metre.
    """

    x: float = 0.0
    y: float = 0.0
    scale: float = 80.0


def configuration(ros_version: int, names: RosNames, view: RvizView) -> str:
    """The text of RViz's configuration file for a robot with these topics and frames."""
    text = (resources.files("wherry.ros") / "rviz_configs" / f"rviz{ros_version}.rviz").read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    manager = document["Visualization Manager"]
    defaults = load_names().topics
    known = {getattr(defaults, entry.name).name: entry.name for entry in fields(Topics)}
    for part in (*manager["Displays"], *manager["Tools"]):
        for key in ("Topic", "Marker Topic"):
            if key in part:
                _rename(part, key, known, names.topics)
    manager["Global Options"]["Fixed Frame"] = names.frames.map
    manager["Views"]["Current"] |= {"X": view.x, "Y": view.y, "Scale": view.scale}
    written: str = yaml.safe_dump(document, sort_keys=False)
    return written


def _rename(part: dict[str, Any], key: str, known: Mapping[str, str], topics: Topics) -> None:
    """Replace the default name of a topic by the robot's, in the form of RViz 1 (a string) or RViz 2 (a mapping)."""
    holder, entry = (part[key], "Value") if isinstance(part[key], dict) else (part, key)
    if holder[entry] in known:
        holder[entry] = getattr(topics, known[holder[entry]]).name


def find_rviz(ros_version: int | None) -> tuple[int, str]:
    """Find the RViz of a given ROS version, else of the sourced ROS environment, else of any version.

    Returns:
        ROS version and path of the program.

    Raises:
        InputError: It is not installed.
    """
    sourced = {"1": [1], "2": [2]}.get(os.environ.get("ROS_VERSION", ""), [])
    wanted = [ros_version] if ros_version else sourced or [1, 2]
    for version in wanted:
        program = shutil.which(PROGRAMS[version])
        if program:
            return version, program
    missing = " and ".join(PROGRAMS[version] for version in wanted)
    raise InputError("RViz", missing, f"is not installed: {' or '.join(INSTALL[version] for version in wanted)}")


def find_robot_state_publisher(ros_version: int) -> Path | None:
    """Path of ROS's node that publishes the transforms of a robot's links; None if it is not installed."""
    prefixes = [*filter(None, os.environ.get(PREFIX_VARIABLES[ros_version], "").split(os.pathsep)), "/usr"]
    candidates = (Path(prefix) / PUBLISHER_PATH for prefix in prefixes)
    return next((candidate for candidate in candidates if os.access(candidate, os.X_OK)), None)


@contextmanager
def robot_model(ros_version: int, urdf: str, folder: Path) -> Iterator[str | None]:
    """Run robot_state_publisher, so that RViz can draw a robot's links, unless one is running already.

    Args:
        ros_version: 1 or 2.
        urdf: The robot's description, for robots that do not publish their own.
        folder: Existing folder for a parameter file.

    Yields:
        None if the robot can be drawn, otherwise the reason why not.

    Raises:
        InputError: No ROS master answers.
    """
    if ros_version == 1:
        uri = choose_interface()
        wait_for_master(uri)
        with closing(Master("/wherry_rviz", uri)) as master:
            _set_missing_description(master, urdf)
            is_running = master.is_alive(f"/{PUBLISHER_NODE}")
        if is_running:
            yield None
            return
    program = find_robot_state_publisher(ros_version)
    if program is None:
        yield f"the robot's links are not shown without robot_state_publisher: {INSTALL[ros_version]}"
        return
    process = subprocess.Popen([program, *_publisher_arguments(ros_version, urdf, folder)])  # noqa: S603
    try:
        yield None
    finally:
        process.terminate()
        process.wait()


def _set_missing_description(master: Master, urdf: str) -> None:
    """Set the parameter with the robot's description, which robot_state_publisher reads in ROS 1, if it is not set."""
    if not master.call("hasParam", DESCRIPTION_PARAMETER):
        master.call("setParam", DESCRIPTION_PARAMETER, urdf)


def _publisher_arguments(ros_version: int, urdf: str, folder: Path) -> list[str]:
    """Arguments of robot_state_publisher: a parameter file with the description in ROS 2; none in ROS 1."""
    if ros_version == 1:
        return []
    parameters = folder / "robot_state_publisher.yaml"
    parameters.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"robot_description": urdf}}}))
    return ["--ros-args", "--params-file", str(parameters)]
