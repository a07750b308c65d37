"""Transforms between the frames of a robot: links in space, the tree that they form, and the lidar's mount."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from wherry.robot import Scan
from wherry.space.pose import IDENTITY, Pose

MAX_LINKS = 10_000  # links of a tree
MAX_LINK_SHIFT = 0.01  # m, in x and y, by which a link may move and still count as fixed
MAX_LINK_TURN = 0.02  # rad, by which a link may turn and still count as fixed
MAX_MOUNT_TILT = 0.12  # rad, between the z axes of the lidar and base_link, or their opposites
MAX_FRAMES_NAMED = 6  # frames that an error lists

ODOMETRY_FRAME = re.compile(r"(?:^|[/_])odom(?:_combined|_ekf|_filtered|_raw)?$")
WORLD_FRAME = re.compile(r"(?:^|[/_])(?:map|world|earth)$")
BASE_FRAME = re.compile(r"(?:^|[/_])base_(?:link|footprint)$")

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Pair = tuple[str, str]  # parent and child frame


def is_odometry_frame(frame: str) -> bool:
    """Whether a frame has the name of one in which odometry is given, with or without a prefix."""
    return ODOMETRY_FRAME.search(frame) is not None


def is_base_frame(frame: str) -> bool:
    """Whether a frame has one of the names of the robot's frame in REP 105 and REP 120, with or without a prefix."""
    return BASE_FRAME.search(frame) is not None


def is_world_frame(frame: str) -> bool:
    """Whether a frame has the name of one in which the robot moves, with or without a prefix."""
    return is_odometry_frame(frame) or WORLD_FRAME.search(frame) is not None


class MountError(ValueError):
    """A mount that cannot be used; the text is a clause such as "the transform a → b moves"."""


@dataclass(frozen=True, slots=True)
class StampedTransform:
    """One edge of the tf tree, in the plane.

    Attributes:
        parent: Name of the parent frame, without a leading slash.
        child: Name of the child frame, without a leading slash.
        time: Time from which the transform holds, s.
        pose: Pose of the child frame in the parent frame.
    """

    parent: str
    child: str
    time: float
    pose: Pose


@dataclass(frozen=True, slots=True)
class RigidTransform:
    """A rotation and a translation in space, SE(3).

    Attributes:
        translation: x, y, z of the child frame in the parent frame, m.
        rotation: Unit quaternion x, y, z, w of the child frame in the parent frame.
    """

    translation: Vector = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        """Compose: ``a_from_b @ b_from_c`` is ``a_from_c``."""
        (x, y, z), (dx, dy, dz) = self.rotate(other.translation), self.translation
        return RigidTransform((x + dx, y + dy, z + dz), _product(self.rotation, other.rotation))

    @property
    def inverse(self) -> RigidTransform:
        """The inverse transform."""
        x, y, z, w = self.rotation
        back = RigidTransform(rotation=(-x, -y, -z, w))
        tx, ty, tz = back.rotate(self.translation)
        return RigidTransform((-tx, -ty, -tz), back.rotation)

    def rotate(self, vector: Vector) -> Vector:
        """A vector of the child frame in the axes of the parent frame."""
        x, y, z, w = self.rotation
        turned = _product(_product(self.rotation, (*vector, 0.0)), (-x, -y, -z, w))
        return turned[:3]

    def difference(self, other: RigidTransform) -> tuple[float, float]:
        """Distance in the x-y plane, m, and angle, rad, between two transforms."""
        shift = math.hypot(self.translation[0] - other.translation[0], self.translation[1] - other.translation[1])
        x, y, z, w = self.rotation
        turn = _product((-x, -y, -z, w), other.rotation)
        return shift, 2.0 * math.atan2(math.hypot(*turn[:3]), abs(turn[3]))


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The Hamilton product of two quaternions x, y, z, w."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@dataclass(frozen=True, slots=True)
class Mount:
    """How a lidar sits on the robot.

    Attributes:
        pose: The lidar in the base_link frame; of a lidar upside down, its frame turned upright about its x axis.
        is_upside_down: Whether the lidar hangs upside down, so that its beams turn the other way.
    """

    pose: Pose = IDENTITY
    is_upside_down: bool = False

    @classmethod
    def from_transform(cls, transform: RigidTransform) -> Mount:
        """The mount of a lidar at a transform from base_link.

        Raises:
            MountError: The lidar is tilted.
        """
        upwards = transform.rotate((0.0, 0.0, 1.0))[2]
        tilt = math.acos(min(max(upwards, -1.0), 1.0))
        is_upside_down = tilt > math.pi / 2.0
        if min(tilt, math.pi - tilt) > MAX_MOUNT_TILT:
            raise MountError(f"it is tilted by {math.degrees(tilt):.0f}°, and only a level scan can be used")
        forwards = transform.rotate((1.0, 0.0, 0.0))
        x, y, _ = transform.translation
        return cls(Pose(x, y, math.atan2(forwards[1], forwards[0])), is_upside_down)

    def upright(self, scan: Scan) -> Scan:
        """A scan as a lidar upright at ``pose`` measures it."""
        return scan.mirrored() if self.is_upside_down else scan

    def __str__(self) -> str:
        """x, y, θ as the option ``--lidar`` takes them, m, m, degrees."""
        numbers = f"{self.pose.x:.3f},{self.pose.y:.3f},{math.degrees(self.pose.theta):.1f}"
        return f"{numbers} upside down" if self.is_upside_down else numbers


