"""Am I lost? A calibrated probability, from how the last scans agreed with the map.

What a scan says, its evidence, is a logistic regression on the shares of its beams (`agreement.Agreement`): those that
the map explains, those that were stopped by something which is not on it, and those that went through something which
is. Two answers are made of it.

The *suspicion* is for whoever would give up the belief for another one, which a single odd scan must not bring about:
the mean evidence of the last seconds, in which a scan counts once, however rare it is, and all of them count as a few,
however many there are, for scans that follow each other see the same things.

The *probability* is for whoever wants to know. A scan of a clean map that hardly fits is proof; one of a building that
has changed since it was mapped is none. So it rests on how much the scan says to the contrary of what scans say on this
map, their mean and spread while they fit, and on the mean evidence before it. The three coefficients of that were
fitted (`fit_calibration`, run by `experiments.lost_calibration`) to robots that were carried off on the maps of three
buildings and of two simulated worlds; the reliability diagram in the results is of a fourth building and a third world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.localization.agreement import Agreement

Floats = NDArray[np.float64]

SCANS_UNTIL_LOST = 2000  # in the mean: how often it happens decides what a scan that hardly fits is taken for
USUAL_MEAN, USUAL_DEVIATION = -2.4, 0.35  # of the evidence of scans that fit, before any was seen,
USUAL_WORTH, USUAL_MEMORY = 20, 100  # worth so many scans; and how many scans are remembered
USUAL_OUTLIER = 3.0  # standard deviations from the mean, from where on a scan counts as if it were there
FITTING = 0.1  # probability of being lost from which on a scan is not taken for a usual one
LEAST_DEVIATION = 0.15  # of that evidence, however alike the scans were
RIDGE = 1e-3  # keeps the regressions finite where the data are separable


@dataclass(frozen=True, slots=True)
class LostModel:
    """Coefficients of the evidence, log odds for a scan of which all beams are such, and what becomes of it.

    Beams that end where the map knows nothing say nothing: maps have holes, and an end.

    Attributes:
        explained: For the share of beams that the map explains.
        blocked: For the share of beams that ended on something which is not on the map.
        passed: For the share of beams that went through something which is on the map.
        most: No scan says more than this, either way.
        prior: Suspicion before anything is seen.
        memory: s, how long a scan is remembered,
        kept: though never less of it than this when the next one comes.
        independent_scans: How many scans those in the memory are worth together, at most.
    """

    explained: float = -3.0
    blocked: float = 5.8
    passed: float = 14.3
    most: float = 4.0
    prior: float = 0.01
    memory: float = 1.0
    kept: float = 0.5
    independent_scans: float = 3.0

    def evidence(self, agreement: Agreement) -> float:
        """Log of how much likelier the scan is for a robot that is lost than for one that is not."""
        said = self.explained * agreement.explained + self.blocked * agreement.blocked + self.passed * agreement.passed
        return min(max(said, -self.most), self.most)


@dataclass(frozen=True, slots=True)
class Calibration:
    """What the log odds of being lost are made of.

    Attributes:
        constant: For a robot that gets lost once in `SCANS_UNTIL_LOST` scans.
        recent: For the mean evidence of the last scans, this one not among them.
        contradiction: For the root of the scan's `Usual.contradiction`; beyond a few deviations more tell little.
    """

    constant: float = -8.8
    recent: float = 0.81
    contradiction: float = 2.11

    def log_odds(self, recent: float, contradiction: float) -> float:
        """Of being lost."""
        return self.constant + self.recent * recent + self.contradiction * math.sqrt(contradiction)


class Usual:
    """The evidence of the scans that fit: what this robot is used to on this map."""

    def __init__(self) -> None:
        self._mean, self._variance, self._count = USUAL_MEAN, USUAL_DEVIATION**2, USUAL_WORTH

    def contradiction(self, evidence: float) -> float:
        """How many standard deviations a scan says more than usual for being lost; 0 if it does not."""
        return max(0.0, evidence - self._mean) / max(math.sqrt(self._variance), LEAST_DEVIATION)

    def observe(self, evidence: float) -> None:
        """Take in the evidence of a scan that fits; one far off moves mean and spread no more than one less far."""
        most = USUAL_OUTLIER * math.sqrt(self._variance)
        evidence = min(max(evidence, self._mean - most), self._mean + most)
        self._count = min(self._count + 1, USUAL_MEMORY)
        self._mean += (evidence - self._mean) / self._count
        self._variance += ((evidence - self._mean) ** 2 - self._variance) / self._count


class LostDetector:
    """Follows suspicion and probability of being lost from scan to scan."""

    def __init__(self, model: LostModel | None = None, calibration: Calibration | None = None) -> None:
        self.model = model or LostModel()
        self._calibration = calibration or Calibration()
        self._usual = Usual()
        self.reset()

    def reset(self) -> None:
        """Forget what the last scans said; the pose is a new one. What is usual on the map stays."""
        self._average = 0.0
        self._weight = 0.0
        self._time = -math.inf
        self._features = (0.0, 0.0)
        self._probability = self.model.prior

    def observe(self, time: float, agreement: Agreement) -> float:
        """Take in how a scan agreed with the map at the estimated pose.

        Args:
            time: s, the scan's; not before the last one's.
            agreement: Of the scan.

        Returns:
            The probability of being lost, 0 to 1.
        """
        evidence = self.model.evidence(agreement)
        self._features = (self._average, self._usual.contradiction(evidence))
        self._probability = _logistic(self._calibration.log_odds(*self._features))
        if evidence < 0.0 and self._probability < FITTING:
            self._usual.observe(evidence)
        kept = max(math.exp(-(time - self._time) / self.model.memory), self.model.kept) if self._weight else 0.0
        self._time = time
        self._weight = kept * self._weight + 1.0
        self._average += (evidence - self._average) / self._weight
        return self._probability

    def contradiction(self, agreement: Agreement) -> float:
        """By how many standard deviations a scan says more than scans usually do that the robot is lost."""
        return self._usual.contradiction(self.model.evidence(agreement))

    @property
    def features(self) -> tuple[float, float]:
        """What `Calibration.log_odds` was asked for at the last scan."""
        return self._features

    @property
    def probability(self) -> float:
        """The probability of being lost, 0 to 1, calibrated."""
        return self._probability

    @property
    def suspicion(self) -> float:
        """How strongly the last scans together speak for being lost, 0 to 1; slower than the probability."""
        if not self._weight:
            return self.model.prior
        prior = math.log(self.model.prior / (1.0 - self.model.prior))
        return _logistic(prior + min(self._weight, self.model.independent_scans) * self._average)


def fit(agreements: list[Agreement], lost: NDArray[np.bool_]) -> LostModel:
    """Fit the evidence's regression, with both kinds weighing the same.

    Args:
        agreements: [N] at poses right and wrong.
        lost: [N] which poses were wrong; both kinds must occur.
    """
    shares = np.array([[found.explained, found.blocked, found.passed] for found in agreements])
    balance = np.where(lost, 0.5 / lost.mean(), 0.5 / (1.0 - lost.mean()))
    explained, blocked, passed = _regression(shares, lost, balance).tolist()
    return LostModel(explained, blocked, passed)


def fit_calibration(features: Floats, lost: NDArray[np.bool_], weights: Floats) -> Calibration:
    """Fit the probability's regression.

    Args:
        features: [N, 2] from `LostDetector.features`.
        lost: [N] when the robot was lost; both kinds must occur.
        weights: [N] how much the scans count: those of a lost robot as if it got lost once in `SCANS_UNTIL_LOST`.
    """
    columns = np.column_stack([np.ones(len(lost)), features[:, 0], np.sqrt(features[:, 1])])
    return Calibration(*_regression(columns, lost, weights / weights.sum() * len(weights)).tolist())


def _regression(features: Floats, truth: NDArray[np.bool_], weights: Floats) -> Floats:
    """[F] coefficients of a weighted logistic regression, by Newton's method."""
    found = np.zeros(features.shape[1])
    for _ in range(30):
        predicted = 1.0 / (1.0 + np.exp(-features @ found))
        curvature = weights * predicted * (1.0 - predicted)
        hessian = (features * curvature[:, None]).T @ features + RIDGE * np.eye(len(found))
        found += np.linalg.solve(hessian, features.T @ (weights * (truth - predicted)) - RIDGE * found)
    return found


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x)) if x > -700.0 else 0.0
