"""Am I lost? A calibrated probability, from how the last scans agreed with the map.

What a scan says is a logistic regression on the shares of its beams (`agreement.Agreement`): those that the map
explains, those that were stopped by something which is not on it, and those that went through something which is. It
was fitted to scans of five buildings, on maps made of other scans, and to simulated ones, at poses that were right and
at wrong ones where the scan fits as well as it can nearby. Scans that follow each other see the same things, so that a
few seconds of them count as a few scans, however many there were; and one scan alone counts once, however rare it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.localization.agreement import Agreement

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LostModel:
    """Coefficients of the regression, log odds for a scan of which all beams are such.

    Beams that end where the map knows nothing say nothing: maps have holes, and an end.

    Attributes:
        explained: For the share of beams that the map explains.
        blocked: For the share of beams that ended on something which is not on the map.
        passed: For the share of beams that went through something which is on the map.
        most: No scan says more than this, either way.
        prior: Probability of being lost before anything is seen.
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


class LostDetector:
    """Follows the probability of being lost from scan to scan."""

    def __init__(self, model: LostModel | None = None) -> None:
        self.model = model or LostModel()
        self.reset()

    def reset(self) -> None:
        """Forget what was seen; the pose is a new one."""
        self._average = 0.0
        self._weight = 0.0
        self._time = -math.inf

    def observe(self, time: float, agreement: Agreement) -> float:
        """Take in how a scan agreed with the map at the estimated pose.

        Args:
            time: s, the scan's; not before the last one's.
            agreement: Of the scan.

        Returns:
            The probability of being lost, 0 to 1.
        """
        kept = max(math.exp(-(time - self._time) / self.model.memory), self.model.kept) if self._weight else 0.0
        self._time = time
        self._weight = kept * self._weight + 1.0
        self._average += (self.model.evidence(agreement) - self._average) / self._weight
        return self.probability

    @property
    def probability(self) -> float:
        """The probability of being lost, 0 to 1."""
        if not self._weight:
            return self.model.prior
        prior = math.log(self.model.prior / (1.0 - self.model.prior))
        return _logistic(prior + min(self._weight, self.model.independent_scans) * self._average)


def fit(agreements: list[Agreement], lost: NDArray[np.bool_]) -> LostModel:
    """Fit the regression by Newton's method, with both kinds weighing the same.

    Args:
        agreements: [N] at poses right and wrong.
        lost: [N] which poses were wrong; both kinds must occur.
    """
    features = np.array([[found.explained, found.blocked, found.passed] for found in agreements])
    truth = lost.astype(np.float64)
    balance = np.where(lost, 0.5 / truth.mean(), 0.5 / (1.0 - truth.mean()))
    weights = np.zeros(3)
    for _ in range(30):
        predicted = 1.0 / (1.0 + np.exp(-features @ weights))
        curvature = balance * predicted * (1.0 - predicted)
        hessian = (features * curvature[:, None]).T @ features + 1e-3 * np.eye(3)
        weights += np.linalg.solve(hessian, features.T @ (balance * (truth - predicted)) - 1e-3 * weights)
    explained, blocked, passed = map(float, weights)
    return LostModel(explained, blocked, passed)


def _logistic(x: float) -> float:
    return 1.0 / (1.0 + math.exp(-x)) if x > -700.0 else 0.0
