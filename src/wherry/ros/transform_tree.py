"""The tree of a robot's frames, followed as tf2 does: up and down, over static and over changing transforms."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from wherry.ros.frame_names import arrow, is_world_frame
from wherry.ros.transforms import MountError, RigidTransform

MAX_LINKS = 10_000  # links of a tree
MAX_LINK_SHIFT = 0.01  # m, in x and y, by which a link may move and still count as fixed
MAX_LINK_TURN = 0.02  # rad, by which a link may turn and still count as fixed

Pair = tuple[str, str]  # parent and child frame


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

    def __str__(self) -> str:
        return arrow(self.parent, self.child)

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
                angle = math.degrees(link.turn)
                raise MountError(f"the transform {link} moves by {link.shift:.2f} m and {angle:.0f}°")
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
                raise MountError(f"the transform {link} contradicts the others between them")


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
