from __future__ import annotations

import numpy as np
import pytest

from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.encoding import encode_laser_scan, encode_odometry
from wherry.ros.names import load_names
from wherry.ros.nodes import monitor as monitoring
from wherry.ros.nodes.monitor import Monitor
from wherry.space.pose import Pose
from wherry_testing.bus import Bus

TOPICS = load_names().topics


class WallClock:
    """A wall clock that a test advances."""

    def __init__(self) -> None:
        self.now = 50.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    clock = WallClock()
    monkeypatch.setattr(monitoring, "time", clock)
    return clock


def scan(time: float) -> ros.LaserScan:
    return encode_laser_scan(Scan(time, np.ones(4), 0.0, 1.0, 0.0, 9.0), "laser")


def test_missing_messages_are_counted_from_stamps(clock: WallClock) -> None:
    bus = Bus()
    monitor = Monitor(bus.node(), load_names())
    for tick in range(40):
        if tick not in (7, 20, 21):
            bus.say(TOPICS.scan, scan(tick / 10))
    for tick in range(100):
        odometry = Odometry(tick / 20, Pose(), Velocity())
        bus.say(TOPICS.odom, encode_odometry(odometry, "odom", "base_link", np.zeros(36)))
    statistics = monitor.statistics()
    assert (statistics["scans"], statistics["scans missing"]) == (37, 3)
    assert (statistics["odometry"], statistics["odometry missing"]) == (100, 0)
    assert statistics["scan to velocity, median, ms"] is None


def test_scan_is_answered_by_the_next_velocity(clock: WallClock) -> None:
    bus = Bus()
    monitor = Monitor(bus.node(), load_names())
    for tick in range(100):
        clock.now = 50.0 + tick / 10
        bus.say(TOPICS.scan, scan(tick / 10))
        if tick % 10 == 9:
            continue  # not answered: the agent is planning
        clock.now += 0.002 if tick else 0.040
        bus.say(TOPICS.cmd_vel, ros.Twist())
        clock.now += 0.001
        bus.say(TOPICS.cmd_vel_stamped, ros.TwistStamped())
    statistics = monitor.statistics()
    assert (statistics["scans"], statistics["scans answered"], statistics["velocities"]) == (100, 90, 180)
    assert statistics["scan to velocity, median, ms"] == pytest.approx(2.0)
    worst = statistics["scan to velocity, 99 %, ms"]
    assert worst is not None
    assert 2.0 < worst < 40.0


def test_without_messages_there_is_no_latency(clock: WallClock) -> None:
    statistics = Monitor(Bus().node(1), load_names()).statistics()
    assert statistics["scans"] == 0
    assert statistics["scan to velocity, 99 %, ms"] is None
