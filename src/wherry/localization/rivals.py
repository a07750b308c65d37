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
MIN_KEY_SCANS = 4  # independent scans from which rivals are searched on the whole map and may replace the estimate
MAX_KEY_SCANS = 24  # earlier scans with which the rivals of a search are compared
MODEL_ERROR = 0.1  # mean log likelihood per beam by which errors of the map make equal poses differ
MAX_SCAN_LOG_ODDS = 6.0  # log odds against a rival by a single scan, at most
MAX_ESTIMATE_LOG_ODDS = 2.5  # log odds against the estimate by a single scan, at most; one alone never replaces it
MAX_LOG_ODDS = 20.0  # log odds to the estimate, at most
MIN_LOG_ODDS = -5.0  # log odds to the most probable pose below which a rival is dropped
SCAN_DECAY = 0.8  # factor of the log odds from one independent scan to the next; the map's errors are correlated
SWITCH_PROBABILITY = 0.95  # probability from which a rival replaces the estimate


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
        independent_scans: Number of independent scans since the start.
    """

    def __init__(self, comparison: ScanComparison) -> None:
        self._comparison = comparison
        self._rivals: list[Rival] = []
        self._key_scans: list[KeyScan] = []
        self.needs_search = False
        self.independent_scans = 0

    def restart(self, *, is_global: bool) -> None:
        """Forget all rivals and scans; after a start at a known pose there are no rivals to search."""
        self._rivals.clear()
        self._key_scans.clear()
        self.needs_search = is_global
        self.independent_scans = 0

    def at(self, odometry: Pose) -> tuple[Rival, ...]:
        """The rivals, the most probable first, when the robot is at a pose in the odom frame."""
        ranked = sorted(self._rivals, key=lambda rival: -rival.log_odds)
        motion = odometry.relative_to(self._key_scans[-1].odometry) if self._key_scans else Pose()
        return tuple(replace(rival, pose=rival.pose @ motion) for rival in ranked)

    @property
    def is_search_due(self) -> bool:
        """Whether the robot has moved enough since its start at an unknown pose for a search of the whole map."""
        return self.needs_search and self.independent_scans >= MIN_KEY_SCANS

    def successor(self, odometry: Pose) -> Rival | None:
        """The rival that replaces the estimate when the robot is at a pose in the odom frame; None for the estimate."""
        if not self._rivals or self.independent_scans < MIN_KEY_SCANS:
            return None
        best = self.at(odometry)[0]
        return best if self.probability_of(best) > SWITCH_PROBABILITY else None

    @property
    def probability(self) -> float:
        """Probability that one of the rivals is right instead of the estimate, 0 to 1."""
        return 1.0 - 1.0 / self._total_odds

    def probability_of(self, rival: Rival) -> float:
        """Probability that a rival is right instead of the estimate and all other rivals, 0 to 1."""
        return math.exp(rival.log_odds) / self._total_odds

    @property
    def _total_odds(self) -> float:
        """Odds of the rivals and of the estimate against the estimate."""
        return 1.0 + sum(math.exp(rival.log_odds) for rival in self._rivals)

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
        key = KeyScan(odometry, ends, estimate, agreement)
        if self._key_scans:
            self._follow(key)
        self._key_scans.append(key)
        del self._key_scans[:-MAX_KEY_SCANS]
        self.independent_scans += 1

    def add_hypotheses(self, hypotheses: Sequence[Hypothesis], odometry: Pose, estimate: Pose) -> None:
        """Make rivals of the poses that are consistent with the last scan and with those before.

        Args:
            hypotheses: Poses on the map that are consistent with the last scan.
            odometry: Pose of base_link at the last scan, odom frame.
            estimate: Estimated pose of base_link, map frame.
        """
        if not self._key_scans:
            return
        self.needs_search = not self.is_search_due
        back = self._key_scans[-1].odometry.relative_to(odometry)
        found = [Rival(one.pose @ back, one.covariance, 0.0, one.agreement) for one in hypotheses]
        self._keep([*self._rivals, *self._compared(found)], estimate @ back)

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
        limited = [replace(rival, log_odds=min(rival.log_odds, MAX_LOG_ODDS)) for rival in rivals]
        ranked = sorted(limited, key=lambda one: -one.log_odds)
        threshold = MIN_LOG_ODDS + max(0.0, ranked[0].log_odds if ranked else 0.0)
        self._rivals = []
        for rival in ranked:
            others = [estimate, *(kept.pose for kept in self._rivals)]
            if rival.log_odds > threshold and not any(_is_same(rival.pose, other) for other in others):
                self._rivals.append(rival)

    def _follow(self, key: KeyScan) -> None:
        """Move the rivals to the next scan, and compare them with it.

        The filter may change its estimate from one mode to another. Then the former estimate is a rival from now on,
        and all are compared anew along their paths, since nothing is known of the new estimate's.
        """
        last = self._key_scans[-1]
        motion = key.odometry.relative_to(last.odometry)
        moved = [self._moved(rival, motion, key.ends) for rival in self._rivals]
        former = Rival(last.estimate @ motion, DRIFT_COVARIANCE, 0.0, last.agreement)
        if not _is_same(former.pose, key.estimate):  # scan matching may still lead to the same mode
            former = self._moved(replace(former, pose=last.estimate), motion, key.ends)
        if not _is_same(former.pose, key.estimate):
            self._restart_from(key)
            moved = self._compared([former, *moved], key)
        elif moved:
            likelihoods = np.array([rival.agreement.log_likelihood for rival in moved])
            by_scan = _log_odds(likelihoods[:, None], np.array([key.agreement.log_likelihood]))
            moved = [
                replace(rival, log_odds=SCAN_DECAY * rival.log_odds + float(by_this_scan))
                for rival, by_this_scan in zip(moved, by_scan, strict=True)
            ]
        self._keep(moved, key.estimate)

    def _restart_from(self, key: KeyScan) -> None:
        """Compare the earlier scans with the map along the path that leads to a new estimate."""
        estimate = Rival(key.estimate, DRIFT_COVARIANCE, 0.0, key.agreement)
        path = self._path_to(estimate, key.odometry)
        self._key_scans = [
            replace(old, estimate=rival.pose, agreement=rival.agreement)
            for old, rival in zip(self._key_scans, reversed(path), strict=True)
        ]

    def _compared(self, poses: Sequence[Rival], newest: KeyScan | None = None) -> list[Rival]:
        """Rivals at poses with their log odds by all independent scans.

        Args:
            poses: Rivals at the last independent scan, or at a newer one.
            newest: The newer scan; None if there is none.
        """
        odometry = (newest or self._key_scans[-1]).odometry
        keys = [*self._key_scans, *([newest] if newest else [])]
        paths = [[*([rival] if newest else []), *self._path_to(rival, odometry)] for rival in poses]
        likelihoods = np.array([[rival.agreement.log_likelihood for rival in path] for path in paths])
        estimates = np.array([key.agreement.log_likelihood for key in reversed(keys)])
        log_odds = _log_odds(likelihoods.reshape(len(paths), len(keys)), estimates)
        return [replace(path[0], log_odds=float(by_scans)) for path, by_scans in zip(paths, log_odds, strict=True)]

    def _moved(self, rival: Rival, motion: Pose, ends: Floats) -> Rival:
        """The rival at the next scan, after a motion by odometry, with its log odds before that scan."""
        covariance = rival.covariance + drift_covariance(motion)
        match = match_scan(self._comparison.field, ends, rival.pose @ motion, covariance, MATCH_SIGMA)
        return Rival(match.pose, match.covariance, rival.log_odds, self._comparison.agreement(ends, match.pose))

    def _path_to(self, rival: Rival, odometry: Pose) -> list[Rival]:
        """The rival at each independent scan, the last one first, from its pose at a place in the odom frame."""
        last, path = odometry, []
        for key in reversed(self._key_scans):
            start = replace(rival, covariance=DRIFT_COVARIANCE)
            rival, last = self._moved(start, key.odometry.relative_to(last), key.ends), key.odometry
            path.append(rival)
        return path


def _log_odds(likelihoods: Floats, estimate: Floats) -> Floats:
    """[H] log odds of poses against the estimate by scans.

    A scan speaks against every pose at which it is less likely than at the most likely one; differences within the
    model error do not count.

    Args:
        likelihoods: [H, S] mean log likelihood per beam of each scan at each pose, that of the last scan first.
        estimate: [S] mean log likelihood per beam at the estimate.
    """
    weights = SCAN_DECAY ** np.arange(len(estimate))
    together = np.vstack([estimate[None, :], likelihoods])
    behind = together.max(axis=0) - together
    against = INDEPENDENT_BEAMS * np.maximum(behind - MODEL_ERROR, 0.0)
    of_estimate = np.minimum(against[0], MAX_ESTIMATE_LOG_ODDS) @ weights
    log_odds: Floats = of_estimate - np.minimum(against[1:], MAX_SCAN_LOG_ODDS) @ weights
    return log_odds


def _is_same(first: Pose, second: Pose) -> bool:
    """Whether two poses belong to one mode."""
    return first.is_near(second, MODE_DISTANCE, MODE_ANGLE)
