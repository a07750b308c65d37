"""Whether a map is that of the building that a robot drove through, from all scans of the drive.

On the map of another building a particle filter always finds some pose at which a scan fits, and soon has to leave it
for another one: either the scans stop fitting, or the estimate jumps where odometry does not. What distinguishes the
right map is therefore not the fit of the scans alone, but a long *consistent stretch* of the drive, over which the
estimate moves as odometry says and no window of scans contradicts the map. A building that has changed breaks a drive
into several stretches, and a global start or an odometry error costs one; chance fits on other maps end after a few
metres.

The probability that the map is right is a logistic function of the longest stretch, of its share of the drive, and of
the fit. `wherry.experiments.localization.foreign_maps` measures it, also on buildings that had no part in the fit of
its coefficients. The probability supposes that the filter has settled; where it has not, the robot is lost by the
filter's own account.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from wherry.localization.agreement import INDEPENDENT_ANGLE, INDEPENDENT_DISTANCE, ScanAgreement
from wherry.localization.fit import MIN_COVERAGE, MIN_FIT, MapFit
from wherry.space.pose import Pose

WINDOW = 3  # independent scans that together must fit the map
JUMP_DISTANCE, JUMP_PER_DISTANCE = 0.3, 0.2  # m and m/m, difference from odometry above which the estimate jumped
SHORT_DRIVE = 20.0  # m driven, below which a drive may be too short to tell the right map from another
MIN_MAP_PROBABILITY = 0.5  # probability of the map being right below which it is said to be wrong
MIN_OUTLIERS = 0.02  # 1 - fit below which a better fit says nothing more
JUMP_ANGLE, JUMP_PER_TURN = 0.2, 0.1  # rad and rad/rad, as above for the heading


@dataclass(frozen=True, slots=True)
class DrivenScan:
    """A scan of a drive with its localization.

    Attributes:
        odometry: Pose of base_link, odom frame.
        pose: Estimated pose of base_link, map frame.
        agreement: Agreement of the scan with the map at the estimated pose; without beams if it was not compared.
    """

    odometry: Pose
    pose: Pose
    agreement: ScanAgreement


@dataclass(frozen=True, slots=True)
class MapFeatures:
    """Features of a drive from which the probability that the map is right is computed.

    Attributes:
        length: log(1 + longest consistent stretch / 1 m).
        share: Share of the drive in the longest consistent stretch, 0 to 1.
        fit: log(1 / (1 - fit)) of all scans.
    """

    length: float
    share: float
    fit: float


@dataclass(frozen=True, slots=True)
class MapEvidence:
    """Coefficients of the log odds that the map is right, if every second map is.

    Attributes:
        intercept: Log odds at features of 0.
        length_weight: Coefficient of the length of the longest stretch.
        share_weight: Coefficient of its share of the drive.
        fit_weight: Coefficient of the fit.
    """

    intercept: float = -7.5
    length_weight: float = 1.7
    share_weight: float = 1.9
    fit_weight: float = 1.6

    def probability(self, features: MapFeatures) -> float:
        """Probability that the map is right, 0 to 1."""
        log_odds = (
            self.intercept
            + self.length_weight * features.length
            + self.share_weight * features.share
            + self.fit_weight * features.fit
        )
        return 1.0 / (1.0 + math.exp(-log_odds))


@dataclass(frozen=True, slots=True)
class DriveFit:
    """How a whole drive fits a map.

    Attributes:
        fit: Fit of all scans.
        distance: Distance driven by odometry, m.
        longest: Longest consistent stretch of the drive, m.
    """

    fit: MapFit
    distance: float
    longest: float

    @classmethod
    def of(cls, scans: Sequence[DrivenScan]) -> DriveFit:
        """Compare a drive of at least one scan with the map."""
        fit = MapFit()
        for scan in scans:
            fit = fit.with_scan(scan.agreement)
        independent = list(_independent_scans(scans))
        return cls(fit, independent[-1].driven, max(_stretches(independent)))

    @property
    def features(self) -> MapFeatures:
        """What the probability that the map is right is computed from."""
        share = self.longest / self.distance if self.distance > 0.0 else 0.0
        return MapFeatures(math.log1p(self.longest), share, -math.log(max(1.0 - self.fit.value, MIN_OUTLIERS)))

    @property
    def map_probability(self) -> float:
        """Probability that the map is right, 0 to 1."""
        return MapEvidence().probability(self.features)

    @property
    def is_short(self) -> bool:
        """Whether the drive may be too short to tell the right map from another."""
        return self.distance < SHORT_DRIVE


def fits_map(drive: DriveFit) -> bool:
    """Whether the scans of a drive fit the map; those of a short one do unless they contradict it."""
    is_probable = drive.map_probability >= MIN_MAP_PROBABILITY
    return drive.fit.coverage >= MIN_COVERAGE and (is_probable or (drive.is_short and drive.fit.value >= MIN_FIT))


@dataclass(frozen=True, slots=True)
class _IndependentScan:
    """An independent scan, with those that follow it until the next one.

    Attributes:
        scan: The scan.
        driven: Distance driven up to it, m.
        turned: Angle turned up to it, rad.
        fit: Mean fit of the scans.
    """

    scan: DrivenScan
    driven: float
    turned: float
    fit: MapFit


def _independent_scans(scans: Sequence[DrivenScan]) -> Iterator[_IndependentScan]:
    """The independent scans of a drive; the last one is repeated at the drive's end."""
    current = _IndependentScan(scans[0], 0.0, 0.0, MapFit().with_scan(scans[0].agreement))
    last, driven, turned = scans[0].odometry, 0.0, 0.0
    for scan in scans[1:]:
        motion = scan.odometry.relative_to(last)
        last, driven, turned = scan.odometry, driven + math.hypot(motion.x, motion.y), turned + abs(motion.theta)
        if driven - current.driven >= INDEPENDENT_DISTANCE or turned - current.turned >= INDEPENDENT_ANGLE:
            yield current
            current = _IndependentScan(scan, driven, turned, MapFit())
        current = _IndependentScan(current.scan, current.driven, current.turned, current.fit.with_scan(scan.agreement))
    yield current


