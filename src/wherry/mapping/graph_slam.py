"""Graph SLAM: scans are matched to the submap that grows around the robot; closed loops bend the whole map straight.

The front end places each scan on the present submap, so it is never disturbed; the back end moves the submaps (Hess et
al. 2016). A submap lies in the frame of its first keyscan, so that nodes of the pose graph are keyscans only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from wherry.mapping.closures import Closure, search_window, try_closure
from wherry.mapping.cloud import Cloud, merged
from wherry.mapping.correlative import Window, correlate
from wherry.mapping.keyscans import Keyscan, MapDrawing
from wherry.mapping.motion_prior import ODOMETRY, STEADY_MOTION, MotionNoise
from wherry.mapping.pose_graph import PoseGraph, optimized
from wherry.mapping.refinement import Refinement, refine
from wherry.mapping.slam import NO_DISCS
from wherry.mapping.submap import Submap
from wherry.space.trajectory import Trajectory
from wherry.mapping.uncertainty import relative_covariances
from wherry.robot import Odometry, Scan
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import IDENTITY, Floats, Pose

LEAST_POINTS = 20  # fewer tell nothing
LEAST_RESPONSE = 0.25  # of a keyscan's match; below, odometry is believed
LEAST_MATCHED = 0.25
TRACKED_MATCHED = 0.5  # between keyscans, where a match starts from odometry alone
STILL_DISTANCE = 0.005  # m; a scan that was taken nearer to the last one than this is not matched
STILL_ANGLE = math.radians(0.2)
SEARCHED = 3.0  # σ of odometry that are searched
POINTS = 180  # of a scan, for finding its place
# Matches are less exact than their points are: surfaces are rough, scans are not taken in an instant.
MATCH_DISTANCE, MATCH_DISTANCE_PER_DISTANCE = 0.01, 0.005  # m, m per m from the submap's origin
MATCH_ANGLE, MATCH_ANGLE_PER_DISTANCE = math.radians(0.2), math.radians(0.03)  # rad, rad per m
CLOSURE_DISTANCE, CLOSURE_ANGLE = 0.02, math.radians(0.3)  # m and rad likewise, of closures
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


@dataclass
class _Piece:
    """A submap and the keyscans in it.

    Attributes:
        origin: The keyscan in whose frame it is.
        start: Pose of that keyscan in the frame of the piece before.
        submap: The map.
        members: Its keyscans.
    """

    origin: int
    start: Pose
    submap: Submap = field(default_factory=Submap)
    members: list[int] = field(default_factory=list)


@dataclass(frozen=True)
class _Edge:
    """What was measured between two nodes: pose of ``second`` in ``first``, and its covariance there [3, 3]."""

    first: int
    second: int
    measured: Pose
    covariance: Floats
    robust: bool = False


class GraphSlam:
    """Graph SLAM, as in `wherry.mapping.slam.Slam`.

    Args:
        lidar: Where it is mounted, in the base_link frame.
        settings: What can be chosen.

    Attributes:
        keyscans: The scans that the map is made of.
        nodes: [K, 3] m, m, rad, map frame: base_link at each of them, as it is known now.
        closures: Every loop closure that was tried.
    """

    def __init__(self, lidar: Pose = IDENTITY, settings: GraphSlamSettings | None = None) -> None:
        self.settings = settings or GraphSlamSettings()
        self.keyscans: list[Keyscan] = []
        self.nodes = np.zeros((0, 3))
        self.closures: list[Closure] = []
        self._lidar = lidar
        self._drawing = MapDrawing(
            lidar, self.settings.resolution, self.settings.range_limit, self.settings.empty_range
        )
        self._pieces: list[_Piece] = []
        self._edges: list[_Edge] = []  # between keyscans
        self._ways: list[_Edge] = []  # between pieces
        self._tracked_piece = 0
        self._homes: list[tuple[int, Pose]] = []  # of every keyscan: the piece that it was placed on, and where
        self._pending = 0
        self._front: _Front | None = None
        self._passed: list[tuple[float, int, Pose]] = []  # of every scan: time, keyscan, pose in the keyscan's frame

    @property
    def pose(self) -> Pose:
        """base_link in the map frame, at the last scan."""
        if not self._passed:
            return IDENTITY
        _, node, offset = self._passed[-1]
        return self._node(node) @ offset

    @property
    def trajectory(self) -> Trajectory:
        """Where the robot was at each scan, as it is known now."""
        times = np.array([time for time, _, _ in self._passed])
        poses = [(self._node(node) @ offset).as_array() for _, node, offset in self._passed]
        return Trajectory(times, np.array(poses).reshape(-1, 3))

    def grid(self, exclude: Floats = NO_DISCS) -> OccupancyGrid:
        """The map so far; see `wherry.mapping.slam.Slam.grid`."""
        return self._drawing.grid(self.keyscans, self.nodes, exclude)

    def add(self, scan: Scan, odometry: Odometry | None = None) -> Pose:
        """Take in a scan; see `wherry.mapping.slam.Slam.add`."""
        if self._front is None:
            return self._begin(scan, odometry)
        front = self._front
        movement, noise = front.expected_movement(scan.time, odometry)
        expected = front.pose @ movement
        if odometry is not None and _is_within(movement, STILL_DISTANCE, STILL_ANGLE):
            self._passed.append((scan.time, front.key, expected.relative_to(front.key_pose)))
            return self.pose

        cloud = Cloud.of(scan, self._lidar, self.settings.range_limit)
        since_key = expected.relative_to(front.key_pose)
        is_key = not _is_within(since_key, self.settings.keyscan_distance, self.settings.keyscan_angle)
        match = self._match(cloud, expected, movement, noise, search=is_key)
        placed = expected if match is None else match.pose
        if is_key:
            self._keep(scan, cloud, placed, match, odometry)
        else:
            self._front = front.moved(scan.time, placed, odometry)
        self._passed.append((scan.time, self._front.key, self._front.pose.relative_to(self._front.key_pose)))
        return self.pose

    def finish(self) -> None:
        """Work in what has been measured and not yet been worked in; scans may be added afterwards."""
        if self._pending:
            self._optimize()

    def _begin(self, scan: Scan, odometry: Odometry | None) -> Pose:
        """Take in the first scan: its pose is the map's origin."""
        self._pieces.append(_Piece(0, IDENTITY))
        self._front = _Front(scan.time, IDENTITY, odometry, np.zeros(3), 0, IDENTITY, odometry)
        cloud = Cloud.of(scan, self._lidar, self.settings.range_limit)
        self.keyscans.append(Keyscan(scan, cloud))
        self.nodes = np.zeros((1, 3))
        self._homes.append((0, IDENTITY))
        self._pieces[0].submap.add(cloud)
        self._pieces[0].members.append(0)
        self._passed.append((scan.time, 0, IDENTITY))
        return IDENTITY

    def _match(
        self, cloud: Cloud, expected: Pose, movement: Pose, noise: MotionNoise, *, search: bool
    ) -> Refinement | None:
        """Place a scan on the submap that is tracked; None if it does not fit anywhere near.

        Args:
            cloud: The scan.
            expected: Its expected pose, in the submap's frame.
            movement: Since the scan before.
            noise: Of the movement.
            search: Whether to search all around the expected pose, not only to refine it.
        """
        if len(cloud.points) < LEAST_POINTS:
            return None
        submap, start = self._tracked.submap, expected
        distance, angle = noise.deviations(movement)
        if search:
            window = Window(expected, SEARCHED * distance, SEARCHED * angle)
            found = correlate(submap, cloud.thinned(POINTS).points, window)
            if found.response < LEAST_RESPONSE:
                return None
            start = found.pose
        match = refine(submap, cloud, start, expected=expected, prior=noise.information(movement))
        enough = LEAST_MATCHED if search else TRACKED_MATCHED
        if match.matched < enough or match.pose.distance_to(start) > SEARCHED * distance:
            return None
        return match

    def _keep(
        self, scan: Scan, cloud: Cloud, placed: Pose, match: Refinement | None, odometry: Odometry | None
    ) -> None:
        """Make a scan part of the map: a node, edges, and points in the submaps that grow."""
        assert self._front is not None
        front, key = self._front, len(self.keyscans)
        tracked = self._tracked
        self.keyscans.append(Keyscan(scan, cloud))
        self.nodes = np.vstack([self.nodes, (self._node(tracked.origin) @ placed).as_array()])
        self._homes.append((self._tracked_piece, placed))
        if match is not None:
            self._edges.append(_Edge(tracked.origin, key, placed, _match_covariance(match, placed)))
        if front.key_odometry is not None and odometry is not None:
            since = odometry.pose.relative_to(front.key_odometry.pose)
            self._edges.append(_Edge(front.key, key, since, np.linalg.inv(ODOMETRY.information(since))))
        elif match is None:
            since = placed.relative_to(front.key_pose)
            self._edges.append(_Edge(front.key, key, since, np.linalg.inv(STEADY_MOTION.information(since))))
        self._front = front.moved(scan.time, placed, odometry).with_key(key)
        self._grow(key, cloud, placed)
        if self.settings.close_loops and key % self.settings.closure_every == 0:
            self._search_closures(scan.time)

    def _grow(self, key: int, cloud: Cloud, placed: Pose) -> None:
        """Add a keyscan to the submaps that grow: the one that is tracked, and its successor when there is one."""
        assert self._front is not None
        tracked = self._tracked
        tracked.submap.add(cloud.seen_from(placed))
        tracked.members.append(key)
        half = self.settings.submap_scans // 2
        if self._tracked_piece < len(self._pieces) - 1:
            successor = self._pieces[-1]
            offset = placed.relative_to(successor.start)
            successor.submap.add(cloud.seen_from(offset))
            successor.members.append(key)
            if len(tracked.members) >= self.settings.submap_scans:
                covariance = _match_covariance(None, successor.start)
                self._ways.append(_Edge(self._tracked_piece, self._tracked_piece + 1, successor.start, covariance))
                self._front = self._front.seen_from(successor.start)
                self._tracked_piece += 1
        elif len(tracked.members) >= half:
            successor = _Piece(key, placed)
            successor.submap.add(cloud)
            successor.members.append(key)
            self._pieces.append(successor)

    def _search_closures(self, time: float) -> None:
        """Try to close loops from the last keyscan to the submaps that it may lie in."""
        key = len(self.keyscans) - 1
        here, placed = self._homes[key]
        candidates = self._candidates(key)
        if not candidates:
            return
        recent = range(max(key + 1 - self.settings.closure_scans, 0), key + 1)
        here_pose = self._node(key)
        surroundings = merged(
            [self.keyscans[k].cloud.seen_from(self._node(k).relative_to(here_pose)) for k in recent], CLOSURE_CELL
        )
        for piece, covariance in candidates[: self.settings.closure_candidates]:
            target = self._pieces[piece].origin
            expected = here_pose.relative_to(self._node(target))
            closure = try_closure(
                time, key, target, self._pieces[piece].submap, surroundings, search_window(expected, covariance)
            )
            self.closures.append(closure)
            if closure.accepted:
                sure = _closure_covariance(closure)
                self._edges.append(_Edge(target, key, closure.measured, sure, robust=True))
                self._ways.append(_Edge(piece, here, closure.measured @ placed.inverse, sure))
                self._pending += 1
                correction = closure.measured.relative_to(expected)
                if self._pending >= PENDING or not _is_within(correction, SURPRISE, SURPRISE_ANGLE):
                    self._optimize()

    def _candidates(self, key: int) -> list[tuple[int, Floats]]:
        """The pieces that a keyscan may lie in, nearest first, with the covariance [3, 3] of its pose in each."""
        here = self._homes[key][0]
        if here < 2 or not self._ways:
            return []
        covariances = relative_covariances(
            here,
            len(self._pieces),
            np.array([[way.first, way.second] for way in self._ways]),
            np.array([way.measured.as_array() for way in self._ways]),
            np.array([way.covariance for way in self._ways]),
        )
        found = []
        for piece in range(here - 1):
            reach = 3.0 * math.sqrt(max(covariances[piece, 0, 0], covariances[piece, 1, 1]))
            members = self.nodes[self._pieces[piece].members, :2]
            nearest = float(np.hypot(*(members - self.nodes[key, :2]).T).min())
            if nearest < SIGHT + reach:
                seen = self._node(key).relative_to(self._node(self._pieces[piece].origin))
                lever = np.array([[1.0, 0.0, -seen.y], [0.0, 1.0, seen.x], [0.0, 0.0, 1.0]])
                found.append((nearest, piece, lever @ covariances[piece] @ lever.T))
        return [(piece, covariance) for _, piece, covariance in sorted(found, key=lambda entry: entry[:2])]

    def _optimize(self) -> None:
        """Bend the map so that it agrees best with everything that was measured."""
        self._pending = 0
        graph = PoseGraph(
            self.nodes,
            np.array([[edge.first, edge.second] for edge in self._edges]),
            np.array([edge.measured.as_array() for edge in self._edges]),
            np.array([_information_in_second(edge) for edge in self._edges]),
            np.array([edge.robust for edge in self._edges]),
        )
        self.nodes = optimized(graph).poses

    @property
    def _tracked(self) -> _Piece:
        """The piece that scans are placed on."""
        return self._pieces[self._tracked_piece]

    def _node(self, key: int) -> Pose:
        """base_link in the map frame, at a keyscan."""
        return Pose.from_array(self.nodes[key])


