"""Motions by scan matching compared with odometry, which shows a lidar that is not where the log says."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.robot import Odometry
from wherry.space.pose import Floats, Pose, relative, wrap

MIN_DISTANCE, MIN_TURN = 0.1, 0.1  # m and rad, motion between two compared scans
MIN_COMPARED_DISTANCE, MIN_COMPARED_TURN = 0.05, 0.02  # m and rad, part of a motion that is well above its noise
MAX_RATIO = 2.0  # ratio of two lengths of a motion above which odometry slipped, or matching failed
MIN_TOTAL_DISTANCE, MIN_TOTAL_TURN = 1.0, 1.0  # m and rad, sum of the compared motions from which on they are evidence
MIN_CONCENTRATION = 0.8  # length of the mean of the unit vectors between both directions: they differ always alike
HEADING_TOLERANCE = math.radians(10.0)  # difference of both directions that odometry's own errors may cause
WRONG_HEADING = math.radians(45.0)  # difference of both directions from which headings of the trajectory are wrong
MIRRORED_MAX_RATIO = -0.5  # turn by scan matching ÷ turn by odometry below which the scans are mirrored


@dataclass(frozen=True, slots=True)
class MotionAgreement:
    """How the motions by scan matching agree with odometry.

    Attributes:
        turn_ratio: Turn by scan matching ÷ turn by odometry, by least squares; None without turns.
        heading_offset: Direction of motion by odometry in the base_link frame less that by scan matching, rad; None if
            there are no motions, or if the difference varies.
    """

    turn_ratio: float | None
    heading_offset: float | None

    @property
    def is_mirrored(self) -> bool:
        """Whether the scans turn the other way than the robot."""
        return self.turn_ratio is not None and self.turn_ratio < MIRRORED_MAX_RATIO

    @property
    def is_wrong(self) -> bool:
        """Whether the map is mirrored, or the headings of the trajectory are wrong."""
        return self.is_mirrored or (self.heading_offset is not None and abs(self.heading_offset) > WRONG_HEADING)

    def doubt(self, lidar: Pose) -> str:
        """What is probably wrong with the lidar, for people; empty if nothing is.

        Args:
            lidar: Pose of the lidar in the base_link frame that was used.
        """
        if self.is_mirrored:
            return (
                "the scans turn the other way than odometry: either the map is mirrored, since the lidar is upside "
                "down or its beams are in reverse order, or odometry turns the wrong way"
            )
        if self.heading_offset is None or abs(self.heading_offset) <= HEADING_TOLERANCE:
            return ""
        offset, theta = math.degrees(self.heading_offset), math.degrees(wrap(lidar.theta + self.heading_offset))
        return (
            f"by odometry the robot drives at {round(offset)}° to where it drives by the scans: either the lidar's θ "
            f"is {round(theta)}° and not {round(math.degrees(lidar.theta))}°, which --lidar x,y,theta states, or "
            "odometry's directions are wrong"
        )


def compare_motions(poses: Floats, odometry: Sequence[Odometry | None]) -> MotionAgreement:
    """Compare a trajectory with odometry.

    Args:
        poses: [N, 3] m, m, rad, base_link at the scans by scan matching.
        odometry: [N] odometry at the scans; None where there is none.
    """
    steps = [
        relative(np.stack([poses[last], measured_last.as_array()]), np.stack([poses[first], measured_first.as_array()]))
        for first, last, measured_first, measured_last in _motions(odometry)
    ]
    if not steps:
        return MotionAgreement(None, None)
    matched, measured = np.stack(steps, axis=1)
    return MotionAgreement(_turn_ratio(matched[:, 2], measured[:, 2]), _heading_offset(matched, measured))


def _motions(odometry: Sequence[Odometry | None]) -> Iterator[tuple[int, int, Pose, Pose]]:
    """Pairs of scans between which the robot moved by odometry, with their odometry."""
    first: tuple[int, Pose] | None = None
    for index, reading in enumerate(odometry):
        if reading is None:
            first = None
        elif first is None:
            first = (index, reading.pose)
        else:
            motion = reading.pose.relative_to(first[1])
            if math.hypot(motion.x, motion.y) >= MIN_DISTANCE or abs(motion.theta) >= MIN_TURN:
                yield first[0], index, first[1], reading.pose
                first = (index, reading.pose)


def _turn_ratio(matched: Floats, measured: Floats) -> float | None:
    """Least-squares ratio of turns [N] rad of a similar size; half turns, whose sign is undetermined, are left out."""
    is_similar = _is_similar(np.abs(matched), np.abs(measured), MIN_COMPARED_TURN) & (np.abs(measured) < math.pi / 2.0)
    if np.abs(measured[is_similar]).sum() < MIN_TOTAL_TURN:
        return None
    return float((matched * measured)[is_similar].sum() / (measured**2)[is_similar].sum())


def _heading_offset(matched: Floats, measured: Floats) -> float | None:
    """Mean difference between the directions of motions [N, 3] m, m, rad of a similar length, rad."""
    lengths, measured_lengths = np.hypot(*matched[:, :2].T), np.hypot(*measured[:, :2].T)
    is_similar = _is_similar(lengths, measured_lengths, MIN_COMPARED_DISTANCE)
    weights = measured_lengths[is_similar]
    if weights.sum() < MIN_TOTAL_DISTANCE:
        return None
    turns = np.arctan2(measured[:, 1], measured[:, 0]) - np.arctan2(matched[:, 1], matched[:, 0])
    mean = complex((weights * np.exp(1j * turns[is_similar])).sum() / weights.sum())
    return math.atan2(mean.imag, mean.real) if abs(mean) >= MIN_CONCENTRATION else None


def _is_similar(first: Floats, second: Floats, smallest: float) -> NDArray[np.bool_]:
    """Whether sizes [N] are above a smallest one and within `MAX_RATIO` of each other."""
    return (np.minimum(first, second) >= smallest) & (
        np.maximum(first, second) <= MAX_RATIO * np.minimum(first, second)
    )
