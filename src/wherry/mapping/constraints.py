"""Constraints of a pose graph: measured relative poses with their covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Floats, Pose

MIN_CAPACITY = 64  # constraints, smallest growth of the arrays


@dataclass(frozen=True)
class Constraint:
    """A measured relative pose of two nodes.

    Attributes:
        first: Index of the node that the measurement is relative to.
        second: Index of the measured node.
        measured: Pose of the second node in the frame of the first.
        covariance: Covariance of ``measured`` in the frame of the second node, [3, 3] m, m, rad.
        is_robust: Whether a robust loss is applied, since the measurement may be an outlier.
    """

    first: int
    second: int
    measured: Pose
    covariance: Floats
    is_robust: bool = False


class ConstraintList:
    """Constraints as arrays that grow in amortized constant time and are read without a copy."""

    def __init__(self) -> None:
        self._count = 0
        self._ends = np.zeros((0, 2), np.int64)
        self._measured = np.zeros((0, 3))
        self._covariances = np.zeros((0, 3, 3))
        self._robust = np.zeros(0, np.bool_)

    @classmethod
    def from_arrays(
        cls, ends: NDArray[np.int64], measured: Floats, covariances: Floats, robust: NDArray[np.bool_]
    ) -> ConstraintList:
        """Constraints from arrays as the properties return them; the arrays are copied."""
        constraints = cls()
        constraints._count = len(ends)
        constraints._ends, constraints._measured = ends.copy(), measured.copy()
        constraints._covariances, constraints._robust = covariances.copy(), robust.copy()
        return constraints

    def __len__(self) -> int:
        return self._count

    def append(self, constraint: Constraint) -> None:
        """Add a constraint."""
        if self._count == len(self._ends):
            spare = max(self._count, MIN_CAPACITY)
            self._ends = np.concatenate([self._ends, np.zeros((spare, 2), np.int64)])
            self._measured = np.concatenate([self._measured, np.zeros((spare, 3))])
            self._covariances = np.concatenate([self._covariances, np.zeros((spare, 3, 3))])
            self._robust = np.concatenate([self._robust, np.zeros(spare, np.bool_)])
        self._ends[self._count] = constraint.first, constraint.second
        self._measured[self._count] = constraint.measured.as_array()
        self._covariances[self._count] = constraint.covariance
        self._robust[self._count] = constraint.is_robust
        self._count += 1

    def copy(self) -> ConstraintList:
        """An independent copy."""
        return self.from_arrays(self.ends, self.measured, self.covariances, self.robust)

    @property
    def ends(self) -> NDArray[np.int64]:
        """First and second node of each constraint, [C, 2]."""
        return self._ends[: self._count]

    @property
    def measured(self) -> Floats:
        """Poses of the second nodes in the frames of the first, [C, 3] m, m, rad."""
        return self._measured[: self._count]

    @property
    def covariances(self) -> Floats:
        """Covariances of the measured poses in the frames of the second nodes, [C, 3, 3] m, m, rad."""
        return self._covariances[: self._count]

    @property
    def robust(self) -> NDArray[np.bool_]:
        """Which constraints have a robust loss, [C]."""
        return self._robust[: self._count]
