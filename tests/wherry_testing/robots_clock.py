"""The time that a robot needs to stop, on the robot's clock, measured from outside.

On a busy machine messages arrive late. The message with the lowest latency relates the two clocks best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

ODOMETRY_PERIOD = 0.05  # s
CLOCK_WINDOW = 5.0  # s before and after an instant in which the clocks are compared
STOPPING_RESOLUTION = 2 * ODOMETRY_PERIOD + 1e-6  # s, until a command acts and the next odometry shows it
STANDSTILL_SPEED = 0.01  # m/s and rad/s


@dataclass(frozen=True)
class ReceivedOdometry:
    """An odometry message.

    Attributes:
        received_at: Time of arrival on this machine's monotonic clock, s.
        stamp: Time on the robot's clock, s.
        speed: Speed, m/s or rad/s.
    """

    received_at: float
    stamp: float
    speed: float


def robot_time(received: Sequence[ReceivedOdometry], instant: float) -> float:
    """The time on the robot's clock, s, at an instant of this machine's monotonic clock, s."""
    nearby = [message for message in received if abs(message.received_at - instant) <= CLOCK_WINDOW]
    return instant + max(message.stamp - message.received_at for message in nearby)


def stopping_time(received: Sequence[ReceivedOdometry], begin: float) -> float:
    """The time on the robot's clock, s, from an instant of this machine's monotonic clock until the robot stands."""
    before = robot_time(received, begin)
    standing = [message.stamp for message in received if abs(message.speed) < STANDSTILL_SPEED]
    return min(stamp for stamp in standing if stamp > before) - before
