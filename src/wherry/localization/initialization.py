"""Initial distributions of the particles: Gaussian modes, and uniform over the map's free space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wherry.errors import InputError
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose


@dataclass(frozen=True, slots=True)
class PoseMode:
    """One Gaussian mode of a multi-modal distribution over poses.

    Attributes:
        pose: Mean pose of base_link, map frame.
        covariance: [3, 3] m, m, rad.
        weight: Relative weight of the mode.
    """

    pose: Pose
    covariance: Floats
    weight: float

    def __post_init__(self) -> None:
        """Check that the mode is a valid Gaussian.

        Raises:
            InputError: Pose or covariance is not finite, or the covariance has a negative eigenvalue.
        """
        if not np.isfinite(self.pose.as_array()).all():
            raise InputError("initial pose", "", f"{self.pose} is not finite")
        if not np.isfinite(self.covariance).all() or float(np.linalg.eigvalsh(self.covariance).min()) < -1e-9:
            raise InputError(
                "initial pose", "covariance", "is not a covariance: it must be finite and positive semidefinite"
            )

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Draw [count, 3] poses m, m, rad, map frame."""
        return rng.multivariate_normal(self.pose.as_array(), self.covariance, count, method="eigh")


def draw_from_modes(modes: Sequence[PoseMode], count: int, rng: np.random.Generator) -> Floats:
    """Draw [count, 3] poses m, m, rad, map frame, from a mixture of Gaussian modes."""
    weights = np.array([mode.weight for mode in modes])
    counts = rng.multinomial(count, weights / weights.sum())
    return np.vstack([mode.draw(number, rng) for mode, number in zip(modes, counts, strict=True)])


class FreeSpace:
    """The uniform distribution over a map's free cells and all headings.

    Args:
        grid: The map.
    """

    def __init__(self, grid: OccupancyGrid) -> None:
        self._grid = grid
        self._cells = np.flatnonzero(grid.free)

    @property
    def is_empty(self) -> bool:
        """Whether the map has no free cell."""
        return not len(self._cells)

    def draw(self, count: int, rng: np.random.Generator) -> Floats:
        """Draw [count, 3] poses m, m, rad, map frame; nothing is drawn for a count of 0."""
        if not count:
            return np.empty((0, 3))
        row, column = np.divmod(
            self._cells[rng.integers(len(self._cells), size=count)], self._grid.probability.shape[1]
        )
        offset = rng.random((count, 3))
        cells = np.column_stack([column, row]) + offset[:, :2]
        positions = self._grid.origin.transform(cells * self._grid.resolution)
        return np.column_stack([positions, (offset[:, 2] * 2.0 - 1.0) * math.pi])
