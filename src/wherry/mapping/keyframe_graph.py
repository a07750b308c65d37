"""The pose graph of keyframes, from which graph SLAM renders its map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from wherry.mapping.constraints import Constraint, ConstraintList
from wherry.mapping.covariances import invert
from wherry.mapping.keyframes import Keyframe
from wherry.mapping.point_cloud import PointCloud, merge_clouds
from wherry.mapping.pose_graph import PoseGraph, optimized
from wherry.space.pose import Floats, Pose

NO_POSES = np.zeros((0, 3))


class KeyframeGraph:
    """Keyframes with their poses and the constraints between them.

    Args:
        keyframes: Keyframes to begin with, K.
        poses: base_link at each of them in the map frame, [K, 3] m, m, rad; copied.
        constraints: Constraints between them; copied.
    """

    def __init__(
        self, keyframes: Iterable[Keyframe] = (), poses: Floats = NO_POSES, constraints: ConstraintList | None = None
    ) -> None:
        self._keyframes = list(keyframes)
        self._poses = poses.copy()
        self._constraints = ConstraintList() if constraints is None else constraints.copy()

    def __len__(self) -> int:
        return len(self._keyframes)

    @property
    def keyframes(self) -> Sequence[Keyframe]:
        """All keyframes; the sequence grows as keyframes are added."""
        return self._keyframes

    @property
    def poses(self) -> Floats:
        """base_link at each keyframe in the map frame, [K, 3] m, m, rad."""
        return self._poses

    @property
    def constraints(self) -> ConstraintList:
        """Constraints between keyframes, whose nodes are indices of keyframes."""
        return self._constraints

    def pose(self, keyframe: int) -> Pose:
        """base_link in the map frame at the keyframe with this index."""
        return Pose.from_array(self._poses[keyframe])

    def nearest(self, pose: Pose) -> int:
        """Index of the keyframe nearest to the position of a pose in the map frame."""
        return int(np.hypot(*(self._poses[:, :2] - pose.as_array()[:2]).T).argmin())

    def surroundings(self, keyframe: int, count: int, cell_size: float) -> PointCloud:
        """The points of a keyframe and of those just before it, in its base_link frame.

        Args:
            keyframe: Index of the keyframe.
            count: Number of keyframes whose points are merged.
            cell_size: Side of the square cells that keep one point each, m.
        """
        here = self.pose(keyframe)
        recent = range(max(keyframe + 1 - count, 0), keyframe + 1)
        clouds = [self._keyframes[k].cloud.transformed(self.pose(k).relative_to(here)) for k in recent]
        return merge_clouds(clouds, cell_size)

    def add(self, keyframe: Keyframe, pose: Pose) -> int:
        """Add a keyframe.

        Args:
            keyframe: The keyframe.
            pose: base_link at the keyframe in the map frame.

        Returns:
            Index of the keyframe.
        """
        self._keyframes.append(keyframe)
        self._poses = np.vstack([self._poses, pose.as_array()])
        return len(self._keyframes) - 1

    def add_constraint(self, constraint: Constraint) -> None:
        """Add a constraint between keyframes."""
        self._constraints.append(constraint)

    def pose_graph(self) -> PoseGraph:
        """The poses and constraints as arrays for the optimizer."""
        constraints = self._constraints
        information = invert(constraints.covariances)
        return PoseGraph(self._poses, constraints.ends, constraints.measured, information, constraints.robust)

    def optimize(self) -> None:
        """Move the keyframes to the poses that agree best with all constraints."""
        self._poses = optimized(self.pose_graph()).poses
