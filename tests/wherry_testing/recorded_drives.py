"""A simulated drive that is recorded to bags of every format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.floorplan.world_files import find_world
from wherry.robot import Velocity
from wherry.ros.bags.run_recorder import RunRecorder
from wherry.ros.bags.writer import BagWriter
from wherry.simulation import build
from wherry.space.pose import Pose

DURATION = 20.0  # s, simulated time of the drive
SCANS = 200  # scans of the drive


@dataclass(frozen=True)
class RecordedDrive:
    """Bags of the same drive.

    Attributes:
        ros1: Path of a ROS 1 bag.
        mcap: Path of a ROS 2 bag in one MCAP file.
        ros2: Path of a ROS 2 bag's folder.
        end: True pose of base_link at the end of the drive, relative to its start.
    """

    ros1: Path
    mcap: Path
    ros2: Path
    end: Pose


def record_drive(folder: Path) -> RecordedDrive:
    """Record a drive without collisions, which would make the wheels slip."""
    paths = [folder / name for name in ("run.bag", "run.mcap", "run")]
    simulation = build(find_world("small"), np.random.default_rng(0))
    start = simulation.referee.pose
    bags = [BagWriter(path) for path in paths]
    robot = simulation.robot
    for bag in bags:
        robot = RunRecorder(bag).robot(robot)
    while simulation.time < DURATION:
        robot.receive()
        robot.command(Velocity(0.2, -0.25) if simulation.time < DURATION / 2.0 else Velocity(0.0, 0.4))
    assert not simulation.referee.collisions
    for bag in bags:
        bag.close()
    return RecordedDrive(*paths, end=simulation.referee.pose.relative_to(start))