def _stretches(independent: Sequence[_IndependentScan]) -> Iterator[float]:
    """Lengths of the consistent stretches, m."""
    stretch: list[_IndependentScan] = []
    for current in independent:
        window = [*stretch[1 - WINDOW :], current]
        contradicts = len(window) == WINDOW and not _mean(window).is_fitting
        if stretch and (contradicts or _jumped(stretch[-1], current)):
            yield _length(stretch)
            stretch = []
        stretch.append(current)
    yield _length(stretch)


def _length(stretch: Sequence[_IndependentScan]) -> float:
    """Distance driven in a stretch, m; 0 if its scans do not fit the map."""
    return stretch[-1].driven - stretch[0].driven if _mean(stretch).is_fitting else 0.0


def _mean(independent: Sequence[_IndependentScan]) -> MapFit:
    """The fit of independent scans of equal weight."""
    fits = [current.fit for current in independent if current.fit.scans]
    return MapFit(
        inliers=sum(fit.inliers / fit.scans for fit in fits),
        blocked=sum(fit.blocked / fit.scans for fit in fits),
        passed=sum(fit.passed / fit.scans for fit in fits),
        scans=float(len(fits)),
    )


def _jumped(before: _IndependentScan, after: _IndependentScan) -> bool:
    """Whether the estimate moved otherwise than odometry from one independent scan to the next."""
    moved = after.scan.pose.relative_to(before.scan.pose)
    error = moved.relative_to(after.scan.odometry.relative_to(before.scan.odometry))
    driven, turned = after.driven - before.driven, after.turned - before.turned
    return (
        math.hypot(error.x, error.y) > JUMP_DISTANCE + JUMP_PER_DISTANCE * driven
        or abs(error.theta) > JUMP_ANGLE + JUMP_PER_TURN * turned
    )
