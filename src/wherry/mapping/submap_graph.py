"""The graph of submaps: constraints between them, and the loop closure candidates among them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from wherry.mapping.constraints import Constraint, ConstraintList
from wherry.mapping.covariances import invert, relative_covariances, transform_covariances
from wherry.mapping.pose_graph import ROBUST_SCALE, PoseGraph, constraint_errors
from wherry.mapping.scan_matching import match_covariance
from wherry.mapping.submaps import NO_COVARIANCE, Submap
from wherry.mapping.tracking import TrackingState
from wherry.space.pose import IDENTITY, Floats, Pose, relative

SUBMAP_CONSTRAINT_INFLATION = 4.0  # factor on the match covariance, for systematic errors of matching
CLOSURE_RADIUS = 3.0  # m from the nearest keyframe of a submap within which a closure is attempted
CANDIDATE_SIGMAS = 3.0  # standard deviations of the position by which `CLOSURE_RADIUS` is widened


class SubmapGraph:
    """Submaps with the constraints between them.

    Args:
        submaps: Submaps to begin with, in the order in which they were begun; copied.
        constraints: Constraints between them; copied.
    """

    def __init__(self, submaps: Iterable[Submap] = (), constraints: ConstraintList | None = None) -> None:
        self._submaps = [submap.copy() for submap in submaps]
        self._constraints = ConstraintList() if constraints is None else constraints.copy()

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

    def extend(self, tracking: TrackingState, size: int) -> TrackingState:
        """Add the last keyframe to the tracked submap and to the next one, which begins at half of the size.

        Args:
            tracking: State of the front end after its last keyframe.
            size: Keyframes in a complete submap.

        Returns:
            The state on the submap to track from now on: the next one, once the tracked one is complete.
        """
        submap, keyframe, pose = self._submaps[tracking.submap], tracking.keyframe, tracking.keyframe_pose
        submap.members.append((keyframe, pose))
        if tracking.submap < len(self._submaps) - 1:
            following = self._submaps[tracking.submap + 1]
            following.members.append((keyframe, pose.relative_to(following.start)))
            if len(submap.members) >= size:
                self.connect_to_next(tracking.submap)
                return tracking.on_next_submap(following.start)
        elif len(submap.members) >= size // 2:
            self.begin(keyframe, pose, tracking.covariance)
            return replace(tracking, next_covariance=NO_COVARIANCE)
        return tracking

    def connect_to_next(self, index: int) -> None:
        """Constrain the next submap, if there is one, to this one, which gets no more keyframes."""
        if index == len(self._submaps) - 1:
            return
        following = self._submaps[index + 1]
        inflation = SUBMAP_CONSTRAINT_INFLATION * match_covariance(following.start)
        self._constraints.append(Constraint(index, index + 1, following.start, following.start_covariance + inflation))

    def add_constraint(self, constraint: Constraint) -> None:
        """Add a constraint between submaps, such as a loop closure."""
        self._constraints.append(constraint)

    def containing(self, keyframe: int) -> int:
        """Index of the first submap that contains a keyframe."""
        return next(index for index, submap in enumerate(self._submaps) if submap.last_keyframe >= keyframe)

    def candidates(self, tracking: TrackingState, keyframe_poses: Floats) -> list[tuple[int, Floats]]:
        """Candidates for loop closures: old submaps that the last keyframe may be in, the nearest first.

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
        # Covariances of the submaps relative to the tracked one become those of the robot relative to each submap.
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
