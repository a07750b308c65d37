"""Localization with failure detection: a particle filter that is relocalized on the whole map when it is lost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wherry.localization.agreement import ScanAgreement, scan_agreement
from wherry.localization.amcl import Amcl
from wherry.localization.estimation import PoseEstimate
from wherry.localization.initialization import PoseMode
from wherry.localization.lost import LostDetector
from wherry.localization.parameters import AmclParameters
from wherry.localization.refinement import match_scan
from wherry.localization.relocalization import Hypothesis, Relocalizer
from wherry.localization.scan_window import ScanWindow, WindowScan
from wherry.localization.sensor import Beams, valid_beams
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose

AGREEMENT_BEAMS = 180  # beams of a scan that are compared with the map

# When to relocalize
WINDOW_MIN_LOST_PROBABILITY = 0.02  # probability of being lost below which the window of scans is cleared
RELOCALIZATION_MIN_LOST_PROBABILITY = 0.1  # probability of being lost above which the whole map is searched
RELOCALIZATION_MIN_SCANS = 3  # scans in the window before the whole map is searched
LOST_SUSTAINED_PROBABILITY = 0.9  # sustained probability above which the robot is certainly lost
LOST_WINDOW_PROBABILITY = 0.5  # probability of being lost above which at every scan the robot is certainly lost

# Which hypotheses replace the estimate
TRACKING_MIN_GAIN = 0.8  # gain of mean log likelihood per beam over the estimate, unless certainly lost
TRACKING_MIN_INLIERS = 0.95  # fraction of inlier beams, unless certainly lost
LOST_MIN_GAIN = 0.2  # gain of mean log likelihood per beam over the estimate, if certainly lost
HYPOTHESIS_MAX_EVIDENCE = -0.5  # log likelihood ratio of being lost that remains at the hypothesis

# How the particles are drawn anew
EVEN_WEIGHT = 0.5  # weight divided evenly among the hypotheses, as a single scan may mislead
AMBIGUOUS_UNIFORM_WEIGHT = 0.5  # weight of the whole free space at the start, if the first scan is ambiguous
PRIOR_WEIGHT = 0.5  # weight of the current particles after a relocalization or slip correction
MODE_MIN_COVARIANCE = np.diag([0.05**2, 0.05**2, 0.02**2])  # m², m², rad², added to each hypothesis's covariance

# Wheel slip
SLIP_MIN_Z_SCORE = 3.0  # standard deviations above the baseline from which a scan is an outlier
SLIP_MIN_GAIN = 0.5  # gain of mean log likelihood per beam over the estimate
SLIP_COVARIANCE = np.diag([0.2**2, 0.2**2, 0.15**2])  # m², m², rad², of the slip between two scans
SLIP_STARTS = tuple(  # m, m, rad: start poses of the matching, relative to the estimate
    Pose(*offset)
    for offset in ((0.0, 0.0), (0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3), (0.0, 0.0, 0.2), (0.0, 0.0, -0.2))
)


@dataclass(frozen=True, slots=True)
class Localization:
    """An estimate of the robot's pose with its reliability.

    Attributes:
        estimate: Estimate of the particle filter.
        lost_probability: Probability that the robot is not where the estimate says, 0 to 1.
        agreement: Agreement of the scan with the map at the estimated pose.
        hypotheses: Candidate poses from which the particles were just drawn anew; otherwise empty.
    """

    estimate: PoseEstimate
    lost_probability: float
    agreement: ScanAgreement
    hypotheses: tuple[Hypothesis, ...] = ()

    @property
    def pose(self) -> Pose:
        """Estimated pose of base_link, map frame."""
        return self.estimate.pose


class Localizer:
    """`Amcl` with failure detection: it reports when it is lost, and relocalizes itself on the whole map.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: The particle filter's parameters.
        rng: Source of all randomness.

    Attributes:
        amcl: The particle filter.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters, rng: np.random.Generator) -> None:
        self.amcl = Amcl(grid, lidar, parameters, rng)
        self._lidar = lidar
        self._known = ~grid.unknown
        self._relocalizer = Relocalizer(grid, lidar, parameters)
        self._detector = LostDetector()
        self._window = ScanWindow()
        self._is_started = True

    @property
    def particles(self) -> Floats:
        """[N, 3] m, m, rad, map frame."""
        return self.amcl.particles

    @property
    def weights(self) -> Floats:
        """[N] importance weights of the particles, summing to 1."""
        return self.amcl.weights

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """Start at a known pose; see `Amcl.initialize`."""
        self.amcl.initialize(pose, covariance)
        self._detector.reset()
        self._is_started = True

    def initialize_globally(self) -> None:
        """Start anywhere on the map: the next scan is searched for on all of it.

        Raises:
            InputError: The map has no free space.
        """
        self.amcl.initialize_globally()
        self._detector.reset()
        self._is_started = False

    def update(self, odometry: Odometry, scan: Scan) -> Localization:
        """Process one scan and the odometry of the same instant; see `Amcl.update`."""
        beams = valid_beams(scan, self._lidar, self.amcl.parameters)
        hypotheses = () if self._is_started else self._start(beams)
        estimate = self.amcl.update(odometry, scan, beams)
        ends = beams.evenly_spaced(AGREEMENT_BEAMS).ends
        agreement = self._agreement(ends, estimate.pose)
        lost = self._detector.probability
        if not estimate.problem:
            estimate, agreement = self._correct_slip(estimate, agreement, ends)
            lost = self._detector.update(scan.time, agreement)
            window_scan = WindowScan(scan.time, odometry.pose, ends, agreement, lost)
            if self._add_to_window(window_scan, is_unimodal=estimate.is_unimodal) and self._should_relocalize:
                hypotheses = self._relocalize(beams, odometry.pose)
        wrong = 1.0 - estimate.weight * (1.0 - lost)
        return Localization(estimate, min(max(wrong, 0.0), 1.0), agreement, hypotheses)

    @property
    def _max_lost_probability(self) -> float:
        """The larger of both probabilities of being lost, since either of them justifies a search."""
        return max(self._detector.sustained_probability, self._detector.probability)

    @property
    def _should_relocalize(self) -> bool:
        is_suspected = self._max_lost_probability > RELOCALIZATION_MIN_LOST_PROBABILITY
        return is_suspected and len(self._window) >= RELOCALIZATION_MIN_SCANS

    def _agreement(self, ends: Floats, pose: Pose) -> ScanAgreement:
        return scan_agreement(self.amcl.field, self._known, ends, self._lidar, pose)

    def _correct_slip(
        self, estimate: PoseEstimate, agreement: ScanAgreement, ends: Floats
    ) -> tuple[PoseEstimate, ScanAgreement]:
        """Move the estimate nearby if the scan is an outlier here and an inlier there: the wheels have slipped."""
        if not estimate.is_unimodal or self._detector.z_score(agreement) < SLIP_MIN_Z_SCORE:
            return estimate, agreement
        sigma = self.amcl.parameters.refine_sigma
        covariance = estimate.covariance + SLIP_COVARIANCE
        matches = [
            match_scan(self.amcl.field, ends, estimate.pose, covariance, sigma, start=estimate.pose @ offset)
            for offset in SLIP_STARTS
        ]
        agreements = [self._agreement(ends, match.pose) for match in matches]
        best = max(range(len(matches)), key=lambda index: agreements[index].log_likelihood)
        is_inlier = self._detector.z_score(agreements[best]) < SLIP_MIN_Z_SCORE
        if not is_inlier or agreements[best].log_likelihood < agreement.log_likelihood + SLIP_MIN_GAIN:
            return estimate, agreement
        match = matches[best]
        mode = PoseMode(match.pose, match.covariance + MODE_MIN_COVARIANCE, 1.0)
        self.amcl.initialize_modes([mode], prior_weight=PRIOR_WEIGHT)
        return replace(estimate, pose=match.pose), agreements[best]

    def _start(self, beams: Beams) -> tuple[Hypothesis, ...]:
        """Draw the particles around the hypotheses for the first scan; if there are too many, keep all free space."""
        found = self._relocalizer.search_beams(beams)
        if found.hypotheses:
            if found.complete:
                uniform_weight = AMBIGUOUS_UNIFORM_WEIGHT if found.ambiguous else 0.0
                self.amcl.initialize_modes(_modes(found.hypotheses), uniform_weight=uniform_weight)
            self._is_started = True
        return found.hypotheses

    def _add_to_window(self, scan: WindowScan, *, is_unimodal: bool) -> bool:
        """Add a scan to the window while the robot may be lost; returns whether it was added.

        Earlier scans may be of another place. A multi-modal posterior is not lost but still being narrowed down by the
        filter.
        """
        if self._max_lost_probability < WINDOW_MIN_LOST_PROBABILITY or not is_unimodal:
            self._window.clear()
            return False
        return self._window.add(scan)

    def _relocalize(self, beams: Beams, odometry: Pose) -> tuple[Hypothesis, ...]:
        """Draw the particles around the hypotheses that agree with the window better than the estimate, if any."""
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
            and self._detector.model.evidence(hypothesis.agreement) < HYPOTHESIS_MAX_EVIDENCE
        )
        if better:
            self.amcl.initialize_modes(_modes(better), prior_weight=PRIOR_WEIGHT)
            self._detector.reset()
            self._window.clear()
        return better

    @property
    def _is_certainly_lost(self) -> bool:
        """Whether the robot was lost during all of a full window."""
        is_lost = (
            self._detector.sustained_probability > LOST_SUSTAINED_PROBABILITY
            or self._window.has_lost_probability_above(LOST_WINDOW_PROBABILITY)
        )
        return is_lost and self._window.is_full


def _modes(hypotheses: tuple[Hypothesis, ...]) -> list[PoseMode]:
    """Modes for the particles, with part of the weight divided evenly among the hypotheses."""
    even = EVEN_WEIGHT / len(hypotheses)
    return [
        PoseMode(h.pose, h.covariance + MODE_MIN_COVARIANCE, (1.0 - EVEN_WEIGHT) * h.probability + even)
        for h in hypotheses
    ]
