"""What graph SLAM remembers between scans: pieces of map, what was measured between them, and where the robot is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from wherry.mapping.keyscans import Keyscan
from wherry.mapping.motion_prior import ODOMETRY, STEADY_MOTION, MotionNoise
from wherry.mapping.submap import Submap
from wherry.mapping.uncertainty import carried, inverse
from wherry.robot import Odometry
from wherry.space.pose import IDENTITY, Floats, Pose

NO_COVARIANCE = np.zeros((3, 3))
STEADY, STEADY_ANGLE = 2.0, math.radians(60.0)  # m and rad; no robot moves on as it did for longer than that
ROOM = 512 * 2**20  # bytes, of submaps


@dataclass(frozen=True)
class Edge:
    """What was measured between two nodes.

    Attributes:
        first: A node.
        second: Another.
        measured: Pose of the second in the frame of the first.
        covariance: [3, 3] of that, in the frame of the second: m, m, rad.
        robust: Whether it might be wrong.
    """

    first: int
    second: int
    measured: Pose
    covariance: Floats
    robust: bool = False


class EdgeList:
    """Edges as arrays that grow; reading them costs nothing, however many there are."""

    def __init__(self) -> None:
        self._count = 0
        self._ends = np.zeros((0, 2), np.int64)
        self._measured = np.zeros((0, 3))
        self._covariances = np.zeros((0, 3, 3))
        self._robust = np.zeros(0, np.bool_)

    def __len__(self) -> int:
        return self._count

    def append(self, edge: Edge) -> None:
        """Add an edge."""
        if self._count == len(self._ends):
            room = max(self._count, 64)
            self._ends = np.concatenate([self._ends, np.zeros((room, 2), np.int64)])
            self._measured = np.concatenate([self._measured, np.zeros((room, 3))])
            self._covariances = np.concatenate([self._covariances, np.zeros((room, 3, 3))])
            self._robust = np.concatenate([self._robust, np.zeros(room, np.bool_)])
        self._ends[self._count] = edge.first, edge.second
        self._measured[self._count] = edge.measured.as_array()
        self._covariances[self._count] = edge.covariance
        self._robust[self._count] = edge.robust
        self._count += 1

    @property
    def ends(self) -> NDArray[np.int64]:
        """[E, 2] the first and the second node."""
        return self._ends[: self._count]

    @property
    def measured(self) -> Floats:
        """[E, 3] m, m, rad: pose of the second in the frame of the first."""
        return self._measured[: self._count]

    @property
    def covariances(self) -> Floats:
        """[E, 3, 3] of that, in the frame of the second."""
        return self._covariances[: self._count]

    @property
    def robust(self) -> NDArray[np.bool_]:
        """[E] whether an edge might be wrong."""
        return self._robust[: self._count]


@dataclass
class Piece:
    """The keyscans of a submap; they follow one another.

    Attributes:
        origin: The keyscan in whose frame it is, the first of them.
        start: Pose of that keyscan in the frame of the piece before.
        start_covariance: [3, 3] of that, in the keyscan's frame.
        members: Its keyscans, with their poses in it.
    """

    origin: int
    start: Pose = IDENTITY
    start_covariance: Floats = field(default_factory=lambda: NO_COVARIANCE)
    members: list[tuple[int, Pose]] = field(default_factory=list)


class SubmapStore:
    """The submaps of pieces. Those that were not asked for lately are dropped, and made again when they are.

    Submaps are the bulk of a large site: a square around each place that the robot passed, and they overlap. What they
    follow from, the points of their scans, is much smaller.

    Args:
        keyscans: The clouds of all keyscans, which grow outside.
        room: Bytes that submaps may take, the one asked for last not counted.
    """

    def __init__(self, keyscans: Sequence[Keyscan], room: int = ROOM) -> None:
        self._keyscans = keyscans
        self._room = room
        self._submaps: dict[int, Submap] = {}  # by piece, the one asked for last comes last

    def of(self, number: int, piece: Piece) -> Submap:
        """A piece's submap, with all its members in it."""
        submap = self._submaps.pop(number, None)
        if submap is None:
            self._make_room()
            submap = Submap()
        self._submaps[number] = submap
        for key, placed in piece.members[submap.scans :]:
            submap.add(self._keyscans[key].cloud.seen_from(placed))
        return submap

    def _make_room(self) -> None:
        """Drop submaps, those first that were not asked for longest."""
        taken = sum(submap.nbytes for submap in self._submaps.values())
        while taken > self._room:
            taken -= self._submaps.pop(next(iter(self._submaps))).nbytes