@dataclass(frozen=True)
class _Front:
    """Where the robot is on the submap that is tracked.

    Attributes:
        time: s, of the scan that was placed last.
        pose: base_link then, in the submap's frame.
        odometry: Of that instant.
        rate: [3] m/s, m/s, rad/s in the base_link frame: how it moved up to then.
        key: The last keyscan.
        key_pose: base_link there, in the submap's frame.
        key_odometry: Of that instant.
    """

    time: float
    pose: Pose
    odometry: Odometry | None
    rate: Floats
    key: int
    key_pose: Pose
    key_odometry: Odometry | None

    def expected_movement(self, time: float, odometry: Odometry | None) -> tuple[Pose, MotionNoise]:
        """How base_link has moved since, and how sure that is."""
        if odometry is not None and self.odometry is not None:
            return odometry.pose.relative_to(self.odometry.pose), ODOMETRY
        return Pose.from_array(self.rate * (time - self.time)), STEADY_MOTION

    def moved(self, time: float, pose: Pose, odometry: Odometry | None) -> _Front:
        """The same, later."""
        movement = pose.relative_to(self.pose).as_array()
        rate = movement / max(time - self.time, 1e-3)
        return replace(self, time=time, pose=pose, odometry=odometry, rate=rate)

    def with_key(self, key: int) -> _Front:
        """The same, with a keyscan made here."""
        return replace(self, key=key, key_pose=self.pose, key_odometry=self.odometry)

    def seen_from(self, origin: Pose) -> _Front:
        """The same, in another submap's frame, whose origin is given in this one's."""
        return replace(self, pose=self.pose.relative_to(origin), key_pose=self.key_pose.relative_to(origin))


