"""Faults of odometry: each takes the poses that correct odometry measures and returns what a faulty robot sends."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from wherry.robot import Odometry, Velocity
from wherry.space.pose import Floats, Pose, compose, relative
from wherry_testing.buildings import Drive

# Takes odometry poses [N, 3] m, m, rad with their times [N] s and a source of randomness.
Fault = Callable[[Floats, Floats, np.random.Generator], Floats]


def _steps(poses: Floats) -> Floats:
    """Motions from each pose to the next, [N − 1, 3] m, m, rad."""
    return relative(poses[1:], poses[:-1])


def _integrated(start: Floats, steps: Floats) -> Floats:
    """Poses that motions [N − 1, 3] lead to from a first pose [3], [N, 3]."""
    poses = [start]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


def _moving(poses: Floats, rng: np.random.Generator) -> int:
    """Index of a pose in the middle half of a drive, from which the robot drives on for a while."""
    lengths = np.hypot(*_steps(poses)[:, :2].T)
    later = np.convolve(lengths, np.ones(10), "full")[9 : 9 + len(lengths)]
    middle = np.arange(len(lengths) // 4, 3 * len(lengths) // 4)
    return int(rng.choice(middle[later[middle] >= 0.7 * later[middle].max()]))


def constant(poses: Floats, times: Floats, rng: np.random.Generator) -> Floats:
    """Odometry that never changes."""
    del times, rng
    return np.tile(poses[0], (len(poses), 1))


def reset(poses: Floats, times: Floats, rng: np.random.Generator) -> Floats:
    """Odometry that begins again at zero in the middle of the drive."""
    del times
    at = _moving(poses, rng)
    return np.vstack([poses[:at], relative(poses[at:], poses[at])])


def jump(distance: float, angle: float = 0.0, count: int = 1) -> Fault:
    """Jumps by a distance, m, in random directions, and by an angle, rad, to either side."""

    def fault(poses: Floats, times: Floats, rng: np.random.Generator) -> Floats:
        del times
        steps = _steps(poses)
        for at in [_moving(poses, rng) for _ in range(count)]:
            direction = rng.uniform(-math.pi, math.pi)
            offset = [distance * math.cos(direction), distance * math.sin(direction), angle * rng.choice([-1.0, 1.0])]
            steps[at] = compose(steps[at], np.array(offset))
        return _integrated(poses[0], steps)

    return fault


def frozen(duration: float, count: int = 1) -> Fault:
    """Wheels that report no motion for a duration, s, while the robot drives."""

    def fault(poses: Floats, times: Floats, rng: np.random.Generator) -> Floats:
        steps = _steps(poses)
        for at in [_moving(poses, rng) for _ in range(count)]:
            steps[(times[1:] > times[at]) & (times[1:] <= times[at] + duration)] = 0.0
        return _integrated(poses[0], steps)

    return fault


def phantom_turn(angle: float, duration: float) -> Fault:
    """A turn by an angle, rad, within a duration, s, that does not happen."""

    def fault(poses: Floats, times: Floats, rng: np.random.Generator) -> Floats:
        steps = _steps(poses)
        at = _moving(poses, rng)
        during = (times[1:] > times[at]) & (times[1:] <= times[at] + duration)
        steps[during, 2] += angle / during.sum()
        return _integrated(poses[0], steps)

    return fault


def scaled(distance: float, angle: float) -> Fault:
    """Distances and angles that are off by constant factors; a negative one is a wrong sign."""

    def fault(poses: Floats, times: Floats, rng: np.random.Generator) -> Floats:
        del times, rng
        return _integrated(poses[0], _steps(poses) * np.array([distance, distance, angle]))

    return fault


def garbage(distance: float, angle: float) -> Fault:
    """Every pose is off by Gaussian errors, m and rad, of its own."""

    def fault(poses: Floats, times: Floats, rng: np.random.Generator) -> Floats:
        del times
        return poses + rng.normal(size=poses.shape) * np.array([distance, distance, angle])

    return fault


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        "constant": constant,
        "reset": reset,
        "jump of 1 m": jump(1.0),
        "jump of 6 m": jump(6.0),
        "jump of 0.2 m": jump(0.2, count=3),
        "three jumps of 1.5 m": jump(1.5, count=3),
        "frozen for 2 s": frozen(2.0),
        "frozen for 5 s": frozen(5.0),
        "heading jump of 90°": jump(0.0, math.radians(90.0)),
        "heading jump of 180°": jump(0.0, math.radians(180.0)),
        "heading jump of 30°": jump(0.0, math.radians(30.0)),
        "phantom turn of 90° in 1 s": phantom_turn(math.radians(90.0), 1.0),
        "phantom turn of 90° in 3 s": phantom_turn(math.radians(90.0), 3.0),
        "mirrored heading": scaled(1.0, -1.0),
        "backwards": scaled(-1.0, 1.0),
        "double distances": scaled(2.0, 1.0),
        "half distances": scaled(0.5, 1.0),
        "double turns": scaled(1.0, 2.0),
        "no turns": scaled(1.0, 0.0),
        "garbage": garbage(0.5, 1.0),
        "noise": garbage(0.1, 0.1),
    }
)


def measured(drive: Drive, fault: Fault, rng: np.random.Generator) -> list[Odometry]:
    """The odometry of a drive with a fault, at each scan."""
    poses = np.array([odometry.pose.as_array() for odometry in drive.odometry])
    times = np.array([odometry.time for odometry in drive.odometry])
    faulty = fault(poses, times, rng)
    return [Odometry(time, Pose.from_array(pose), Velocity()) for time, pose in zip(times, faulty, strict=True)]
