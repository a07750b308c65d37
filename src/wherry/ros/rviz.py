"""RViz of either generation, set up to show what wherry publishes.

The map; the robot; the laser in blue, the particles in red, the predicted path in green; boxes and cells. The two
configurations are package data, for RViz 2 took other names for everything; here topics and the view are filled in.
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
PUBLISHER = Path("lib") / "robot_state_publisher" / "robot_state_publisher"
PREFIXES = {1: "CMAKE_PREFIX_PATH", 2: "AMENT_PREFIX_PATH"}  # variables of a sourced ROS environment
PUBLISHER_NODE = "robot_state_publisher"
DESCRIPTION = "/robot_description"


@dataclass(frozen=True, slots=True)
class View:
    """What RViz looks at at first: straight down, without perspective.

    Attributes:
        x: m, map frame, in the middle of the view.
        y: m.
        scale: Pixels a metre.
    """

    x: float = 0.0
    y: float = 0.0
    scale: float = 80.0


def configuration(generation: int, names: RosNames, view: View) -> str:
    """RViz's configuration file for a robot with these topics and frames."""
    text = (resources.files("wherry.ros") / "rviz_configs" / f"rviz{generation}.rviz").read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    manager = document["Visualization Manager"]
    usual = load_names().topics
    known = {getattr(usual, entry.name).name: entry.name for entry in fields(Topics)}
    for part in (*manager["Displays"], *manager["Tools"]):
        for key in ("Topic", "Marker Topic"):
            if key in part:
                _rename(part, key, known, names.topics)
    manager["Global Options"]["Fixed Frame"] = names.frames.map
    manager["Views"]["Current"] |= {"X": view.x, "Y": view.y, "Scale": view.scale}
    written: str = yaml.safe_dump(document, sort_keys=False)
    return written


def _rename(part: dict[str, Any], key: str, known: Mapping[str, str], topics: Topics) -> None:
    """Put the robot's own name in place of a topic's usual one, if it is one of ours."""
    holder, place = (part[key], "Value") if isinstance(part[key], dict) else (part, key)
    if holder[place] in known:
        holder[place] = getattr(topics, known[holder[place]]).name


def find_rviz(generation: int | None) -> tuple[int, str]:
    """Find the user's RViz: that of a generation, or of the sourced ROS environment, or whichever there is.

    Returns:
        Its generation and its path.

    Raises:
        InputError: It is not installed.
    """
    sourced = {"1": [1], "2": [2]}.get(os.environ.get("ROS_VERSION", ""), [])
    wanted = [generation] if generation else sourced or [1, 2]
    for one in wanted:
        program = shutil.which(PROGRAMS[one])
        if program:
            return one, program
    missing = " and ".join(PROGRAMS[one] for one in wanted)
    raise InputError("RViz", missing, f"is not installed: {' or '.join(INSTALL[one] for one in wanted)}")


def find_robot_state_publisher(generation: int) -> Path | None:
    """ROS's node that tells where a robot's links are; None if it is not installed."""
    prefixes = [*filter(None, os.environ.get(PREFIXES[generation], "").split(os.pathsep)), "/usr"]
    places = (Path(prefix) / PUBLISHER for prefix in prefixes)
    return next((place for place in places if os.access(place, os.X_OK)), None)


@contextmanager
def robot_model(generation: int, description: str, folder: Path) -> Iterator[str | None]:
    """Let RViz see a robot's links, unless somebody does already.

    Args:
        generation: Of ROS.
        description: The robot's URDF, for robots that do not bring their own.
        folder: For a file.

    Yields:
        None if all is well, else why there will be no robot to see.

    Raises:
        InputError: No ROS master answers.
    """
    if generation == 1 and not _describe_to_master(description):
        yield None
        return
    program = find_robot_state_publisher(generation)
    if program is None:
        yield f"the robot's links are not shown without robot_state_publisher: {INSTALL[generation]}"
        return
    process = subprocess.Popen([program, *_publisher_arguments(generation, description, folder)])  # noqa: S603
    try:
        yield None
    finally:
        process.terminate()
        process.wait()


def _describe_to_master(description: str) -> bool:
    """Give the master the robot's description if it has none; return whether nobody publishes the robot's links yet."""
    uri = choose_interface()
    wait_for_master(uri)
    with closing(Master("/wherry_rviz", uri)) as master:
        if not master.call("hasParam", DESCRIPTION):
            master.call("setParam", DESCRIPTION, description)
        return not master.is_alive(f"/{PUBLISHER_NODE}")


def _publisher_arguments(generation: int, description: str, folder: Path) -> list[str]:
    """In ROS 1 the description is the master's; in ROS 2 it is a parameter of the node."""
    if generation == 1:
        return []
    parameters = folder / "robot_state_publisher.yaml"
    parameters.write_text(yaml.safe_dump({"/**": {"ros__parameters": {"robot_description": description}}}))
    return ["--ros-args", "--params-file", str(parameters)]
