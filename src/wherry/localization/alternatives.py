"""Alternative poses: other poses on the map at which all that the robot has scanned agrees with the map as well.

In a building with two identical wings a particle filter keeps only one of two equally likely modes, since resampling
extinguishes the other one by chance. Its posterior then no longer shows the ambiguity. Alternatives are therefore
searched once on the whole map when the filter has settled on a mode, compared with the scans since the start, and then
tracked beside the filter by odometry and scan matching until the scans decide between them and the estimate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wherry.localization.agreement import (
    INDEPENDENT_ANGLE,
    INDEPENDENT_DISTANCE,
    ScanAgreement,
    ScanComparison,
)
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

MIN_INDEPENDENT_SCANS = 4  # from which alternatives are searched on the whole map and may replace the estimate
MAX_INDEPENDENT_SCANS = 24  # earlier scans with which the alternatives of a search are compared
MODEL_ERROR = 0.1  # mean log likelihood per beam by which errors of the map make equal poses differ
MAX_SCAN_LOG_ODDS = 6.0  # log odds against an alternative by a single scan, at most
MAX_ESTIMATE_LOG_ODDS = 2.5  # log odds against the estimate by a single scan, at most; one alone never replaces it
MAX_LOG_ODDS = 20.0  # log odds to the estimate, at most
MIN_LOG_ODDS = -5.0  # log odds to the most probable pose below which an alternative is dropped
SCAN_DECAY = 0.8  # factor of the log odds from one independent scan to the next; the map's errors are correlated
SWITCH_PROBABILITY = 0.95  # probability from which an alternative replaces the estimate


@dataclass(frozen=True, slots=True)
class Alternative:
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
class IndependentScan:
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


class Alternatives:
    """The alternatives of an estimate, from the scans since a start at an unknown pose.

    Args:
        comparison: Compares scans with the map.

    Attributes:
        needs_search: Whether the robot started at an unknown pose and the whole map was not searched since.
        independent_scans: Number of independent scans since the start.
    """

    def __init__(self, comparison: ScanComparison) -> None:
        self._comparison = comparison
        self._alternatives: list[Alternative] = []
        self._scans: list[IndependentScan] = []
        self.needs_search = False
        self.independent_scans = 0

    def restart(self, *, is_global: bool) -> None:
        """Forget all alternatives and scans; after a start at a known pose there are no alternatives to search."""
        self._alternatives.clear()
        self._scans.clear()
        self.needs_search = is_global
        self.independent_scans = 0

    def at(self, odometry: Pose) -> tuple[Alternative, ...]:
        """The alternatives, the most probable first, when the robot is at a pose in the odom frame."""
        ranked = sorted(self._alternatives, key=lambda alternative: -alternative.log_odds)
        motion = odometry.relative_to(self._scans[-1].odometry) if self._scans else Pose()
        return tuple(replace(alternative, pose=alternative.pose @ motion) for alternative in ranked)

    @property
    def is_search_due(self) -> bool:
        """Whether the robot has moved enough since its start at an unknown pose for a search of the whole map."""
        return self.needs_search and self.independent_scans >= MIN_INDEPENDENT_SCANS

    def successor(self, odometry: Pose) -> Alternative | None:
        """The alternative that replaces the estimate when the robot is at a pose in the odom frame, or None."""
        if not self._alternatives or self.independent_scans < MIN_INDEPENDENT_SCANS:
            return None
        best = self.at(odometry)[0]
        return best if self.probability_of(best) > SWITCH_PROBABILITY else None

    @property
    def probability(self) -> float:
        """Probability that one of the alternatives is right instead of the estimate, 0 to 1."""
        return 1.0 - 1.0 / self._total_odds

    def probability_of(self, alternative: Alternative) -> float:
        """Probability that an alternative is right instead of the estimate and all other alternatives, 0 to 1."""
        return math.exp(alternative.log_odds) / self._total_odds

    @property
    def _total_odds(self) -> float:
        """Odds of the alternatives and of the estimate against the estimate."""
        return 1.0 + sum(math.exp(alternative.log_odds) for alternative in self._alternatives)

    def add_scan(self, odometry: Pose, ends: Floats, agreement: ScanAgreement, estimate: Pose) -> None:
        """Compare a scan with the map at all alternatives if the robot has moved enough since the last one.

        Args:
            odometry: Pose of base_link, odom frame.
            ends: [B, 2] m, ends of the beams, base_link frame.
            agreement: Agreement with the map at the estimated pose.
            estimate: Estimated pose of base_link, map frame.
        """
        if not len(ends):
            return
        if self._scans and odometry.is_near(self._scans[-1].odometry, INDEPENDENT_DISTANCE, INDEPENDENT_ANGLE):
            return
        scan = IndependentScan(odometry, ends, estimate, agreement)
        if self._scans:
            self._follow(scan)
        self._scans.append(scan)
        del self._scans[:-MAX_INDEPENDENT_SCANS]
        self.independent_scans += 1

    def add_hypotheses(self, hypotheses: Sequence[Hypothesis], odometry: Pose, estimate: Pose) -> None:
        """Make alternatives of the poses that are consistent with the last scan and with those before.

        Args:
            hypotheses: Poses on the map that are consistent with the last scan.
            odometry: Pose of base_link at the last scan, odom frame.
            estimate: Estimated pose of base_link, map frame.
        """
        if not self._scans:
            return
        self.needs_search = not self.is_search_due
        back = self._scans[-1].odometry.relative_to(odometry)
        found = [Alternative(one.pose @ back, one.covariance, 0.0, one.agreement) for one in hypotheses]
        self._keep([*self._alternatives, *self._compared(found)], estimate @ back)

    def swap(
        self, alternative: Alternative, estimate: Pose, covariance: Floats, odometry: Pose, agreement: ScanAgreement
    ) -> None:
        """Replace the estimate by an alternative; the former estimate becomes an alternative.

        Args:
            alternative: The alternative, from `at`.
            estimate: The former estimate, pose of base_link in the map frame.
            covariance: [3, 3] m, m, rad, covariance of the former estimate.
            odometry: Pose of base_link, odom frame.
            agreement: Agreement of the last scan with the map at the former estimate.
        """
        last = self._scans[-1]
        back = last.odometry.relative_to(odometry)
        self._scans[-1] = replace(last, estimate=alternative.pose @ back, agreement=alternative.agreement)
        others = [replace(other, log_odds=other.log_odds - alternative.log_odds) for other in self._alternatives]
        former = Alternative(estimate @ back, covariance, -alternative.log_odds, agreement)
        self._keep([*others, former], alternative.pose @ back)

    def _keep(self, alternatives: Sequence[Alternative], estimate: Pose) -> None:
        """Keep the best of the alternatives at each pose, except at the estimate's, and drop the improbable ones."""
        limited = [
            replace(alternative, log_odds=min(alternative.log_odds, MAX_LOG_ODDS)) for alternative in alternatives
        ]
        ranked = sorted(limited, key=lambda one: -one.log_odds)
        threshold = MIN_LOG_ODDS + max(0.0, ranked[0].log_odds if ranked else 0.0)
        self._alternatives = []
        for alternative in ranked:
            others = [estimate, *(kept.pose for kept in self._alternatives)]
            if alternative.log_odds > threshold and not any(_is_same(alternative.pose, other) for other in others):
                self._alternatives.append(alternative)

    def _follow(self, scan: IndependentScan) -> None:
        """Move the alternatives to the next scan, and compare them with it.

        The filter may change its estimate from one mode to another. Then the former estimate is an alternative from now
        on, and all are compared anew along their paths, since nothing is known of the new estimate's.
        """
        last = self._scans[-1]
        motion = scan.odometry.relative_to(last.odometry)
        moved = [self._moved(alternative, motion, scan.ends) for alternative in self._alternatives]
        former = Alternative(last.estimate @ motion, DRIFT_COVARIANCE, 0.0, last.agreement)
        if not _is_same(former.pose, scan.estimate):  # scan matching may still lead to the same mode
            former = self._moved(replace(former, pose=last.estimate), motion, scan.ends)
        if not _is_same(former.pose, scan.estimate):
            self._restart_from(scan)
            moved = self._compared([former, *moved], scan)
        elif moved:
            likelihoods = np.array([alternative.agreement.log_likelihood for alternative in moved])
            by_scan = _log_odds(likelihoods[:, None], np.array([scan.agreement.log_likelihood]))
            moved = [
                replace(alternative, log_odds=SCAN_DECAY * alternative.log_odds + float(by_this_scan))
                for alternative, by_this_scan in zip(moved, by_scan, strict=True)
            ]
        self._keep(moved, scan.estimate)

    def _restart_from(self, scan: IndependentScan) -> None:
        """Compare the earlier scans with the map along the path that leads to a new estimate."""
        estimate = Alternative(scan.estimate, DRIFT_COVARIANCE, 0.0, scan.agreement)
        path = self._path_to(estimate, scan.odometry)
        self._scans = [
            replace(old, estimate=alternative.pose, agreement=alternative.agreement)
            for old, alternative in zip(self._scans, reversed(path), strict=True)
        ]

    def _compared(self, poses: Sequence[Alternative], newest: IndependentScan | None = None) -> list[Alternative]:
        """Alternatives at poses with their log odds by all independent scans.

        Args:
            poses: Alternatives at the last independent scan, or at a newer one.
            newest: The newer scan; None if there is none.
        """
        odometry = (newest or self._scans[-1]).odometry
        scans = [*self._scans, *([newest] if newest else [])]
        paths = [[*([alternative] if newest else []), *self._path_to(alternative, odometry)] for alternative in poses]
        likelihoods = np.array([[alternative.agreement.log_likelihood for alternative in path] for path in paths])
        estimates = np.array([scan.agreement.log_likelihood for scan in reversed(scans)])
        log_odds = _log_odds(likelihoods.reshape(len(paths), len(scans)), estimates)
        return [replace(path[0], log_odds=float(by_scans)) for path, by_scans in zip(paths, log_odds, strict=True)]

    def _moved(self, alternative: Alternative, motion: Pose, ends: Floats) -> Alternative:
        """The alternative at the next scan, after a motion by odometry, with its log odds before that scan."""
        covariance = alternative.covariance + drift_covariance(motion)
        match = match_scan(self._comparison.field, ends, alternative.pose @ motion, covariance, MATCH_SIGMA)
        return Alternative(
            match.pose, match.covariance, alternative.log_odds, self._comparison.agreement(ends, match.pose)
        )

    def _path_to(self, alternative: Alternative, odometry: Pose) -> list[Alternative]:
        """The alternative at each independent scan, the last one first, from its pose at a place in the odom frame."""
        last, path = odometry, []
        for scan in reversed(self._scans):
            start = replace(alternative, covariance=DRIFT_COVARIANCE)
            alternative, last = self._moved(start, scan.odometry.relative_to(last), scan.ends), scan.odometry
            path.append(alternative)
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
