"""Rival poses: other poses on the map at which all that the robot has scanned agrees with the map as well.

In a building with two identical wings a particle filter keeps only one of two equally likely modes, since resampling
extinguishes the other one by chance. Its posterior then no longer shows the ambiguity. Rivals are therefore searched
once on the whole map when the filter has settled on a mode, compared with the scans since the start, and then tracked
beside the filter by odometry and scan matching until the scans decide between them and the estimate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wherry.localization.agreement import ScanAgreement, ScanComparison
from wherry.localization.refinement import match_scan
from wherry.localization.relocalization import (
    DRIFT_COVARIANCE,
    INDEPENDENT_BEAMS,
    MATCH_SIGMA,
    MODE_ANGLE,
    MODE_DISTANCE,
    Hypothesis,
    drift_covariance,
)
from wherry.space.pose import Floats, Pose

KEY_DISTANCE, KEY_ANGLE = 0.5, 0.5  # m, rad, motions from which scans count as independent
SEARCH_MIN_KEY_SCANS = 4  # independent scans from which the whole map is searched for rivals
MAX_KEY_SCANS = 24  # earlier scans with which the rivals of a search are compared
MODEL_ERROR = 0.1  # mean log likelihood per beam by which errors of the map make equal poses differ
MAX_SCAN_LOG_ODDS = 6.0  # absolute value of the log odds by a single scan
MAX_LOG_ODDS = 8.0  # absolute value of log odds beyond which a rival or the estimate is certain
MIN_LOG_ODDS = -5.0  # log odds to the estimate below which a rival is dropped
SWITCH_LOG_ODDS = math.log(0.95 / 0.05)  # log odds to the estimate from which a rival replaces it


@dataclass(frozen=True, slots=True)
class Rival:
    """Another pose that agrees with the scans.

    Attributes:
        pose: Pose of base_link at the last independent scan, map frame.
        covariance: [3, 3] m, m, rad, covariance of the pose.
        log_odds: Log odds of this pose against the estimate.
        agreement: Agreement of the last independent scan with the map at the pose.
    """

    pose: Pose
    covariance: Floats
    log_odds: float
    agreement: ScanAgreement


@dataclass(frozen=True, slots=True)
class KeyScan:
    """A scan that counts as independent of the one before.

    Attributes:
        odometry: Pose of base_link, odom frame.
        ends: [B, 2] m, ends of the beams, base_link frame.
        estimate: Estimated pose of base_link, map frame.
        agreement: Agreement with the map at the estimated pose.
    """

    odometry: Pose
    ends: Floats
    estimate: Pose
    agreement: ScanAgreement


class Rivals:
    """The rivals of an estimate, from the scans since a start at an unknown pose.

    Args:
        comparison: Compares scans with the map.

    Attributes:
        needs_search: Whether the robot started at an unknown pose and the whole map was not searched since.
    """

    def __init__(self, comparison: ScanComparison) -> None:
        self._comparison = comparison
        self._rivals: list[Rival] = []
        self._key_scans: list[KeyScan] = []
        self.needs_search = False

    def restart(self, *, is_global: bool) -> None:
        """Forget all rivals and scans; after a start at a known pose there are no rivals to search."""
        self._rivals.clear()
        self._key_scans.clear()
        self.needs_search = is_global

    def at(self, odometry: Pose) -> tuple[Rival, ...]:
        """The rivals, the most probable first, when the robot is at a pose in the odom frame."""
        ranked = sorted(self._rivals, key=lambda rival: -rival.log_odds)
        motion = odometry.relative_to(self._key_scans[-1].odometry) if self._key_scans else Pose()
        return tuple(replace(rival, pose=rival.pose @ motion) for rival in ranked)

    @property
    def is_search_due(self) -> bool:
        """Whether the robot has moved enough since its start at an unknown pose for a search of the whole map."""
        return self.needs_search and len(self._key_scans) >= SEARCH_MIN_KEY_SCANS

    @property
    def probability(self) -> float:
        """Probability that one of the rivals is right instead of the estimate, 0 to 1."""
        odds = sum(math.exp(rival.log_odds) for rival in self._rivals)
        return odds / (1.0 + odds)

    def add_scan(self, odometry: Pose, ends: Floats, agreement: ScanAgreement, estimate: Pose) -> None:
        """Compare a scan with the map at all rivals if the robot has moved enough since the last one.

        Args:
            odometry: Pose of base_link, odom frame.
            ends: [B, 2] m, ends of the beams, base_link frame.
            agreement: Agreement with the map at the estimated pose.
            estimate: Estimated pose of base_link, map frame.
        """
        if not len(ends):
            return
        if self._key_scans and odometry.is_near(self._key_scans[-1].odometry, KEY_DISTANCE, KEY_ANGLE):
            return
        if self._key_scans:
            last = self._key_scans[-1]
            former = Rival(last.estimate, DRIFT_COVARIANCE, 0.0, last.agreement)
            motion = odometry.relative_to(last.odometry)
            self._follow([former, *self._rivals], motion, ends, agreement, estimate)
        self._key_scans.append(KeyScan(odometry, ends, estimate, agreement))
        del self._key_scans[:-MAX_KEY_SCANS]

    def add_hypotheses(self, hypotheses: Sequence[Hypothesis], odometry: Pose, estimate: Pose) -> None:
        """Make rivals of the poses that are consistent with the last scan and with those before.

        Args:
            hypotheses: Poses on the map that are consistent with the last scan.
            odometry: Pose of base_link at the last scan, odom frame.
            estimate: Estimated pose of base_link, map frame.
        """
        if self._key_scans:
            self.needs_search = not self.is_search_due
            found = [self._from_hypothesis(hypothesis, odometry) for hypothesis in hypotheses]
            self._keep([*self._rivals, *found], estimate @ self._key_scans[-1].odometry.relative_to(odometry))

    def swap(self, rival: Rival, estimate: Pose, covariance: Floats, odometry: Pose, agreement: ScanAgreement) -> None:
        """Make the former estimate a rival of the rival that replaces it.

        Args:
            rival: The rival, from `at`.
            estimate: The former estimate, pose of base_link in the map frame.
            covariance: [3, 3] m, m, rad, covariance of the former estimate.
            odometry: Pose of base_link, odom frame.
            agreement: Agreement of the last scan with the map at the former estimate.
        """
        last = self._key_scans[-1]
        back = last.odometry.relative_to(odometry)
        self._key_scans[-1] = replace(last, estimate=rival.pose @ back, agreement=rival.agreement)
        others = [replace(other, log_odds=other.log_odds - rival.log_odds) for other in self._rivals]
        former = Rival(estimate @ back, covariance, -rival.log_odds, agreement)
        self._keep([*others, former], rival.pose @ back)

    def _keep(self, rivals: Sequence[Rival], estimate: Pose) -> None:
        """Keep the best of the rivals at each pose, except at the estimate's, and drop the improbable ones."""
        self._rivals = []
        for rival in sorted(rivals, key=lambda one: -one.log_odds):
            others = [estimate, *(kept.pose for kept in self._rivals)]
            if rival.log_odds > MIN_LOG_ODDS and not any(_is_same(rival.pose, other) for other in others):
                self._rivals.append(rival)

    def _follow(
        self, poses: Sequence[Rival], motion: Pose, ends: Floats, agreement: ScanAgreement, estimate: Pose
    ) -> None:
        """Move the former estimate and its rivals to the next scan; those at other poses than the estimate are kept.

        The filter's estimate may change from one mode to another. Then the former one is a rival from now on.
        """
        moved = [self._moved(pose, motion, ends, agreement) for pose in poses]
        same = (before.log_odds for before, after in zip(poses, moved, strict=True) if _is_same(after.pose, estimate))
        base = next(same, 0.0)
        self._keep([replace(rival, log_odds=rival.log_odds - base) for rival in moved], estimate)

    def _moved(self, rival: Rival, motion: Pose, ends: Floats, agreement: ScanAgreement) -> Rival:
        """The rival at the next scan, after a motion by odometry."""
        covariance = rival.covariance + drift_covariance(motion)
        match = match_scan(self._comparison.field, ends, rival.pose @ motion, covariance, MATCH_SIGMA)
        found = self._comparison.agreement(ends, match.pose)
        log_odds = min(rival.log_odds + _scan_log_odds(found, agreement), MAX_LOG_ODDS)
        return Rival(match.pose, match.covariance, log_odds, found)

    def _from_hypothesis(self, hypothesis: Hypothesis, odometry: Pose) -> Rival:
        """The rival at a pose for the last scan, followed back along the path that odometry measured."""
        log_odds, pose, last, path = 0.0, hypothesis.pose, odometry, []
        for key in reversed(self._key_scans):
            motion = key.odometry.relative_to(last)
            covariance = DRIFT_COVARIANCE + drift_covariance(motion)
            match = match_scan(self._comparison.field, key.ends, pose @ motion, covariance, MATCH_SIGMA)
            path.append((match, self._comparison.agreement(key.ends, match.pose)))
            log_odds += _scan_log_odds(path[-1][1], key.agreement)
            pose, last = match.pose, key.odometry
        newest, agreement = path[0]
        limited = float(np.clip(log_odds, -MAX_LOG_ODDS, MAX_LOG_ODDS))
        return Rival(newest.pose, newest.covariance, limited, agreement)


def _scan_log_odds(rival: ScanAgreement, estimate: ScanAgreement) -> float:
    """Log odds of a rival against the estimate by one scan; differences within the model error are none."""
    difference = rival.log_likelihood - estimate.log_likelihood
    beyond = math.copysign(max(abs(difference) - MODEL_ERROR, 0.0), difference)
    return float(np.clip(INDEPENDENT_BEAMS * beyond, -MAX_SCAN_LOG_ODDS, MAX_SCAN_LOG_ODDS))


def _is_same(first: Pose, second: Pose) -> bool:
    """Whether two poses belong to one mode."""
    return first.is_near(second, MODE_DISTANCE, MODE_ANGLE)
