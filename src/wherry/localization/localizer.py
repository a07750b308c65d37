"""Localization that knows when it is lost: a particle filter, watched, and started anew from one scan when it fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.localization.agreement import Agreement, compare
from wherry.localization.amcl import Amcl, Estimate
from wherry.localization.lost import LostDetector
from wherry.localization.parameters import AmclParameters
from wherry.localization.relocalization import Hypothesis, Relocalizer
from wherry.localization.sensor import choose_beams
from wherry.robot import Odometry, Scan
from wherry.space.distance_field import DistanceField
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

Floats = NDArray[np.float64]

ALARM = 0.9  # probability of being lost at which a new start is made
RETRY = 1.0  # s between two attempts
COMPARED_BEAMS = 180
DOUBT = 0.2  # share of the new belief that is spread over all hypotheses alike, in case the scan misleads
UNSEEN = 0.2  # share of the first belief that is spread over the whole map, likewise
LEAST_DEVIATION = (0.05, 0.05, 0.02)  # m, m, rad, of particles around a hypothesis


@dataclass(frozen=True, slots=True)
class Localization:
    """An estimate, and how far to trust it.

    Attributes:
        estimate: The particle filter's.
        lost_probability: That the robot is not where the estimate says, 0 to 1.
        agreement: How the scan agrees with the map there.
        hypotheses: Where else the robot may be, if the scan has just been used for a new start; otherwise empty.
    """

    estimate: Estimate
    lost_probability: float
    agreement: Agreement
    hypotheses: tuple[Hypothesis, ...] = ()

    @property
    def pose(self) -> Pose:
        """base_link in the map frame."""
        return self.estimate.pose


class Localizer:
    """`Amcl` with a watch: it says when it is lost, and then starts anew from all the places that explain the scan.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: The particle filter's.
        rng: Where all randomness comes from.
    """

    def __init__(self, grid: OccupancyGrid, lidar: Pose, parameters: AmclParameters, rng: np.random.Generator) -> None:
        self.amcl = Amcl(grid, lidar, parameters, rng)
        self._lidar = lidar
        self._field = DistanceField.of(grid, parameters.laser_likelihood_max_dist)
        self._relocalizer = Relocalizer(grid, lidar, parameters)
        self._detector = LostDetector()
        self._started = True
        self._last_start = -np.inf

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """See `Amcl.initialize`."""
        self.amcl.initialize(pose, covariance)
        self._detector.reset()
        self._started = True

    def initialize_globally(self) -> None:
        """Start anywhere on the map: the next scan says where that may be.

        Raises:
            InputError: The map has no free space.
        """
        self.amcl.initialize_globally()
        self._detector.reset()
        self._started = False

    def update(self, odometry: Odometry, scan: Scan) -> Localization:
        """Take in one scan, and the odometry of the same instant; see `Amcl.update`."""
        hypotheses: tuple[Hypothesis, ...] = ()
        if not self._started:
            hypotheses = self._start(scan)
        estimate = self.amcl.update(odometry, scan)
        ends = choose_beams(scan, self._lidar, self.amcl.parameters, COMPARED_BEAMS).ends
        agreement = compare(self._field, ends, self._lidar, estimate.pose)
        if not estimate.problem:
            self._detector.observe(scan.time, agreement)
        if self._detector.probability > ALARM and scan.time - self._last_start >= RETRY:
            hypotheses = self._start_anew(scan, agreement)
        wrong = 1.0 - estimate.weight * (1.0 - self._detector.probability)
        return Localization(estimate, min(max(wrong, 0.0), 1.0), agreement, hypotheses)

    def _start(self, scan: Scan) -> tuple[Hypothesis, ...]:
        """Believe in the places that explain the first scan, and a little in all others."""
        found = self._relocalizer.search(scan)
        if found.hypotheses:
            self.amcl.initialize_at(_spread(found.hypotheses), elsewhere=UNSEEN if found.ambiguous else 0.0)
            self._started = True
        return found.hypotheses

    def _start_anew(self, scan: Scan, agreement: Agreement) -> tuple[Hypothesis, ...]:
        """Believe in the places that explain the scan, unless none of them explains it better than where we are."""
        self._last_start = scan.time
        found = self._relocalizer.search(scan)
        if not found.hypotheses or found.hypotheses[0].agreement.log_likelihood <= agreement.log_likelihood:
            return ()
        self.amcl.initialize_at(_spread(found.hypotheses))
        self._detector.reset()
        return found.hypotheses


def _spread(hypotheses: tuple[Hypothesis, ...]) -> list[tuple[Pose, Floats, float]]:
    """Pose, covariance and share of the belief for every hypothesis."""
    floor = np.diag(np.square(LEAST_DEVIATION))
    even = DOUBT / len(hypotheses)
    return [(h.pose, h.covariance + floor, (1.0 - DOUBT) * h.probability + even) for h in hypotheses]
