"""Localization with failure detection: a particle filter that relocalizes on the whole map when it is lost."""

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
RELOCALIZATION_MIN_SCANS = 3  # scans that the window must hold before the whole map is searched
LOST_SUSTAINED_PROBABILITY = 0.9  # sustained probability of being lost above which the robot is certainly lost
LOST_WINDOW_PROBABILITY = 0.5  # probability of being lost that all scans of a window must exceed instead

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

# Wheel slip
SLIP_MIN_Z_SCORE = 3.0  # standard deviations of a scan's evidence above the baseline from which it is an outlier
SLIP_MIN_GAIN = 0.5  # gain of mean log likelihood per beam over the estimate
SLIP_COVARIANCE = np.diag([0.2**2, 0.2**2, 0.15**2])  # m², m², rad², of the error that slip adds between two scans
SLIP_STARTS = tuple(  # start poses of the scan matching, relative to the estimate; m, m, rad
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
        hypotheses: Hypotheses around which the particles were redrawn at this scan; empty if they were not.
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
    """`Amcl` with failure detection: states how probably it is lost, and relocalizes itself on the whole map.

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
        self._detector.reset()
        self._needs_global_search = False

    def initialize_globally(self) -> None:
        """Start without a pose; the next scan is matched to the whole map.

        Raises:
            InputError: The map has no free space.
        """
        self.amcl.initialize_globally()
        self._detector.reset()
        self._needs_global_search = True

    def update(self, odometry: Odometry, scan: Scan) -> Localization:
        """Process one scan and the odometry of the same instant; see `Amcl.update`."""
        beams = valid_beams(scan, self._lidar, self.amcl.parameters)
        hypotheses = self._search_globally(beams) if self._needs_global_search else ()
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
        not_at_estimate = 1.0 - estimate.weight * (1.0 - lost)
        return Localization(estimate, min(max(not_at_estimate, 0.0), 1.0), agreement, hypotheses)

    @property
    def _max_lost_probability(self) -> float:
        """The larger of both probabilities of being lost; either of them justifies a search."""
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
        """Move the estimate to a nearby pose if the scan is an outlier at the estimate but not there (wheel slip)."""
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
        mode = PoseMode(match.pose, match.covariance + MODE_MARGIN, 1.0)
        self.amcl.initialize_modes([mode], prior_weight=PRIOR_WEIGHT)
        return replace(estimate, pose=match.pose), agreements[best]

    def _search_globally(self, beams: Beams) -> tuple[Hypothesis, ...]:
        """Redraw the particles around the hypotheses for the first scan, unless the search was incomplete."""
        found = self._relocalizer.search_beams(beams)
        if found.hypotheses:
            if found.is_complete:
                uniform_weight = AMBIGUOUS_UNIFORM_WEIGHT if found.is_ambiguous else 0.0
                self.amcl.initialize_modes(_modes(found.hypotheses), uniform_weight=uniform_weight)
            self._needs_global_search = False
        return found.hypotheses

    def _add_to_window(self, scan: WindowScan, *, is_unimodal: bool) -> bool:
        """Add a scan to the window while the robot is suspected of being lost; returns whether it was added.

        Otherwise the window is cleared, also while the posterior is multi-modal: the filter still resolves the
        ambiguity by itself.
        """
        if self._max_lost_probability < WINDOW_MIN_LOST_PROBABILITY or not is_unimodal:
            self._window.clear()
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
            and self._detector.model.evidence(hypothesis.agreement) < HYPOTHESIS_MAX_EVIDENCE
        )
        if better:
            self.amcl.initialize_modes(_modes(better), prior_weight=PRIOR_WEIGHT)
            self._detector.reset()
            self._window.clear()
        return better

    @property
    def _is_certainly_lost(self) -> bool:
        """Whether the window is full and the robot was lost all the time."""
        is_lost = self._detector.sustained_probability > LOST_SUSTAINED_PROBABILITY or self._window.is_lost_throughout(
            LOST_WINDOW_PROBABILITY
        )
        return is_lost and self._window.is_full


def _modes(hypotheses: tuple[Hypothesis, ...]) -> list[PoseMode]:
    """Modes for the particles, with part of the weight divided evenly among the hypotheses."""
    even = EVEN_WEIGHT / len(hypotheses)
    return [
        PoseMode(h.pose, h.covariance + MODE_MARGIN, (1.0 - EVEN_WEIGHT) * h.probability + even) for h in hypotheses
    ]
