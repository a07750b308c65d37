"""The graph of submaps: how they are placed relative to each other, and which of them the robot may be in."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wherry.mapping.constraints import Constraint, ConstraintList
from wherry.mapping.covariances import invert, relative_covariances, transform_covariances
from wherry.mapping.pose_graph import ROBUST_SCALE, PoseGraph, constraint_errors
from wherry.mapping.scan_matching import match_covariance
from wherry.mapping.submaps import Submap
from wherry.mapping.tracking import TrackingState
from wherry.space.pose import IDENTITY, Floats, Pose, relative

SUBMAP_CONSTRAINT_INFLATION = 4.0  # factor on the match covariance, for errors that matching does not see
CLOSURE_RADIUS = 3.0  # m from the keyframes of a submap within which its surroundings are matched
CANDIDATE_SIGMAS = 3.0  # standard deviations of the position that are added to that radius


class SubmapGraph:
    """Submaps with the constraints between them.

    Args:
        submaps: Submaps to begin with, in the order in which they were begun.
        constraints: Constraints between them.
    """

    def __init__(self, submaps: Iterable[Submap] = (), constraints: ConstraintList | None = None) -> None:
        self._submaps = list(submaps)
        self._constraints = constraints or ConstraintList()

    def __len__(self) -> int:
        return len(self._submaps)

    def __getitem__(self, index: int) -> Submap:
        return self._submaps[index]

    @property
    def submaps(self) -> tuple[Submap, ...]:
        """All submaps in the order in which they were begun."""
        return tuple(self._submaps)

    @property
    def constraints(self) -> ConstraintList:
        """Constraints between submaps, whose nodes are indices of submaps."""
        return self._constraints

    def begin(self, keyframe: int, start: Pose = IDENTITY, start_covariance: Floats | None = None) -> None:
        """Begin a submap at a keyframe.

        Args:
            keyframe: Index of the keyframe.
            start: Pose of the keyframe in the frame of the submap before.
            start_covariance: Covariance of ``start`` in the keyframe's frame, [3, 3].
        """
        submap = Submap(keyframe, start, members=[(keyframe, IDENTITY)])
        if start_covariance is not None:
            submap.start_covariance = start_covariance
        self._submaps.append(submap)

    def connect_to_next(self, index: int) -> None:
        """Add the constraint between a submap, complete by now, and the next one."""
        following = self._submaps[index + 1]
        inflation = SUBMAP_CONSTRAINT_INFLATION * match_covariance(following.start)
        self._constraints.append(Constraint(index, index + 1, following.start, following.start_covariance + inflation))

    def add_constraint(self, constraint: Constraint) -> None:
        """Add a constraint between submaps, such as a loop closure."""
        self._constraints.append(constraint)

    def containing(self, keyframe: int) -> int:
        """Index of the first submap that reaches up to a keyframe."""
        return next(index for index, submap in enumerate(self._submaps) if submap.last_keyframe >= keyframe)

    def candidates(self, tracking: TrackingState, keyframe_poses: Floats) -> list[tuple[int, Floats]]:
        """The submaps that the last keyframe may be in, the nearest first.

        Args:
            tracking: State of the front end.
            keyframe_poses: Present estimate, [K, 3] m, m, rad, map frame.

        Returns:
            Index of each submap, and the covariance of the keyframe's pose in the submap's frame, [3, 3].
        """
        if tracking.submap < 2:
            return []
        covariances = relative_covariances(
            tracking.submap,
            len(self._submaps),
            self._constraints.ends,
            self._constraints.measured,
            self.constraint_covariances(keyframe_poses),
        )
        old = self._submaps[: tracking.submap - 1]
        # Covariances of the submaps relative to the robot become those of the robot, in the axes of each submap.
        here = np.tile(keyframe_poses[tracking.keyframe], (len(old), 1))
        origins = keyframe_poses[[submap.origin for submap in old]]
        rotations = np.zeros_like(here)
        rotations[:, 2] = here[:, 2] - origins[:, 2]
        in_base_link = transform_covariances(covariances[: len(old)], relative(origins, here)) + tracking.covariance
        in_submaps = transform_covariances(in_base_link, rotations)
        deviations = np.sqrt(np.maximum(in_submaps[:, 0, 0], in_submaps[:, 1, 1]))
        radii = CLOSURE_RADIUS + CANDIDATE_SIGMAS * deviations
        distances = np.hypot(*(keyframe_poses[:, :2] - keyframe_poses[tracking.keyframe, :2]).T)
        nearest = np.array([distances[submap.origin : submap.last_keyframe + 1].min() for submap in old])
        order = np.argsort(nearest, kind="stable")
        return [(int(index), in_submaps[index]) for index in order[nearest[order] < radii[order]]]

    def constraint_covariances(self, keyframe_poses: Floats) -> Floats:
        """Covariances of the constraints, [C, 3, 3], inflated where the optimized map contradicts them.

        Otherwise a false closure that the optimization gives little weight would narrow the next search around a wrong
        pose. The factor is the inverse of the weight under Cauchy's loss.
        """
        origins = keyframe_poses[[submap.origin for submap in self._submaps]]
        constraints = self._constraints
        covariances = constraints.covariances
        graph = PoseGraph(origins, constraints.ends, constraints.measured, invert(covariances), constraints.robust)
        inflation: Floats = 1.0 + (constraint_errors(graph) / ROBUST_SCALE) ** 2
        return inflation[:, None, None] * covariances