@dataclass(frozen=True)
class Front:
    """Where the robot is on the piece that is tracked.

    Attributes:
        piece: The piece.
        time: s, of the scan that was placed last.
        pose: base_link then, in the piece's frame.
        odometry: Of that instant.
        rate: [3] m/s, m/s, rad/s in the base_link frame: how it moved up to then.
        key: The last keyscan.
        key_pose: base_link there, in the piece's frame.
        key_odometry: Of that instant.
        covariance: [3, 3] of ``key_pose``, in the base_link frame.
        next_covariance: Likewise, of its pose in the piece that will be tracked next.
    """

    piece: int
    time: float
    pose: Pose
    odometry: Odometry | None
    rate: Floats
    key: int
    key_pose: Pose
    key_odometry: Odometry | None
    covariance: Floats
    next_covariance: Floats

    @classmethod
    def begin(cls, time: float, odometry: Odometry | None) -> Front:
        """At the first scan, which is the first keyscan and the origin of the first piece."""
        return cls(0, time, IDENTITY, odometry, np.zeros(3), 0, IDENTITY, odometry, NO_COVARIANCE, NO_COVARIANCE)

    def expected_movement(self, time: float, odometry: Odometry | None) -> tuple[Pose, MotionNoise]:
        """How base_link has moved since the last scan, and how sure that is.

        Without odometry it is expected to move on as it did, but over a gap in the log no farther than `STEADY`.
        """
        if odometry is not None and self.odometry is not None:
            return odometry.pose.relative_to(self.odometry.pose), ODOMETRY
        moved = self.rate * (time - self.time)
        share = max(math.hypot(moved[0], moved[1]) / STEADY, abs(moved[2]) / STEADY_ANGLE, 1.0)
        return Pose.from_array(moved / share), STEADY_MOTION

    def moved(self, time: float, pose: Pose, odometry: Odometry | None) -> Front:
        """The same, one scan later."""
        passed = time - self.time
        rate = pose.relative_to(self.pose).as_array() / passed if passed > 0.0 else self.rate
        return replace(self, time=time, pose=pose, odometry=odometry, rate=rate)

    def with_key(self, key: int, noise: MotionNoise, information: Floats) -> Front:
        """The same, with a keyscan made here.

        Args:
            key: The keyscan.
            noise: Of the movement since the one before.
            information: [3, 3] what its match says about the pose, in the base_link frame.
        """
        movement = self.pose.relative_to(self.key_pose)
        added = noise.covariance(movement)

        def spread(covariance: Floats) -> Floats:
            # As in a Kalman filter: the movement adds what is uncertain, the match takes away.
            expected = carried(covariance, movement.inverse) + added
            return inverse(inverse(expected) + information) + LEAST_COVARIANCE

        return replace(
            self,
            key=key,
            key_pose=self.pose,
            key_odometry=self.odometry,
            covariance=spread(self.covariance),
            next_covariance=spread(self.next_covariance),
        )

    def on_next(self, start: Pose) -> Front:
        """The same, tracked on the next piece, which starts at a pose in this one's frame."""
        return replace(
            self,
            piece=self.piece + 1,
            pose=self.pose.relative_to(start),
            key_pose=self.key_pose.relative_to(start),
            covariance=self.next_covariance,
        )


# A match is never more exact than this, for surfaces are rough and scans are not taken in an instant: m, m, rad.
LEAST_COVARIANCE = np.diag([0.003**2, 0.003**2, math.radians(0.1) ** 2])
