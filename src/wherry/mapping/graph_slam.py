"""Graph SLAM: scans are matched to the submap that grows around the robot; closed loops bend the whole map straight.

The front end places each scan on the present submap, so it is never disturbed; the back end moves the submaps (Hess et
al. 2016). A submap lies in the frame of its first keyscan, so that nodes of the pose graph are keyscans only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from wherry.mapping.closures import Closure, search_window, try_closure
from wherry.mapping.cloud import Cloud, merged
from wherry.mapping.keyscans import Keyscan, MapDrawing
from wherry.mapping.motion_prior import ODOMETRY, STEADY_MOTION, is_within
from wherry.mapping.pieces import NO_COVARIANCE, Edge, EdgeList, Front, Piece, SubmapStore
from wherry.mapping.pose_graph import ROBUST_SCALE, PoseGraph, edge_errors, optimized
from wherry.mapping.refinement import Refinement
from wherry.mapping.scan_matching import find_scan, track_scan
from wherry.mapping.slam import NO_DISCS
from wherry.mapping.submap import Submap
from wherry.mapping.uncertainty import carried, carried_each, inverse, relative_covariances, turned
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose, relative
from wherry.space.trajectory import Trajectory

STILL_DISTANCE, STILL_ANGLE = 0.005, math.radians(0.2)  # m and rad; a scan taken nearer than this is not matched
# Matches are less exact than their points are: surfaces are rough, scans are not taken in an instant.
MATCH_DISTANCE, MATCH_DISTANCE_PER_DISTANCE = 0.01, 0.005  # m, m per m from the submap's origin
MATCH_ANGLE, MATCH_ANGLE_PER_DISTANCE = math.radians(0.2), math.radians(0.03)  # rad, rad per m
WAY_DOUBT = 4.0  # how much more uncertain the way from piece to piece is taken to be, for what matching overlooked
CLOSURE_COVARIANCE = np.diag([0.02**2, 0.02**2, math.radians(0.3) ** 2])  # m, m, rad likewise, of closures
RESUMED_COVARIANCE = np.diag([0.05**2, 0.05**2, math.radians(1.0) ** 2])  # m, m, rad, of a place to resume at
SIGHT = 3.0  # m; surroundings are matched to submaps whose robot was so near, or may have been
SURPRISE, SURPRISE_ANGLE = 0.05, math.radians(0.5)  # m and rad; a closure that moves the map by so much does so now
CLOSURE_CELL = 0.1  # m; of the points matched together, one in each square of this size is kept
PENDING = 10  # closures that move it by less may wait together


@dataclass(frozen=True, slots=True)
class GraphSlamSettings:
    """What can be chosen.

    Attributes:
        resolution: m, a grid cell of the map that is drawn.
        range_limit: m, readings beyond it are not used.
        empty_range: m, how far a beam that met nothing is believed to be free; 0 if a lidar loses dark surfaces.
        keyscan_distance: m between keyscans.
        keyscan_angle: rad between keyscans.
        submap_scans: Keyscans in a submap; the next one begins at half of them.
        closure_every: Keyscans from one search for closed loops to the next.
        closure_scans: Keyscans whose points are matched together in it.
        closure_candidates: Submaps that are tried in it.
        close_loops: Whether to search.
    """

    resolution: float = 0.05
    range_limit: float = 30.0
    empty_range: float = 10.0
    keyscan_distance: float = 0.25
    keyscan_angle: float = math.radians(15.0)
    submap_scans: int = 20
    closure_every: int = 4
    closure_scans: int = 8
    closure_candidates: int = 2
    close_loops: bool = True


class GraphSlam:
    """Graph SLAM, as in `wherry.mapping.slam.Slam`.

    Args:
        lidar: Where it is mounted, in the base_link frame.
        settings: What can be chosen.

    Attributes:
        keyscans: The scans that the map is made of.
        nodes: [K, 3] m, m, rad, map frame: base_link at each of them, as it is known now.
        closures: Every loop closure that was tried.
        edges: What was measured between keyscans.
        pieces: What the submaps are made of, in the order of their beginnings.
        ways: What is known between pieces, numbered as in ``pieces``.
        front: Where the robot is on the last of them.
        pending: How many accepted closures are not worked in yet.
        passed: Of every scan its time, the keyscan before it, and base_link in that keyscan's frame.
    """

    def __init__(self, lidar: Pose = IDENTITY, settings: GraphSlamSettings | None = None) -> None:
        self.settings = settings or GraphSlamSettings()
        self.lidar = lidar
        self.keyscans: list[Keyscan] = []
        self.nodes = np.zeros((0, 3))
        self.closures: list[Closure] = []
        self.edges = EdgeList()
        self.pieces: list[Piece] = []
        self.front: Front | None = None
        self.passed: list[tuple[float, int, Pose]] = []
        self.ways = EdgeList()
        self.pending = 0
        self._submaps = SubmapStore(self.keyscans)
        self._drawing = MapDrawing(
            lidar, self.settings.resolution, self.settings.range_limit, self.settings.empty_range
        )

    @property
    def pose(self) -> Pose:
        """base_link in the map frame, at the last scan."""
        if not self.passed:
            return IDENTITY
        _, node, offset = self.passed[-1]
        return self._node(node) @ offset

    @property
    def trajectory(self) -> Trajectory:
        """Where the robot was at each scan, as it is known now."""
        times = np.array([time for time, _, _ in self.passed])
        poses = [(self._node(node) @ offset).as_array() for _, node, offset in self.passed]
        return Trajectory(times, np.array(poses).reshape(-1, 3))

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map so far; see `wherry.mapping.slam.Slam.grid`."""
        return self._drawing.grid(self.keyscans, self.nodes, exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Take in a scan; see `wherry.mapping.slam.Slam.add`."""
        front = self.front
        if front is None:
            return self._begin(scan, odometry)
        movement, noise = front.expected_movement(scan.time, odometry)
        expected = front.pose @ movement
        if odometry is not None and is_within(movement, STILL_DISTANCE, STILL_ANGLE):
            self.passed.append((scan.time, front.key, expected.relative_to(front.key_pose)))
            return self.pose

        cloud = Cloud.of(scan, self.lidar, self.settings.range_limit)
        submap = self._submap(front.piece)
        since_key = expected.relative_to(front.key_pose)
        if is_within(since_key, self.settings.keyscan_distance, self.settings.keyscan_angle):
            match = track_scan(submap, cloud, expected, movement, noise)
            front = front.moved(scan.time, expected if match is None else match.pose, odometry)
        else:
            match = find_scan(submap, cloud, expected, movement, noise)
            front = self._keep(front, scan, cloud, expected if match is None else match.pose, match, odometry)
            if self.settings.close_loops and front.key % self.settings.closure_every == 0 and self._is_elsewhere():
                self._search_closures(front)
        self.front = front
        self.passed.append((scan.time, front.key, front.pose.relative_to(front.key_pose)))
        return self.pose

    def resume(self, scan: Scan, odometry: Odometry | None, pose: Pose) -> Pose:
        """Go on at another place, as at the beginning of another day's log; odometry may have started anew.

        Args:
            scan: The first one there, later than all before.
            odometry: Of its instant, if there is any.
            pose: base_link in the map frame, see `wherry.mapping.localizer.place_on_map`.

        Returns:
            The same pose.

        Raises:
            ValueError: There is no map yet.
        """
        if self.front is None:
            raise ValueError("there is no map to resume on before the first scan")
        last, key = len(self.pieces) - 1, len(self.keyscans)
        if self.front.piece < last:  # it would have been tracked next
            self._connect(self.front.piece)
        nearest = int(np.hypot(*(self.nodes[:, :2] - pose.as_array()[:2]).T).argmin())
        around = next(number for number, piece in enumerate(self.pieces) if piece.members[-1][0] >= nearest)
        self.edges.append(Edge(nearest, key, pose.relative_to(self._node(nearest)), RESUMED_COVARIANCE))
        way = pose.relative_to(self._node(self.pieces[around].origin))
        self.ways.append(Edge(around, last + 1, way, RESUMED_COVARIANCE))
        self.keyscans.append(Keyscan(scan, Cloud.of(scan, self.lidar, self.settings.range_limit)))
        self.nodes = np.vstack([self.nodes, pose.as_array()])
        self.pieces.append(Piece(key, members=[(key, IDENTITY)]))
        self.front = replace(Front.begin(scan.time, odometry), piece=last + 1, key=key)
        self.passed.append((scan.time, key, IDENTITY))
        return self.pose

    def finish(self) -> None:
        """Work in what has been measured and not yet been worked in; scans may be added afterwards."""
        if self.pending:
            self._optimize()

    def _begin(self, scan: Scan, odometry: Odometry | None) -> Pose:
        """Take in the first scan: its pose is the map's origin."""
        cloud = Cloud.of(scan, self.lidar, self.settings.range_limit)
        self.keyscans.append(Keyscan(scan, cloud))
        self.nodes = np.zeros((1, 3))
        self.pieces.append(Piece(0, members=[(0, IDENTITY)]))
        self.front = Front.begin(scan.time, odometry)
        self.passed.append((scan.time, 0, IDENTITY))
        return IDENTITY

    def _keep(
        self,
        front: Front,
        scan: Scan,
        cloud: Cloud,
        placed: Pose,
        match: Refinement | None,
        odometry: Odometry | None,
    ) -> Front:
        """Make a scan part of the map: a node, edges, and points in the submaps that grow."""
        key, origin = len(self.keyscans), self.pieces[front.piece].origin
        self.keyscans.append(Keyscan(scan, cloud))
        self.nodes = np.vstack([self.nodes, (self._node(origin) @ placed).as_array()])
        information = np.zeros((3, 3)) if match is None else turned(match.information, -placed.theta)
        if match is not None:
            self.edges.append(Edge(origin, key, placed, _covariance(information) + _roughness(placed)))
        noise = STEADY_MOTION
        if front.key_odometry is not None and odometry is not None:
            noise, since = ODOMETRY, odometry.pose.relative_to(front.key_odometry.pose)
            self.edges.append(Edge(front.key, key, since, noise.covariance(since)))
        elif match is None:
            since = placed.relative_to(front.key_pose)
            self.edges.append(Edge(front.key, key, since, noise.covariance(since)))
        front = front.moved(scan.time, placed, odometry).with_key(key, noise, information)
        return self._grow(front)

    def _grow(self, front: Front) -> Front:
        """Add the last keyscan to the submaps that grow: the one that is tracked, and its successor if there is one."""
        tracked = self.pieces[front.piece]
        tracked.members.append((front.key, front.key_pose))
        if front.piece < len(self.pieces) - 1:
            successor = self.pieces[-1]
            successor.members.append((front.key, front.key_pose.relative_to(successor.start)))
            if len(tracked.members) >= self.settings.submap_scans:
                self._connect(front.piece)
                return front.on_next(successor.start)
        elif len(tracked.members) >= self.settings.submap_scans // 2:
            self.pieces.append(Piece(front.key, front.key_pose, front.covariance, [(front.key, IDENTITY)]))
            return replace(front, next_covariance=NO_COVARIANCE)
        return front

    def _connect(self, piece: int) -> None:
        """Tell how the next piece begins on this one."""
        successor = self.pieces[piece + 1]
        covariance = successor.start_covariance + WAY_DOUBT * _roughness(successor.start)
        self.ways.append(Edge(piece, piece + 1, successor.start, covariance))

    def _submap(self, piece: int) -> Submap:
        """A piece's submap."""
        return self._submaps.of(piece, self.pieces[piece])

    def _is_elsewhere(self) -> bool:
        """Whether the robot has moved on since a search failed: in a wide window little news is none."""
        if not self.closures or self.closures[-1].accepted:
            return True
        steps = np.diff(self.nodes[self.closures[-1].node :, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum()) >= self.closures[-1].window / 2.0

    def _search_closures(self, front: Front) -> None:
        """Try to close loops from the last keyscan to the submaps that it may lie in."""
        candidates = self._candidates(front)
        if not candidates:
            return
        here = self._node(front.key)
        recent = range(max(front.key + 1 - self.settings.closure_scans, 0), front.key + 1)
        around = [self.keyscans[key].cloud.seen_from(self._node(key).relative_to(here)) for key in recent]
        surroundings = merged(around, CLOSURE_CELL)
        for number, covariance in candidates[: self.settings.closure_candidates]:
            piece = self.pieces[number]
            expected = self._node(front.key).relative_to(self._node(piece.origin))
            window = search_window(expected, covariance)
            closure = try_closure(front.time, front.key, piece.origin, self._submap(number), surroundings, window)
            self.closures.append(closure)
            if closure.accepted:
                self._close(front, number, closure)
                moved = closure.measured.relative_to(expected)
                if self.pending >= PENDING or not is_within(moved, SURPRISE, SURPRISE_ANGLE):
                    self._optimize()

    def _close(self, front: Front, piece: int, closure: Closure) -> None:
        """Take a closure of the last keyscan into the graph."""
        covariance = _covariance(turned(closure.information, -closure.measured.theta)) + CLOSURE_COVARIANCE
        self.edges.append(Edge(closure.target, closure.node, closure.measured, covariance, robust=True))
        way = closure.measured @ front.key_pose.inverse
        self.ways.append(Edge(piece, front.piece, way, carried(covariance, front.key_pose)))
        self.pending += 1

    def _candidates(self, front: Front) -> list[tuple[int, Floats]]:
        """The pieces that the last keyscan may lie in, nearest first, with the covariance [3, 3] of its pose there."""
        if front.piece < 2:
            return []
        covariances = relative_covariances(
            front.piece, len(self.pieces), self.ways.ends, self.ways.measured, self._way_covariances()
        )
        tried = self.pieces[: front.piece - 1]
        # Of the pieces as the robot sees them, turned into how the robot is seen from them, at the robot's place.
        here = np.tile(self.nodes[front.key], (len(tried), 1))
        origins = self.nodes[[piece.origin for piece in tried]]
        turns = np.zeros_like(here)
        turns[:, 2] = here[:, 2] - origins[:, 2]
        seen = carried_each(covariances[: len(tried)], relative(origins, here)) + front.covariance
        seen = carried_each(seen, turns)
        reach = SIGHT + 3.0 * np.sqrt(np.maximum(seen[:, 0, 0], seen[:, 1, 1]))
        away = np.hypot(*(self.nodes[:, :2] - self.nodes[front.key, :2]).T)
        nearest = np.array([away[piece.origin : piece.members[-1][0] + 1].min() for piece in tried])
        order = np.argsort(nearest, kind="stable")
        return [(int(number), seen[number]) for number in order[nearest[order] < reach[order]]]

    def _way_covariances(self) -> Floats:
        """[W, 3, 3] of the ways between pieces: the more uncertain, the less the map bears them out.

        A closure that the optimization does not believe must not make the next search narrow around the wrong place.
        """
        origins = self.nodes[[piece.origin for piece in self.pieces]]
        covariances = self.ways.covariances
        ways = PoseGraph(origins, self.ways.ends, self.ways.measured, inverse(covariances), self.ways.robust)
        doubt: Floats = 1.0 + (edge_errors(ways) / ROBUST_SCALE) ** 2  # the inverse of its weight under Cauchy's loss
        return doubt[:, None, None] * covariances

    def _optimize(self) -> None:
        """Bend the map so that it agrees best with everything that was measured."""
        self.pending = 0
        self.nodes = optimized(self.graph).poses

    @property
    def graph(self) -> PoseGraph:
        """The pose graph: keyscans and what was measured between them."""
        return PoseGraph(
            self.nodes,
            self.edges.ends,
            self.edges.measured,
            inverse(self.edges.covariances),
            self.edges.robust,
        )

    def _node(self, key: int) -> Pose:
        """base_link in the map frame, at a keyscan."""
        return Pose.from_array(self.nodes[key])


def _roughness(placed: Pose) -> Floats:
    """[3, 3] what no match on a submap is more exact than, at a pose on it."""
    way = math.hypot(placed.x, placed.y)
    distance = MATCH_DISTANCE + MATCH_DISTANCE_PER_DISTANCE * way
    angle = MATCH_ANGLE + MATCH_ANGLE_PER_DISTANCE * way
    return np.diag([distance**2, distance**2, angle**2])


def _covariance(information: Floats) -> Floats:
    """Covariance of an information matrix [3, 3] in which a direction may be empty."""
    return inverse(information + np.eye(3))