def _is_within(movement: Pose, distance: float, angle: float) -> bool:
    """Whether a movement is shorter than a distance, m, and turns by less than an angle, rad."""
    return math.hypot(movement.x, movement.y) < distance and abs(movement.theta) < angle


def _match_covariance(match: Refinement | None, placed: Pose) -> Floats:
    """[3, 3] of a scan's pose on a submap: what its points leave open, and what no match is more exact than."""
    way = math.hypot(placed.x, placed.y)
    distance = MATCH_DISTANCE + MATCH_DISTANCE_PER_DISTANCE * way
    angle = MATCH_ANGLE + MATCH_ANGLE_PER_DISTANCE * way
    least = np.diag([distance**2, distance**2, angle**2])
    return least if match is None else least + _inverse(match.information)


def _closure_covariance(closure: Closure) -> Floats:
    """[3, 3] of a closure's measurement, likewise."""
    return np.diag([CLOSURE_DISTANCE**2, CLOSURE_DISTANCE**2, CLOSURE_ANGLE**2]) + _inverse(closure.information)


def _inverse(information: Floats) -> Floats:
    """Covariance of an information matrix in which a direction may be empty."""
    inverse: Floats = np.linalg.inv(information + np.eye(3))
    return inverse


def _information_in_second(edge: _Edge) -> Floats:
    """An edge's information with its axes turned into the second node's frame, as `PoseGraph` has it."""
    cos, sin = math.cos(edge.measured.theta), math.sin(edge.measured.theta)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    information: Floats = np.linalg.inv(turn @ edge.covariance @ turn.T)
    return information
