"""A folder with a world for Gazebo: the world, the robot, the bridge to ROS 2, and launch files for ROS 1 and 2."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np
import yaml

from wherry.errors import InputError
from wherry.files import ensure_writable_folder, read_text, write_atomically
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.gazebo.latch_settings import GazeboLatchSettings, format_latch_settings
from wherry.gazebo.latch_topics import (
    OPEN,
    ROBOT,
    box_name,
    close_topic,
    pose_topic,
    removal_topic,
    state_topic,
)
from wherry.gazebo.sdf import (
    GENERATIONS,
    GazeboGeneration,
    classic_world,
    sim_world,
    world_name,
)
from wherry.ros.description import robot_description
from wherry.simulation import build
from wherry.simulation.lidar import LidarSpecification
from wherry.simulation.model import robot_urdf
from wherry.simulation.seeded_worlds import seed_world
from wherry.simulation.simulator import LATCH_REACH
from wherry.space.pose import Pose

FORMAT_VERSION = 1
MARKER_FILE = "wherry-export.json"  # identifies a folder as an export
MAX_MARKER_BYTES = 64_000
LATCH_FILE = "latch.yaml"
LAUNCH_FILES = ("gazebo.launch.py", "classic.launch")


@dataclass(frozen=True, slots=True)
class GazeboExportSettings:
    """What to export.

    Attributes:
        world: Name of a built-in world, or path of a world file.
        folder: Folder to write.
        generation: Name of a generation of Gazebo Sim in `GENERATIONS`.
        boxes: Number of boxes; None for the world's own.
        seed: Seed of the boxes' positions, which are those of ``wherry deliver`` with the same seed.
        force: Whether to write into a folder that contains other files.
    """

    world: str
    folder: Path
    generation: str = "fortress"
    boxes: int | None = None
    seed: int = 0
    force: bool = False


def export_world(settings: GazeboExportSettings) -> tuple[Path, ...]:
    """Write a world for Gazebo into a folder.

    Files of an earlier export are replaced atomically, one after another; the marker file comes last.

    Returns:
        Paths of the files.

    Raises:
        InputError: There is no such world or generation, or the folder contains other files or cannot be written to.
    """
    if settings.generation not in GENERATIONS:
        raise InputError("--generation", settings.generation, f"is none of {', '.join(GENERATIONS)}")
    world = seed_world(find_world(settings.world), settings.boxes, settings.seed)
    files = export_files(world.plan, world.physics_rng, GENERATIONS[settings.generation])
    _prepare_folder(settings.folder, force=settings.force)
    files = {**files, MARKER_FILE: _marker(settings, world.plan, files)}
    for name, text in files.items():
        write_atomically(settings.folder / name, text)
    return tuple(settings.folder / name for name in files)


def export_files(plan: FloorPlan, rng: np.random.Generator, generation: GazeboGeneration) -> Mapping[str, str]:
    """The files of an export by name.

    Args:
        plan: The building, with a robot and with its boxes placed.
        rng: Source of the boxes' positions in their cells, as in the simulator.
        generation: Generation of Gazebo Sim.

    Raises:
        InputError: The plan has no robot.
    """
    model = build(plan, rng).physics.model
    base = model.body("robot/base_footprint")
    robot = Pose(float(base.pos[0]), float(base.pos[1]), 2.0 * math.atan2(base.quat[3], base.quat[0]))
    boxes = np.array([model.body(f"box {index}").pos[:2] for index in range(len(plan.boxes))]).reshape(-1, 2)
    lidar = LidarSpecification()
    latch = GazeboLatchSettings(len(plan.boxes), LATCH_REACH, plan.cell_size, plan.warehouse)
    return {
        "world.sdf": sim_world(plan, robot, boxes, lidar, generation),
        "classic.world": classic_world(plan, robot, boxes, lidar),
        "robot.urdf": robot_description(robot_urdf()),
        "bridge.yaml": bridge_config(plan, generation),
        LATCH_FILE: format_latch_settings(latch),
        **{name: _launch_file(name) for name in LAUNCH_FILES},
    }


def bridge_config(plan: FloorPlan, generation: GazeboGeneration) -> str:
    """The configuration of ros_gz_bridge as YAML."""
    package = generation.messages
    entries = [
        _bridged("/clock", "rosgraph_msgs/msg/Clock", f"{package}.Clock", gazebo_topic=_clock_topic(plan)),
        _bridged("/scan", "sensor_msgs/msg/LaserScan", f"{package}.LaserScan"),
        _bridged("/odom", "nav_msgs/msg/Odometry", f"{package}.Odometry"),
        _bridged("/tf", "tf2_msgs/msg/TFMessage", f"{package}.Pose_V"),
        _bridged("/joint_states", "sensor_msgs/msg/JointState", f"{package}.Model"),
        _bridged("/cmd_vel", "geometry_msgs/msg/Twist", f"{package}.Twist", to_ros=False),
    ]
    boxes = range(len(plan.boxes))
    for model in (ROBOT, *map(box_name, boxes)):
        entries.append(_bridged(pose_topic(model).name, "geometry_msgs/msg/PoseStamped", f"{package}.Pose"))
    empty = ("std_msgs/msg/Empty", f"{package}.Empty")
    entries.append(_bridged(OPEN.name, *empty, to_ros=False))
    for box in boxes:
        entries.append(_bridged(close_topic(box).name, *empty, to_ros=False))
        entries.append(_bridged(removal_topic(box).name, *empty, to_ros=False))
        entries.append(_bridged(state_topic(box).name, "std_msgs/msg/String", f"{package}.StringMsg"))
    return yaml.safe_dump(entries, sort_keys=False)


def _clock_topic(plan: FloorPlan) -> str:
    return f"/world/{world_name(plan)}/clock"


def _bridged(
    topic: str, ros_type: str, gazebo_type: str, *, to_ros: bool = True, gazebo_topic: str = ""
) -> dict[str, str]:
    """One topic of the bridge; its name in Gazebo is the same unless ``gazebo_topic`` is given."""
    return {
        "ros_topic_name": topic,
        "gz_topic_name": gazebo_topic or topic,
        "ros_type_name": ros_type,
        "gz_type_name": gazebo_type,
        "direction": "GZ_TO_ROS" if to_ros else "ROS_TO_GZ",
    }


def _prepare_folder(folder: Path, *, force: bool) -> None:
    """Make the folder, or check that it is empty or contains an export.

    Raises:
        InputError: The folder cannot be made, or contains other files.
    """
    ensure_writable_folder(folder)
    if any(folder.iterdir()) and not force and not _is_export(folder / MARKER_FILE):
        raise InputError(folder, "", "holds files that are not an export; choose another folder, or --force")


def _marker(settings: GazeboExportSettings, plan: FloorPlan, files: Mapping[str, str]) -> str:
    content = {
        "wherry-export": FORMAT_VERSION,
        "world": plan.name,
        "generation": settings.generation,
        "seed": settings.seed,
        "files": sorted(files),
    }
    return json.dumps(content, indent=2) + "\n"


def _is_export(marker: Path) -> bool:
    """Whether a marker file exists and is valid."""
    if not marker.is_file():
        return False
    try:
        content = json.loads(read_text(marker, max_bytes=MAX_MARKER_BYTES))
    except ValueError:
        return False
    return isinstance(content, dict) and "wherry-export" in content


def _launch_file(name: str) -> str:
    """A launch file, which is the same for every world."""
    return (resources.files("wherry.gazebo") / "templates" / name).read_text(encoding="utf-8")
