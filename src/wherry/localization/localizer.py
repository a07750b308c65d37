"""Localization with failure detection: a particle filter that relocalizes on the whole map when it is lost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wherry.localization.agreement import ScanAgreement, ScanComparison
from wherry.localization.alternatives import Alternative, Alternatives
from wherry.localization.amcl import Amcl
from wherry.localization.estimation import PoseEstimate
from wherry.localization.fit import MapFit
from wherry.localization.initialization import PoseMode
from wherry.localization.lost import LostDetector
from wherry.localization.parameters import AmclParameters
from wherry.localization.relocalization import Hypothesis, Relocalizer
from wherry.localization.scan_window import ScanWindow, WindowScan
from wherry.localization.sensor import Beams, valid_beams
from wherry.localization.slip import SLIP_MIN_GAIN, SLIP_MIN_Z_SCORE, match_after_slip
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

AGREEMENT_BEAMS = 180  # beams of a scan that are compared with the map

# When to relocalize
WINDOW_MIN_LOST_PROBABILITY = 0.02  # probability of being lost below which the window of scans is cleared
RELOCALIZATION_MIN_LOST_PROBABILITY = 0.1  # probability of being lost above which the whole map is searched
RELOCALIZATION_MIN_SCANS = 3  # scans that the window must hold before the whole map is searched
DIVERGED_MIN_SCANS = 8  # independent scans after which a filter with several modes should have settled on one
MAX_SEARCH_INTERVAL = 8  # scans of the window from one search of the whole map to the next, after searches in vain
LOST_SUSTAINED_PROBABILITY = 0.9  # sustained probability of being lost above which the robot is certainly lost
LOST_WINDOW_PROBABILITY = 0.5  # probability of being lost that makes it certain if exceeded throughout a full window

# Which hypotheses replace the estimate
TRACKING_MIN_GAIN = 0.8  # gain of mean log likelihood per beam over the estimate, unless certainly lost
TRACKING_MIN_INLIERS = 0.95  # fraction of inlier beams, unless certainly lost
LOST_MIN_GAIN = 0.2  # gain of mean log likelihood per beam over the estimate, if certainly lost
HYPOTHESIS_MAX_EVIDENCE = -0.5  # evidence of being lost (log likelihood ratio) at the hypothesis's pose

# How the particles are redrawn
EVEN_WEIGHT = 0.5  # weight divided evenly among the hypotheses, as their probabilities are of few scans
AMBIGUOUS_UNIFORM_WEIGHT = 0.5  # weight of free space after a global start with an ambiguous scan
PRIOR_WEIGHT = 0.5  # weight of the current particles after a relocalization or slip correction
MODE_MARGIN = np.diag([0.05**2, 0.05**2, 0.02**2])  # m², m², rad², added to the covariance of a mode


@dataclass(frozen=True, slots=True)
class Localization:
    """An estimate of the robot's pose with its reliability.

    Attributes:
        estimate: Estimate of the particle filter.
        lost_probability: Probability that the robot is not where the estimate says, 0 to 1.
        agreement: Agreement of the scan with the map at the estimated pose.
        hypotheses: Hypotheses around which the particles were redrawn at this scan; empty if they were not.
        alternatives: Other poses that agree with the scans so far, the most probable first.
        tracking_lost_probability: As ``lost_probability``, but given that none of the alternatives is right.
    """

    estimate: PoseEstimate
    lost_probability: float
    agreement: ScanAgreement
    hypotheses: tuple[Hypothesis, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    tracking_lost_probability: float = 0.0

    @property
    def pose(self) -> Pose:
        """Estimated pose of base_link, map frame."""
        return self.estimate.pose


class SearchSchedule:
    """Says when the whole map is searched: after searches in vain with twice as many scans in between each time."""

    def __init__(self) -> None:
        self._interval = 1
        self._waited = 0

    def is_due(self) -> bool:
        """Whether the map is searched with the present scan; to be called with every scan of the window."""
        self._waited += 1
        if self._waited < self._interval:
            return False
        self._interval, self._waited = min(2 * self._interval, MAX_SEARCH_INTERVAL), 0
        return True


class Localizer:
    """`Amcl` with failure detection: states how probably it is lost, and relocalizes itself on the whole map.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: The particle filter's parameters.
        rng: Source of all randomness.

    Attributes:
        amcl: The particle filter.
        fit: How well all scans since the start fit the map at the estimated poses.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters, rng: np.random.Generator) -> None:
        self.amcl = Amcl(grid, lidar, parameters, rng)
        self._lidar = lidar
        self._comparison = ScanComparison(self.amcl.field, ~grid.unknown, lidar)
        self._relocalizer = Relocalizer(grid, lidar, parameters)
        self._detector = LostDetector()
        self._window = ScanWindow()
        self._alternatives = Alternatives(self._comparison)
        self._schedule = SearchSchedule()
        self.fit = MapFit()
        self._needs_global_search = False

    @property
    def particles(self) -> Floats:
        """[N, 3] m, m, rad, map frame."""
        return self.amcl.particles

    @property
    def weights(self) -> Floats:
        """[N] importance weights of the particles, summing to 1."""
        return self.amcl.weights

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """Start at a pose with covariance [3, 3] m, m, rad; see `Amcl.initialize`."""
        self.amcl.initialize(pose, covariance)
        self._restart(is_global=False)

    def initialize_globally(self) -> None:
        """Start without a pose; the next scan is matched to the whole map.

        Raises:
            InputError: The map has no free space.
        """
        self.amcl.initialize_globally()
        self._restart(is_global=True)

    def update(self, odometry: Odometry, scan: Scan) -> Localization:
        """Process one scan and the odometry of the same instant; see `Amcl.update`."""
        beams = valid_beams(scan, self._lidar, self.amcl.parameters)
        hypotheses = self._search_globally(beams) if self._needs_global_search else ()
        estimate = self.amcl.update(odometry, scan, beams)
        ends = beams.evenly_spaced(AGREEMENT_BEAMS).ends
        agreement = self._comparison.agreement(ends, estimate.pose)
        lost = self._detector.probability
        if not estimate.problem:
            estimate, agreement = self._correct_slip(estimate, agreement, ends)
            lost = self._detector.update(scan.time, agreement)
            relocalized: tuple[Hypothesis, ...] = ()
            window_scan = WindowScan(scan.time, odometry.pose, ends, agreement, lost)
            if self._add_to_window(window_scan, is_unimodal=estimate.is_unimodal) and self._should_relocalize():
                hypotheses = relocalized = self._relocalize(beams, odometry.pose)
            self._update_alternatives(estimate, agreement, beams, odometry.pose, hypotheses, relocalized)
            if not hypotheses:
                estimate, agreement, hypotheses = self._switch_to_alternative(estimate, agreement, odometry.pose)
            self.fit = self.fit.with_scan(agreement)
        return self._localization(estimate, lost, agreement, hypotheses, odometry.pose)

    def _localization(
        self,
        estimate: PoseEstimate,
        lost: float,
        agreement: ScanAgreement,
        hypotheses: tuple[Hypothesis, ...],
        odometry: Pose,
    ) -> Localization:
        """The estimate with the probabilities that the robot is elsewhere."""
        tracking = 1.0 - estimate.weight * (1.0 - lost)
        overall = 1.0 - min(estimate.weight, 1.0 - self._alternatives.probability) * (1.0 - lost)
        alternatives = self._alternatives.at(odometry)
        return Localization(estimate, _clipped(overall), agreement, hypotheses, alternatives, _clipped(tracking))

    def _restart(self, *, is_global: bool) -> None:
        """Forget all scans; a map of which nothing is known is searched with the next one."""
        self._detector.reset()
        self._window.clear()
        self._alternatives.restart(is_global=is_global)
        self._needs_global_search = is_global
        self.fit = MapFit()

    @property
    def _max_lost_probability(self) -> float:
        """The larger of both probabilities of being lost; either of them justifies a search."""
        return max(self._detector.sustained_probability, self._detector.probability)

    def _should_relocalize(self) -> bool:
        """Whether the whole map is searched with the present scan, which was added to the window."""
        is_suspected = self._max_lost_probability > RELOCALIZATION_MIN_LOST_PROBABILITY
        return is_suspected and len(self._window) >= RELOCALIZATION_MIN_SCANS and self._schedule.is_due()

    def _correct_slip(
        self, estimate: PoseEstimate, agreement: ScanAgreement, ends: Floats
    ) -> tuple[PoseEstimate, ScanAgreement]:
        """Move the estimate to a nearby pose if the scan is an outlier at the estimate but not there (wheel slip)."""
        if not estimate.is_unimodal or self._detector.z_score(agreement) < SLIP_MIN_Z_SCORE:
            return estimate, agreement
        slipped = match_after_slip(estimate, ends, self._comparison, self.amcl.parameters.refine_sigma)
        is_inlier = self._detector.z_score(slipped.agreement) < SLIP_MIN_Z_SCORE
        if not is_inlier or slipped.agreement.log_likelihood < agreement.log_likelihood + SLIP_MIN_GAIN:
            return estimate, agreement
        match = slipped.match
        mode = PoseMode(match.pose, match.covariance + MODE_MARGIN, 1.0)
        self.amcl.initialize_modes([mode], prior_weight=PRIOR_WEIGHT)
        return replace(estimate, pose=match.pose), slipped.agreement

    def _search_globally(self, beams: Beams) -> tuple[Hypothesis, ...]:
        """Redraw the particles around the hypotheses for the first scan, unless the search was incomplete."""
        found = self._relocalizer.search_beams(beams)
        if found.hypotheses:
            if found.is_complete:
                uniform_weight = AMBIGUOUS_UNIFORM_WEIGHT if found.is_ambiguous else 0.0
                self.amcl.initialize_modes(_modes(found.hypotheses), uniform_weight=uniform_weight)
            self._needs_global_search = False
        return found.hypotheses

    def _update_alternatives(
        self,
        estimate: PoseEstimate,
        agreement: ScanAgreement,
        beams: Beams,
        odometry: Pose,
        hypotheses: tuple[Hypothesis, ...],
        relocalized: tuple[Hypothesis, ...],
    ) -> None:
        """Compare alternatives with a scan; add its hypotheses, and search once more when the filter has settled."""
        if relocalized:  # the particles are around the hypotheses from now on, not at the estimate
            best = max(relocalized, key=lambda hypothesis: hypothesis.probability)
            estimate, agreement = replace(estimate, pose=best.pose), best.agreement
        self._alternatives.add_scan(odometry, beams.evenly_spaced(AGREEMENT_BEAMS).ends, agreement, estimate.pose)
        is_settled = estimate.is_unimodal and self._detector.probability < RELOCALIZATION_MIN_LOST_PROBABILITY
        if self._alternatives.is_search_due and is_settled:
            hypotheses = self._relocalizer.search_beams(beams).hypotheses
        if hypotheses:
            self._alternatives.add_hypotheses(hypotheses, odometry, estimate.pose)

    def _switch_to_alternative(
        self, estimate: PoseEstimate, agreement: ScanAgreement, odometry: Pose
    ) -> tuple[PoseEstimate, ScanAgreement, tuple[Hypothesis, ...]]:
        """Replace the estimate by an alternative that is almost certain, and redraw the particles around it."""
        best = self._alternatives.successor(odometry)
        if best is None or not self._is_inlier(best.agreement):
            return estimate, agreement, ()
        probability = self._alternatives.probability_of(best)
        hypothesis = Hypothesis(best.pose, best.covariance, probability, best.agreement)
        self.amcl.initialize_modes(_modes((hypothesis,)), prior_weight=1.0 - probability)
        self._alternatives.swap(best, estimate.pose, estimate.covariance, odometry, agreement)
        self._detector.reset()
        return replace(estimate, pose=best.pose), best.agreement, (hypothesis,)

    def _is_inlier(self, agreement: ScanAgreement) -> bool:
        """Whether a scan is evidence for a localized robot."""
        return self._detector.model.evidence(agreement) < HYPOTHESIS_MAX_EVIDENCE

    def _add_to_window(self, scan: WindowScan, *, is_unimodal: bool) -> bool:
        """Add a scan to the window while the robot is suspected of being lost; returns whether it was added.

        Otherwise the window is cleared, also while the posterior is multi-modal, which the filter resolves by itself
        unless the scans contradict its main mode after many of them.
        """
        is_diverged = (
            self._detector.probability > LOST_WINDOW_PROBABILITY
            and self._alternatives.independent_scans >= DIVERGED_MIN_SCANS
        )
        if self._max_lost_probability < WINDOW_MIN_LOST_PROBABILITY or not (is_unimodal or is_diverged):
            self._window.clear()
            self._schedule = SearchSchedule()
            return False
        return self._window.add(scan)

    def _relocalize(self, beams: Beams, odometry: Pose) -> tuple[Hypothesis, ...]:
        """Redraw the particles around the hypotheses that agree with the window better than the estimate, if any."""
        candidates = self._relocalizer.search_beams(beams).hypotheses
        confirmed = self._relocalizer.confirm(candidates, self._window.relative_to(odometry))
        current = self._window.mean_agreement()
        min_gain, min_inliers = (
            (LOST_MIN_GAIN, 0.0) if self._is_certainly_lost else (TRACKING_MIN_GAIN, TRACKING_MIN_INLIERS)
        )
        better = tuple(
            hypothesis
            for hypothesis in confirmed
            if hypothesis.agreement.log_likelihood > current.log_likelihood + min_gain
            and hypothesis.agreement.inlier_fraction > min_inliers
            and self._is_inlier(hypothesis.agreement)
        )
        if better:
            self.amcl.initialize_modes(_modes(better), prior_weight=PRIOR_WEIGHT)
            self._detector.reset()
            self._window.clear()
            self._schedule = SearchSchedule()
            self._alternatives.restart(is_global=True)
        return better

    @property
    def _is_certainly_lost(self) -> bool:
        """Whether the window is full and the robot was lost all the time."""
        is_lost = self._detector.sustained_probability > LOST_SUSTAINED_PROBABILITY or self._window.is_lost_throughout(
            LOST_WINDOW_PROBABILITY
        )
        return is_lost and self._window.is_full


def _clipped(probability: float) -> float:
    """A probability without rounding errors, 0 to 1."""
    return min(max(probability, 0.0), 1.0)


def _modes(hypotheses: tuple[Hypothesis, ...]) -> list[PoseMode]:
    """Modes for the particles, with part of the weight divided evenly among the hypotheses."""
    even = EVEN_WEIGHT / len(hypotheses)
    return [
        PoseMode(h.pose, h.covariance + MODE_MARGIN, (1.0 - EVEN_WEIGHT) * h.probability + even) for h in hypotheses
    ]
