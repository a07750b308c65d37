"""Submaps: runs of consecutive keyframes that scans are matched to (Hess et al. 2016)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from wherry.mapping.keyframes import Keyframe
from wherry.mapping.matching_grid import MatchingGrid
from wherry.space.pose import IDENTITY, Floats, Pose

NO_COVARIANCE = np.zeros((3, 3))
CACHE_SIZE = 512 * 2**20  # bytes, memory of the matching grids that are kept


@dataclass
class Submap:
    """Consecutive keyframes in the frame of the first of them.

    Attributes:
        origin: Index of the first keyframe, whose base_link frame is the submap's frame.
        start: Pose of the submap's frame in the frame of the submap before.
        start_covariance: Covariance of ``start`` in the submap's frame, [3, 3] m, m, rad.
        members: Indices of the keyframes with their poses in the submap's frame.
    """

    origin: int
    start: Pose = IDENTITY
    start_covariance: Floats = field(default_factory=lambda: NO_COVARIANCE)
    members: list[tuple[int, Pose]] = field(default_factory=list)

    @property
    def last_keyframe(self) -> int:
        """Index of the keyframe that was added last."""
        return self.members[-1][0]

    def copy(self) -> Submap:
        """A copy whose list of members is its own."""
        return Submap(self.origin, self.start, self.start_covariance, list(self.members))


class MatchingGridCache:
    """The matching grids of submaps; the least recently used are dropped, and rebuilt bit for bit when needed.

    On a large site grids would take most of the memory; the point clouds that they are rebuilt from take little.

    Args:
        keyframes: All keyframes; the caller appends to this list.
        capacity: Memory that grids may take, bytes, not counting the one used last.
    """

    def __init__(self, keyframes: Sequence[Keyframe], capacity: int = CACHE_SIZE) -> None:
        self._keyframes = keyframes
        self._capacity = capacity
        self._grids: dict[int, MatchingGrid] = {}  # by index of the submap, the most recently used last

    def grid_of(self, index: int, submap: Submap) -> MatchingGrid:
        """The matching grid of the submap with this index, with all of its members added."""
        grid = self._grids.pop(index, None)
        if grid is None:
            self._evict()
            grid = MatchingGrid()
        self._grids[index] = grid
        for keyframe, pose in submap.members[grid.scan_count :]:
            grid.add(self._keyframes[keyframe].cloud.transformed(pose))
        return grid

    def _evict(self) -> None:
        """Drop grids, least recently used first, until the rest fits into the capacity."""
        taken = sum(grid.nbytes for grid in self._grids.values())
        while taken > self._capacity:
            taken -= self._grids.pop(next(iter(self._grids))).nbytes
