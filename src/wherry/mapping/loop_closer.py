"""The back end of graph SLAM: searches for loop closures, and optimizes the pose graph with the accepted ones."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from wherry.mapping.constraints import Constraint
from wherry.mapping.covariances import regularized_inverse, rotate_covariance, transform_covariance
from wherry.mapping.keyframe_graph import KeyframeGraph
from wherry.mapping.loop_closure import LoopClosure, attempt_loop_closure, search_window
from wherry.mapping.motion_noise import is_within
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.submap_graph import SubmapGraph
from wherry.mapping.submaps import MatchingGridCache
from wherry.mapping.tracking import TrackingState

# Covariance (m, m, rad) of a closure in addition to that of its points, since matched surfaces are rough.
CLOSURE_COVARIANCE = np.diag([0.02**2, 0.02**2, math.radians(0.3) ** 2])
CLOSURE_CELL_SIZE = 0.1  # m, side of the cells that keep one point each of the keyframes that are matched together
# Optimization is deferred while closures move the last keyframe by less than this (m and rad).
MAX_DEFERRED_DISTANCE, MAX_DEFERRED_ANGLE = 0.05, math.radians(0.5)
MAX_DEFERRED_CLOSURES = 10  # accepted closures after which the graph is optimized in any case


class LoopCloser:
    """Closes loops between the last keyframe and old submaps.

    Args:
        graph: The pose graph of keyframes, which accepted closures are added to.
        submaps: The graph of submaps, which accepted closures are added to.
        grids: Matching grids of the submaps.
        settings: Settings of graph SLAM.
        attempted: Loop closures that were attempted before.
        pending: Accepted loop closures since the last optimization.
    """

    def __init__(
        self,
        graph: KeyframeGraph,
        submaps: SubmapGraph,
        grids: MatchingGridCache,
        settings: GraphSlamSettings,
        attempted: Iterable[LoopClosure] = (),
        pending: int = 0,
    ) -> None:
        self._graph = graph
        self._submaps = submaps
        self._grids = grids
        self._settings = settings
        self._attempted = list(attempted)
        self._pending = pending

    @property
    def attempted(self) -> Sequence[LoopClosure]:
        """All loop closures that were attempted, accepted or not."""
        return self._attempted

    @property
    def pending(self) -> int:
        """Number of accepted loop closures since the last optimization."""
        return self._pending

    def close_loops(self, tracking: TrackingState) -> None:
        """Search for loop closures of the last keyframe if a search is due, and add the accepted ones to the graphs.

        Args:
            tracking: State of the front end, right after its last keyframe was added.
        """
        is_due = self._settings.close_loops and tracking.keyframe % self._settings.closure_every == 0
        if is_due and self._has_moved_on():
            self._search(tracking)

    def optimize_pending(self) -> None:
        """Optimize the pose graph if accepted loop closures are pending."""
        if self._pending:
            self._optimize()

    def _has_moved_on(self) -> bool:
        """Whether the robot has driven half a search window since the last rejection, so that matches may differ."""
        if not self._attempted or self._attempted[-1].is_accepted:
            return True
        last = self._attempted[-1]
        steps = np.diff(self._graph.poses[last.keyframe :, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum()) >= last.window / 2.0

    def _search(self, tracking: TrackingState) -> None:
        """Match the last keyframe to the submaps that it may be in."""
        candidates = self._submaps.candidates(tracking, self._graph.poses)
        if not candidates:
            return
        keyframe = tracking.keyframe
        cloud = self._graph.surroundings(keyframe, self._settings.closure_scans, CLOSURE_CELL_SIZE)
        if not len(cloud.points):
            return  # surroundings without a return can be matched to nothing
        for index, covariance in candidates[: self._settings.closure_candidates]:
            submap = self._submaps[index]
            expected = self._graph.pose(keyframe).relative_to(self._graph.pose(submap.origin))
            window = search_window(expected, covariance)
            grid = self._grids.grid_of(index, submap)
            closure = attempt_loop_closure(tracking.time, keyframe, submap.origin, grid, cloud, window)
            self._attempted.append(closure)
            if not closure.is_accepted:
                continue
            self._add_constraints(tracking, index, closure)
            correction = closure.measured.relative_to(expected)
            is_small = is_within(correction, MAX_DEFERRED_DISTANCE, MAX_DEFERRED_ANGLE)
            if self._pending >= MAX_DEFERRED_CLOSURES or not is_small:
                self._optimize()

    def _add_constraints(self, tracking: TrackingState, submap: int, closure: LoopClosure) -> None:
        """Add an accepted closure between the last keyframe and a submap to both graphs."""
        information = rotate_covariance(closure.information, -closure.measured.theta)
        covariance = regularized_inverse(information) + CLOSURE_COVARIANCE
        self._graph.add_constraint(
            Constraint(closure.target, closure.keyframe, closure.measured, covariance, is_robust=True)
        )
        measured = closure.measured @ tracking.keyframe_pose.inverse
        covariance = transform_covariance(covariance, tracking.keyframe_pose)
        self._submaps.add_constraint(Constraint(submap, tracking.submap, measured, covariance))
        self._pending += 1

    def _optimize(self) -> None:
        """Optimize the pose graph; no closure is pending afterwards."""
        self._pending = 0
        self._graph.optimize()
