"""A folder with a world for Gazebo: the world, the robot, the bridge to ROS 2, and launch files for both ROS."""

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
from wherry.files import make_folder, read_text, write_atomically
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.gazebo.latch import (
    OPEN,
    ROBOT,
    Site,
    box_name,
    close_topic,
    format_site,
    pose_topic,
    state_topic,
    take_in_topic,
)
from wherry.gazebo.sdf import (
    GENERATIONS,
    Gazebo,
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
MARK = "wherry-export.json"  # says that a folder is an export, and of what
LARGEST_MARK = 64_000  # bytes
LATCH_FILE = "latch.yaml"
LAUNCH_FILES = ("gazebo.launch.py", "classic.launch")


@dataclass(frozen=True, slots=True)
class Settings:
    """What to export.

    Attributes:
        world: A built-in world's name, or a world file.
        folder: Where to.
        generation: A key of `GENERATIONS`.
        boxes: How many; None for what the world says.
        seed: Of the boxes' places; the same ones as in ``wherry deliver`` with that seed.
        force: Whether to write into a folder that holds something else.
    """

    world: str
    folder: Path
    generation: str = "fortress"
    boxes: int | None = None
    seed: int = 0
    force: bool = False


def export(settings: Settings) -> tuple[Path, ...]:
    """Write a world for Gazebo into a folder.

    Files of an earlier export are replaced, one by one and each at once; the mark comes last.

    Returns:
        The files.

    Raises:
        InputError: There is no such world or generation, or the folder holds something else or cannot be written to.
    """
    if settings.generation not in GENERATIONS:
        raise InputError("--generation", settings.generation, f"is none of {', '.join(GENERATIONS)}")
    world = seed_world(find_world(settings.world), settings.boxes, settings.seed)
    files = contents(world.plan, world.physics_rng, GENERATIONS[settings.generation])
    _prepare(settings.folder, force=settings.force)
    what: dict[str, object] = {"wherry-export": FORMAT_VERSION, "world": world.plan.name}
    what |= {"generation": settings.generation, "seed": settings.seed, "files": sorted(files)}
    files = {**files, MARK: json.dumps(what, indent=2) + "\n"}
    for name, text in files.items():
        write_atomically(settings.folder / name, text)
    return tuple(settings.folder / name for name in files)


def contents(plan: FloorPlan, rng: np.random.Generator, gazebo: Gazebo) -> Mapping[str, str]:
    """The files of an export, by name.

    Args:
        plan: The building, with a robot and with its boxes placed.
        rng: Where the boxes' places in their cells come from, as in the simulator.
        gazebo: For which generation.

    Raises:
        InputError: The plan has no robot.
    """
    model = build(plan, rng).physics.model
    base = model.body("robot/base_footprint")
    robot = Pose(float(base.pos[0]), float(base.pos[1]), 2.0 * math.atan2(base.quat[3], base.quat[0]))
    boxes = np.array([model.body(f"box {index}").pos[:2] for index in range(len(plan.boxes))]).reshape(-1, 2)
    lidar = LidarSpecification()
    return {
        "world.sdf": sim_world(plan, robot, boxes, lidar, gazebo),
        "classic.world": classic_world(plan, robot, boxes, lidar),
        "robot.urdf": robot_description(robot_urdf()),
        "bridge.yaml": bridge(plan, gazebo),
        LATCH_FILE: format_site(Site(len(plan.boxes), LATCH_REACH, plan.cell_size, plan.warehouse)),
        **{name: _template(name) for name in LAUNCH_FILES},
    }


def bridge(plan: FloorPlan, gazebo: Gazebo) -> str:
    """The ros_gz_bridge's configuration."""
    clock = f"/world/{world_name(plan)}/clock"
    entries = [
        _bridged("/clock", "rosgraph_msgs/msg/Clock", f"{gazebo.messages}.Clock", at=clock),
        _bridged("/scan", "sensor_msgs/msg/LaserScan", f"{gazebo.messages}.LaserScan"),
        _bridged("/odom", "nav_msgs/msg/Odometry", f"{gazebo.messages}.Odometry"),
        _bridged("/tf", "tf2_msgs/msg/TFMessage", f"{gazebo.messages}.Pose_V"),
        _bridged("/joint_states", "sensor_msgs/msg/JointState", f"{gazebo.messages}.Model"),
        _bridged("/cmd_vel", "geometry_msgs/msg/Twist", f"{gazebo.messages}.Twist", to_ros=False),
    ]
    boxes = range(len(plan.boxes))
    for model in (ROBOT, *map(box_name, boxes)):
        entries.append(_bridged(pose_topic(model).name, "geometry_msgs/msg/PoseStamped", f"{gazebo.messages}.Pose"))
    empty = ("std_msgs/msg/Empty", f"{gazebo.messages}.Empty")
    entries.append(_bridged(OPEN.name, *empty, to_ros=False))
    for box in boxes:
        entries.append(_bridged(close_topic(box).name, *empty, to_ros=False))
        entries.append(_bridged(take_in_topic(box).name, *empty, to_ros=False))
        entries.append(_bridged(state_topic(box).name, "std_msgs/msg/String", f"{gazebo.messages}.StringMsg"))
    return yaml.safe_dump(entries, sort_keys=False)


def _bridged(topic: str, ros: str, gazebo: str, *, to_ros: bool = True, at: str = "") -> dict[str, str]:
    """One topic on the bridge; ``at`` is its name in Gazebo if that is another."""
    return {
        "ros_topic_name": topic,
        "gz_topic_name": at or topic,
        "ros_type_name": ros,
        "gz_type_name": gazebo,
        "direction": "GZ_TO_ROS" if to_ros else "ROS_TO_GZ",
    }


def _prepare(folder: Path, *, force: bool) -> None:
    """Make the folder, or see that nothing else is in it.

    Raises:
        InputError: It cannot be made, or holds something else.
    """
    make_folder(folder)
    if any(folder.iterdir()) and not force and not _is_export(folder / MARK):
        raise InputError(folder, "", "holds something that is not an export; give another folder, or --force")


def _is_export(mark: Path) -> bool:
    """Whether a mark is there and says so."""
    if not mark.is_file():
        return False
    try:
        found = json.loads(read_text(mark, limit=LARGEST_MARK))
    except ValueError:
        return False
    return isinstance(found, dict) and "wherry-export" in found


def _template(name: str) -> str:
    """A file that is the same for every world."""
    return (resources.files("wherry.gazebo") / "templates" / name).read_text(encoding="utf-8")