@dataclass(slots=True)
class Link:
    """A transform that was received at least once.

    Attributes:
        parent: Name of the parent frame.
        child: Name of the child frame.
        transform: The first transform received.
        shift: Largest distance of later ones from it in x and y, m.
        turn: Largest angle of later ones from it, rad.
    """

    parent: str
    child: str
    transform: RigidTransform
    shift: float = 0.0
    turn: float = 0.0

    @property
    def is_fixed(self) -> bool:
        """Whether all transforms received are the same but for vibration."""
        return self.shift <= MAX_LINK_SHIFT and self.turn <= MAX_LINK_TURN

    def update(self, transform: RigidTransform) -> None:
        """Take a later transform into account."""
        if transform == self.transform:
            return
        shift, turn = self.transform.difference(transform)
        self.shift, self.turn = max(self.shift, shift), max(self.turn, turn)

    def from_frame(self, frame: str) -> RigidTransform:
        """The transform from one end of the link to the other."""
        return self.transform if frame == self.parent else self.transform.inverse


class TransformTree:
    """The frames of a robot and the transforms between them, static and changing ones."""

    def __init__(self) -> None:
        self._links: dict[Pair, Link] = {}
        self._rejected: dict[Pair, tuple[str, str]] = {}

    @property
    def frames(self) -> set[str]:
        """Names of all frames."""
        return {frame for pair in self._links for frame in pair}

    @property
    def all_frames(self) -> set[str]:
        """Names of all frames, including those of unusable transforms only."""
        return self.frames | {frame for pair in self._rejected for frame in pair}

    @property
    def links(self) -> tuple[Link, ...]:
        """All links, in the order in which they were received first."""
        return tuple(self._links.values())

    def add(self, parent: str, child: str, transform: RigidTransform) -> None:
        """Add a transform of a frame in its parent frame; links beyond `MAX_LINKS` are ignored."""
        link = self._links.get((parent, child))
        if link is not None:
            link.update(transform)
        elif len(self._links) < MAX_LINKS:
            self._links[parent, child] = Link(parent, child, transform)

    def reject(self, parent: str, child: str, name: str, reason: str) -> None:
        """Remember the first unusable transform of a frame in its parent frame: name of the message, and reason."""
        if len(self._rejected) < MAX_LINKS:
            self._rejected.setdefault((parent, child), (name, reason))

    def add_all(self, other: TransformTree) -> None:
        """Add the links of another tree."""
        self._rejected = {**other._rejected, **self._rejected}
        for link in other.links:
            self.add(link.parent, link.child, link.transform)
            mine = self._links.get((link.parent, link.child))
            if mine is not None:
                mine.shift, mine.turn = max(mine.shift, link.shift), max(mine.turn, link.turn)

    def chain(self, base: str, frame: str, is_world: Callable[[str], bool] = is_world_frame) -> list[Link] | None:
        """The links from a frame to another, up and down the tree; None if they are not connected.

        Args:
            base: Frame to start from.
            frame: Frame to reach.
            is_world: Whether a frame is one in which the robot moves, which the links must not pass.
        """
        reached = self._reached_from(base, is_world)
        return list(_path(reached, frame)) if frame in reached else None

    def rejected_between(
        self, base: str, frame: str, is_world: Callable[[str], bool] = is_world_frame
    ) -> list[tuple[str, str]]:
        """Name and reason of the unusable transforms on the way that `chain` goes, or would go if they were usable."""
        tree = self
        if self.chain(base, frame, is_world) is None:
            tree = TransformTree()
            tree.add_all(self)
            for pair in self._rejected:
                tree.add(*pair, RigidTransform())
        pairs = [(link.parent, link.child) for link in tree.chain(base, frame, is_world) or ()]
        return [self._rejected[pair] for pair in pairs if pair in self._rejected]

    def lookup(self, base: str, frame: str, is_world: Callable[[str], bool] = is_world_frame) -> RigidTransform | None:
        """The transform of a frame in a base frame; None while they are not connected.

        Args:
            base: Frame of the robot.
            frame: Frame fixed to it.
            is_world: As for `chain`.

        Raises:
            MountError: A transform between them moves, or two ways between them disagree.
        """
        reached = self._reached_from(base, is_world)
        if frame not in reached:
            return None
        path = list(_path(reached, frame))
        for link in path:
            if not link.is_fixed:
                raise MountError(
                    f"the transform {link.parent} → {link.child} moves by {link.shift:.2f} m and "
                    f"{math.degrees(link.turn):.0f}°"
                )
        self._check_loops(reached, path)
        return _composed(path, base)

    def _reached_from(self, base: str, is_world: Callable[[str], bool]) -> dict[str, Link | None]:
        """All frames that are connected to a frame, each with the link that reaches it (breadth-first search)."""
        neighbours: dict[str, list[Link]] = {}
        for link in self._links.values():
            if not (is_world(link.parent) or is_world(link.child)):
                neighbours.setdefault(link.parent, []).append(link)
                neighbours.setdefault(link.child, []).append(link)
        reached: dict[str, Link | None] = {base: None}
        queue = deque([base])
        while queue:
            frame = queue.popleft()
            for link in neighbours.get(frame, ()):
                other = link.child if frame == link.parent else link.parent
                if other not in reached:
                    reached[other] = link
                    queue.append(other)
        return reached

    def _check_loops(self, reached: dict[str, Link | None], path: list[Link]) -> None:
        """Check that links which close a loop with the path agree with it.

        Raises:
            MountError: One disagrees.
        """
        on_path = {id(link) for link in path}
        used = {id(link) for link in reached.values() if link is not None}
        for link in self._links.values():
            if id(link) in used or link.parent not in reached or link.child not in reached:
                continue
            one, two = list(_path(reached, link.parent)), list(_path(reached, link.child))
            if not on_path & ({id(step) for step in one} ^ {id(step) for step in two}):
                continue
            base = next(frame for frame, step in reached.items() if step is None)
            around = _composed(one, base) @ link.transform
            shift, turn = around.difference(_composed(two, base))
            if shift > MAX_LINK_SHIFT or turn > MAX_LINK_TURN or not link.is_fixed:
                raise MountError(f"the transform {link.parent} → {link.child} contradicts the others between them")


