"""What a robot's clock says at an instant of this machine's, and how long the robot took to stand.

A busy machine passes messages on late, some later than others: the one that came through the fastest sets the clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

ODOMETRY_PERIOD = 0.05  # s
RECENT = 5.0  # s, over which the two clocks are compared
# s: a command is obeyed at the next instant at which the robot works, and the next odometry shows that it stands.
GRANULARITY = 2 * ODOMETRY_PERIOD + 1e-6
STANDING = 0.01  # m/s and rad/s


@dataclass(frozen=True)
class Heard:
    """An odometry.

    Attributes:
        at: s, on this machine's monotonic clock, when it was heard.
        stamp: s, on the robot's.
        speed: m/s and rad/s.
    """

    at: float
    stamp: float
    speed: float


def robots_time(heard: Sequence[Heard], instant: float) -> float:
    """S, on the robot's clock, at an instant of this machine's monotonic one."""
    return instant + max(one.stamp - one.at for one in heard if instant - RECENT <= one.at <= instant + RECENT)


def stopped_after(heard: Sequence[Heard], begin: float) -> float:
    """S on the robot's clock from an instant of this machine's until the robot stood."""
    before = robots_time(heard, begin)
    return min(one.stamp for one in heard if one.stamp > before and abs(one.speed) < STANDING) - before
