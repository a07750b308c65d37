"""Detection of being lost: a calibrated probability from the agreement of the last scans with the map.

The *evidence* of a scan is the log likelihood ratio of a lost robot against a localized one. It is linear in the
fractions of the scan's beams that are inliers, blocked or passed through walls (`agreement.ScanAgreement`); its weights
are those of a logistic regression. Two probabilities are made from it.

The *sustained probability* decides about relocalization, which a single outlier scan must not cause. It is computed
from the mean evidence of the last scans, in which the last one has weight 1 and the weight of earlier ones decays with
time. The total weight is the number of independent scans that the mean is worth. It is limited, since the errors of
consecutive scans are correlated.

The *probability* is calibrated. A scan with few inliers proves that the robot is lost on an accurate map, but not in a
building that has changed since it was mapped. The probability therefore depends on the z-score of the scan's evidence
against the evidence of inlier scans on this map, and on the mean evidence before the scan. Its three coefficients were
fitted by `wherry.experiments.localization.calibration` to kidnapped robots on the maps of three buildings and two
simulated worlds; the reliability diagrams in the results are of a fourth building and a third world.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from wherry.localization.agreement import ScanAgreement

BASELINE_MEAN, BASELINE_DEVIATION = (
    -2.4,
    0.35,
)  # log odds, mean and standard deviation of the evidence of inlier scans before the first scan
BASELINE_PRIOR_SCANS = 20  # scans that the initial baseline weighs as much as
BASELINE_MAX_SCANS = 100  # scans over which the baseline's moving averages extend
BASELINE_MAX_Z_SCORE = 3.0  # standard deviations at which evidence is clipped before it updates the baseline
BASELINE_MIN_DEVIATION = 0.15  # log odds, lower limit of the baseline's standard deviation
BASELINE_MAX_LOST_PROBABILITY = 0.1  # probability of being lost above which a scan does not update the baseline


@dataclass(frozen=True, slots=True)
class EvidenceModel:
    """Coefficients of a scan's evidence of being lost, and of its average over time.

    Beams that end in unknown space carry no evidence, since maps have holes and borders.

    Attributes:
        inlier_weight: Evidence of a scan of inliers only, log odds.
        blocked_weight: Evidence of a scan of blocked beams only, log odds.
        passed_weight: Evidence of a scan of beams through walls only, log odds.
        max_evidence: Absolute value at which a scan's evidence is clipped, log odds.
        prior: Prior probability of being lost, 0 to 1.
        time_constant: Time in which the weight of a past scan decays to 1/e, s.
        min_decay: Lower limit of the factor by which past scans decay from one scan to the next, 0 to 1.
        max_independent_scans: Upper limit of the number of independent scans that the mean evidence is worth.
    """

    inlier_weight: float = -3.0
    blocked_weight: float = 5.8
    passed_weight: float = 14.3
    max_evidence: float = 4.0
    prior: float = 0.01
    time_constant: float = 1.0
    min_decay: float = 0.5
    max_independent_scans: float = 3.0

    def evidence(self, agreement: ScanAgreement) -> float:
        """Log likelihood ratio of a scan for a lost robot against a localized one."""
        log_odds = (
            self.inlier_weight * agreement.inlier_fraction
            + self.blocked_weight * agreement.blocked_fraction
            + self.passed_weight * agreement.passed_fraction
        )
        return min(max(log_odds, -self.max_evidence), self.max_evidence)


@dataclass(frozen=True, slots=True)
class LostFeatures:
    """Features of one scan from which the probability of being lost is computed.

    Attributes:
        mean_evidence: Mean evidence of the earlier scans, log odds.
        z_score: Standard deviations by which the scan's evidence exceeds the baseline; 0 if it does not.
    """

    mean_evidence: float
    z_score: float


@dataclass(frozen=True, slots=True)
class LostCalibration:
    """Coefficients of the log odds of being lost.

    Attributes:
        intercept: Log odds at features of 0.
        mean_evidence_weight: Coefficient of the mean evidence of the earlier scans.
        z_score_weight: Coefficient of the square root of the scan's z-score.
    """

    intercept: float = -8.8
    mean_evidence_weight: float = 0.81
    z_score_weight: float = 2.11

    def log_odds(self, features: LostFeatures) -> float:
        """Log odds of being lost."""
        return (
            self.intercept
            + self.mean_evidence_weight * features.mean_evidence
            + self.z_score_weight * math.sqrt(features.z_score)
        )


class EvidenceBaseline:
    """Moving mean and variance of the evidence of inlier scans on this map."""

    def __init__(self) -> None:
        self._mean, self._variance, self._count = BASELINE_MEAN, BASELINE_DEVIATION**2, BASELINE_PRIOR_SCANS

    def z_score(self, evidence: float) -> float:
        """Standard deviations by which evidence exceeds the mean; 0 if it does not."""
        return max(0.0, evidence - self._mean) / max(math.sqrt(self._variance), BASELINE_MIN_DEVIATION)

    def update(self, evidence: float) -> None:
        """Add the evidence of an inlier scan, clipped to a few standard deviations around the mean."""
        limit = BASELINE_MAX_Z_SCORE * math.sqrt(self._variance)
        evidence = min(max(evidence, self._mean - limit), self._mean + limit)
        self._count = min(self._count + 1, BASELINE_MAX_SCANS)
        self._mean += (evidence - self._mean) / self._count
        self._variance += ((evidence - self._mean) ** 2 - self._variance) / self._count


class LostDetector:
    """Tracks the probability of being lost from scan to scan.

    Args:
        model: Coefficients of the evidence; the fitted ones by default.
        calibration: Coefficients of the probability; the fitted ones by default.

    Attributes:
        model: Coefficients of the evidence.
    """

    def __init__(self, model: EvidenceModel | None = None, calibration: LostCalibration | None = None) -> None:
        self.model = model or EvidenceModel()
        self._calibration = calibration or LostCalibration()
        self._baseline = EvidenceBaseline()
        self.reset()

    def reset(self) -> None:
        """Forget the last scans but keep the baseline, which belongs to the map."""
        self._mean_evidence = 0.0
        self._weight = 0.0
        self._time = -math.inf
        self._features = LostFeatures(0.0, 0.0)
        self._probability = self.model.prior

    def update(self, time: float, agreement: ScanAgreement) -> float:
        """Add the agreement of a scan with the map at the estimated pose.

        Args:
            time: Time of the scan, s; it must not decrease.
            agreement: Agreement of the scan with the map.

        Returns:
            The probability of being lost, 0 to 1.
        """
        evidence = self.model.evidence(agreement)
        self._features = LostFeatures(self._mean_evidence, self._baseline.z_score(evidence))
        self._probability = _logistic(self._calibration.log_odds(self._features))
        if evidence < 0.0 and self._probability < BASELINE_MAX_LOST_PROBABILITY:
            self._baseline.update(evidence)
        self._average(time, evidence)
        return self._probability

    def _average(self, time: float, evidence: float) -> None:
        """Update the exponentially weighted mean of the evidence."""
        decay = 0.0
        if self._weight:
            decay = max(math.exp(-(time - self._time) / self.model.time_constant), self.model.min_decay)
        self._time = time
        self._weight = decay * self._weight + 1.0
        self._mean_evidence += (evidence - self._mean_evidence) / self._weight

    def z_score(self, agreement: ScanAgreement) -> float:
        """Standard deviations by which a scan's evidence of being lost exceeds the baseline; 0 if it does not."""
        return self._baseline.z_score(self.model.evidence(agreement))

    @property
    def features(self) -> LostFeatures:
        """Features of the last scan."""
        return self._features

    @property
    def probability(self) -> float:
        """Calibrated probability of being lost, 0 to 1."""
        return self._probability

    @property
    def sustained_probability(self) -> float:
        """Probability of being lost by the mean evidence of the last seconds, 0 to 1; it reacts after several scans."""
        if not self._weight:
            return self.model.prior
        prior = math.log(self.model.prior / (1.0 - self.model.prior))
        return _logistic(prior + min(self._weight, self.model.max_independent_scans) * self._mean_evidence)


def _logistic(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-log_odds)) if log_odds > -700.0 else 0.0
