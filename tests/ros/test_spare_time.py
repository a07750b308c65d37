"""What the agent does in the robot's spare time never stands between a scan and its velocity."""

from __future__ import annotations

import numpy as np

from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.body_files import load_body
from wherry.ros.encoding import encode_laser_scan, encode_odometry
from wherry.ros.names import load_names
from wherry.ros.nodes.robot import RosRobot
from wherry.space.pose import Pose
from wherry_testing.bus import Bus

TOPICS = load_names().topics


def say(bus: Bus, time: float) -> None:
    """Odometry, and a scan of the same instant."""
    bus.say(TOPICS.odom, encode_odometry(Odometry(time, Pose(), Velocity()), "odom", "base_link", np.zeros(36)))
    bus.say(TOPICS.scan, encode_laser_scan(Scan(time, np.ones(8), 0.0, 0.5, 0.1, 9.0), "laser"))


def test_it_comes_when_nothing_waits_to_be_taken_in() -> None:
    bus = Bus()
    robot = RosRobot(bus.node(), load_names(), load_body())
    spare: list[float] = []

    def in_spare_time() -> None:
        spare.append(robot.time)
        say(bus, robot.time + 0.1)

    robot.in_spare_time = in_spare_time
    say(bus, 1.0)
    received = [robot.receive() for _ in range(4)]
    assert [(type(one), round(one.time, 6)) for one in received] == [
        (Odometry, 1.0),
        (Scan, 1.0),
        (Odometry, 1.1),  # for which it had to wait
        (Scan, 1.1),
    ]
    assert spare == [1.0]
