"""How far to believe a stated probability: what was stated beside what came true."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.experiments.results import markdown_table
from wherry.space.pose import Floats

TENTHS = 10


@dataclass(frozen=True, slots=True)
class Reliability:
    """Stated probabilities against the truth.

    Attributes:
        tenths: [10, 3] for every tenth of the stated probability: its mean, the share of the cases that came true, and
            how many there were; NaN, NaN, 0 where there were none.
        cases: How many in all.
        base_rate: Share of them that came true: who states this always is calibrated, and tells nothing.
        calibration_error: Expected calibration error: the mean distance, over the cases, of what a tenth stated from
            what came true.
        brier: Brier score: mean square of the distance from what was stated to 1 if it came true, else to 0.
    """

    tenths: Floats
    cases: int
    base_rate: float
    calibration_error: float
    brier: float

    @classmethod
    def of(cls, stated: Floats, true: NDArray[np.bool_]) -> Reliability:
        """Compare [N] stated probabilities with [N] what was true; N at least 1."""
        tenth = np.minimum((stated * TENTHS).astype(int), TENTHS - 1)
        rows = [(stated[tenth == k], true[tenth == k]) for k in range(TENTHS)]
        tenths = np.array([(s.mean(), t.mean(), len(s)) if len(s) else (math.nan, math.nan, 0) for s, t in rows])
        gaps = np.nan_to_num(np.abs(tenths[:, 0] - tenths[:, 1]))
        return cls(
            tenths=tenths,
            cases=len(stated),
            base_rate=float(true.mean()),
            calibration_error=float(gaps @ tenths[:, 2] / len(stated)),
            brier=float(np.mean(np.square(stated - true))),
        )

    @property
    def base_brier(self) -> float:
        """The Brier score of who always states the base rate."""
        return self.base_rate * (1.0 - self.base_rate)


def reliability_table(reliability: Reliability, what: str) -> str:
    """The tenths that occurred, as Markdown.

    Args:
        reliability: To be shown.
        what: What was stated, as in "being lost".
    """
    return markdown_table(
        [f"stated probability of {what}", "truly", "scans"],
        [
            [f"{stated:.3f}", f"{true:.3f}", f"{count:.0f}"]
            for stated, true, count in reliability.tenths.tolist()
            if count
        ],
    )
