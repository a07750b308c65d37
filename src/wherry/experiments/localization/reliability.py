"""Reliability of stated probabilities: calibration error and Brier score."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.experiments.results import markdown_table
from wherry.space.pose import Floats

BINS = 10  # bins of equal width over the stated probability


@dataclass(frozen=True, slots=True)
class Reliability:
    """Calibration of stated probabilities.

    Attributes:
        bins: [10, 3] mean stated probability, observed frequency and number of cases of every bin; NaN, NaN, 0 in
            empty bins.
        cases: Number of cases.
        base_rate: Observed frequency over all cases.
        calibration_error: Expected calibration error (ECE), the mean absolute difference between stated probability and
            observed frequency of a bin, weighted by its number of cases.
        brier: Brier score: mean squared difference between stated probability and outcome, 1 or 0.
    """

    bins: Floats
    cases: int
    base_rate: float
    calibration_error: float
    brier: float

    @classmethod
    def of(cls, stated: Floats, outcomes: NDArray[np.bool_]) -> Reliability:
        """Compare stated probabilities [N] with outcomes [N]; N is at least 1."""
        index = np.minimum((stated * BINS).astype(int), BINS - 1)
        members = [(stated[index == k], outcomes[index == k]) for k in range(BINS)]
        bins = np.array([(s.mean(), o.mean(), len(s)) if len(s) else (math.nan, math.nan, 0) for s, o in members])
        gaps = np.nan_to_num(np.abs(bins[:, 0] - bins[:, 1]))
        return cls(
            bins=bins,
            cases=len(stated),
            base_rate=float(outcomes.mean()),
            calibration_error=float(gaps @ bins[:, 2] / len(stated)),
            brier=float(np.mean(np.square(stated - outcomes))),
        )

    @property
    def base_brier(self) -> float:
        """Brier score of always stating the base rate, which is calibrated but uninformative."""
        return self.base_rate * (1.0 - self.base_rate)


def reliability_table(reliability: Reliability, event: str) -> str:
    """The bins that are not empty, as a Markdown table.

    Args:
        reliability: Calibration of the stated probabilities.
        event: Name of the event, as in "being lost".
    """
    rows = [
        [f"{stated:.3f}", f"{observed:.3f}", f"{count:.0f}"]
        for stated, observed, count in reliability.bins.tolist()
        if count
    ]
    return markdown_table([f"stated probability of {event}", "observed frequency", "scans"], rows)