def _path(reached: dict[str, Link | None], frame: str) -> Iterator[Link]:
    """The links from the base frame to a frame that was reached."""
    links: list[Link] = []
    link = reached[frame]
    while link is not None:
        links.append(link)
        frame = link.parent if frame == link.child else link.child
        link = reached[frame]
    return reversed(links)


def _composed(path: Iterable[Link], frame: str) -> RigidTransform:
    """The transform along links that begin at a frame."""
    composed = RigidTransform()
    for link in path:
        composed = composed @ link.from_frame(frame)
        frame = link.child if frame == link.parent else link.parent
    return composed


def resolve_frame(name: str, frames: Iterable[str], prefix: str = "") -> str | None:
    """The frame of a tree that a message means: drivers may leave the prefix out that others write, or reverse.

    Args:
        name: Name of the frame in the message.
        frames: Frames of the tree.
        prefix: Prefix of the robot's frames, such as "robot1", if several frames match.

    Returns:
        The frame of that name, else the only one that differs by a prefix; None if there is none.
    """
    name = name.strip("/")
    known = set(frames)
    if name in known or not name:
        return name or None
    similar = sorted(frame for frame in known if frame.endswith(f"/{name}") or name.endswith(f"/{frame}"))
    if len(similar) > 1 and prefix:
        similar = [frame for frame in similar if frame.startswith(f"{prefix.strip('/')}/")]
    return similar[0] if len(similar) == 1 else None


def listed_frames(frames: Iterable[str]) -> str:
    """Names of frames for an error."""
    names = sorted(frames)
    listed = ", ".join(names[:MAX_FRAMES_NAMED])
    return f"{listed}, … ({len(names)} frames)" if len(names) > MAX_FRAMES_NAMED else listed or "none"
