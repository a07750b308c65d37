"""Occupancy grids: what is known to be free, occupied, or not known (paper, section 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.space.pose import Pose

FREE_BELOW = 0.196  # map_server's free_thresh
OCCUPIED_ABOVE = 0.65  # map_server's occupied_thresh
UNKNOWN = 0.5


@dataclass(frozen=True)
class OccupancyGrid:
    """A map as probabilities.

    Attributes:
        probability: [H, W] float32, P(occupied); row 0 is the smallest y, column 0 the smallest x; 0.5 is unknown.
        resolution: m, a grid cell's side.
        origin: The outer corner of grid cell [0, 0] in the map frame.
    """

    probability: NDArray[np.float32]
    resolution: float
    origin: Pose = Pose()

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """[H, W] where something stands."""
        return self.probability > OCCUPIED_ABOVE

    @property
    def free(self) -> NDArray[np.bool_]:
        """[H, W] where nothing stands."""
        return self.probability < FREE_BELOW

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """[H, W] where neither is known."""
        return ~(self.occupied | self.free)
