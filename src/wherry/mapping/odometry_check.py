"""Odometry against scan matching: where they contradict each other, and how far odometry is still trusted.

A measured motion is an outlier if its distance from the matched motion is not explained by the noise of odometry and
the covariance of the match, which is large along a corridor without features: there odometry cannot be contradicted.
"""

from __future__ import annotations

import enum
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.mapping.covariances import invert, regularized_inverse, rotate_covariance
from wherry.mapping.motion_noise import ODOMETRY_NOISE
from wherry.mapping.refinement import Refinement
from wherry.space.pose import Floats, Pose, wrap

MAX_DISAGREEMENT = 4.5  # standard deviations; 99.99 % of the χ distribution with three degrees of freedom lie below
MAX_BIAS = 1.5  # standard deviations of the mean error beyond which odometry has a wrong scale or sign
BIAS_GAIN = 1.0 / 8.0  # weight of a new error in the moving average, which spans about 8 keyframes
TELLING_DISTANCE, TELLING_ANGLE = 0.2, math.radians(10.0)  # m and rad, motions that show a scale in full
MAX_LINEAR_SPEED = 5.0  # m/s, faster than indoor robots drive
MAX_ANGULAR_SPEED = math.tau  # rad/s, faster than indoor robots turn
MIN_STEP_TIME = 0.1  # s, shortest time that a speed is computed over, since time stamps jitter
MIN_CLOCK_STEP = 0.01  # s between scans below which the clock is taken to have stopped, as in logs with rounded times
MAX_DETERMINED_SIGMA = 0.1  # m, standard deviation of a match up to which it tells that odometry is right
STOPPED_SHARE = 0.25  # share of the matched motion below which odometry counts as stopped

FULL_CREDIT = 8  # credit of odometry that agrees with scan matching
TRUSTED_CREDIT = 4  # credit from which on motions are predicted by odometry
CONTRADICTION_COST = 4  # credit that a contradiction costs; an agreement restores one


class ContradictionKind(enum.StrEnum):
    """How odometry differs from the matched motion."""

    STOPPED = "no motion"
    JUMP = "a jump"
    TURN = "a wrong turn"
    DISTANCE = "a wrong distance"


@dataclass(frozen=True, slots=True)
class OdometryContradiction:
    """A motion that odometry and scan matching measure differently.

    Attributes:
        time: Time of the scan at the end of the motion, s.
        since: Time of the scan at its beginning, s.
        odometry: The motion of base_link by odometry.
        matched: The motion by scan matching, which the map follows.
    """

    time: float
    since: float
    odometry: Pose
    matched: Pose

    @property
    def kind(self) -> ContradictionKind:
        """How odometry differs."""
        if not is_plausible(self.odometry, self.time - self.since):
            return ContradictionKind.JUMP
        distance, angle = ODOMETRY_NOISE.deviations(self.matched)
        measured, actual = (
            math.hypot(motion.x / distance, motion.y / distance, wrap(motion.theta) / angle)
            for motion in (self.odometry, self.matched)
        )
        if measured < STOPPED_SHARE * actual:
            return ContradictionKind.STOPPED
        error = self.odometry.relative_to(self.matched)
        is_turn = abs(error.theta) / angle > math.hypot(error.x, error.y) / distance
        return ContradictionKind.TURN if is_turn else ContradictionKind.DISTANCE


def is_plausible(motion: Pose, elapsed: float) -> bool:
    """Whether a robot can move like this within a time, s; of a clock that has stopped nothing follows."""
    if elapsed < MIN_CLOCK_STEP:
        return True
    time = max(elapsed, MIN_STEP_TIME)
    is_slow = math.hypot(motion.x, motion.y) <= MAX_LINEAR_SPEED * time
    return is_slow and abs(wrap(motion.theta)) <= MAX_ANGULAR_SPEED * time


def normalized_error(odometry: Pose, matched: Pose) -> Floats:
    """Error of a motion by odometry against the matched one, [3] standard deviations of odometry, base_link frame."""
    error = odometry.relative_to(matched)
    distance, angle = ODOMETRY_NOISE.deviations(matched)
    return np.array([error.x / distance, error.y / distance, error.theta / angle])


def is_contradicted(odometry: Pose, matched: Pose, match: Refinement) -> bool:
    """Whether a match contradicts a motion by odometry, by their Mahalanobis distance.

    Args:
        odometry: The motion of base_link by odometry.
        matched: The motion to the pose of the match.
        match: The match that the motion ends at.
    """
    if np.linalg.norm(normalized_error(odometry, matched)) <= MAX_DISAGREEMENT:
        return False  # the covariance of the match would only reduce the distance
    information = rotate_covariance(match.information, -match.pose.theta)
    covariance = ODOMETRY_NOISE.covariance(matched) + regularized_inverse(information)
    offset = odometry.relative_to(matched).as_array()
    return float(offset @ invert(covariance) @ offset) > MAX_DISAGREEMENT**2


def is_determined(match: Refinement) -> bool:
    """Whether the scan determines its position in every direction, so that agreement with odometry means something."""
    covariance = regularized_inverse(match.information)
    return float(np.linalg.eigvalsh(covariance[:2, :2])[-1]) <= MAX_DETERMINED_SIGMA**2


def describe_contradictions(contradictions: Sequence[OdometryContradiction], scans: int) -> str:
    """A sentence for people that says where a map does not follow odometry; empty without contradictions.

    Args:
        contradictions: The contradictions of a run.
        scans: Number of scans of the run.
    """
    if not contradictions:
        return ""
    kinds = Counter(contradiction.kind for contradiction in contradictions).most_common()
    counts = ", ".join(f"{count} × {kind}" for kind, count in kinds)
    first, last = contradictions[0].time, contradictions[-1].time
    when = f"at {first:.3f} s" if first == last else f"between {first:.3f} and {last:.3f} s"
    number = f"{len(contradictions):,} of {scans:,} scans"
    return f"scan matching contradicts odometry at {number}, {when} ({counts}); the map follows the scans there"
