"""Where the lidar sits on a live robot, from ``/tf_static`` and ``/tf``."""

from __future__ import annotations

from wherry.errors import InputError
from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_rigid_transform, frames_of
from wherry.ros.frame_names import is_world_frame
from wherry.ros.names import Frames, Topics
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.topics import Topic
from wherry.ros.transform_tree import Link, TransformTree
from wherry.ros.transforms import Mount, MountError

STATED = "lidar in the --body file states it"


class RobotTransforms:
    """The transforms of a robot, static and changing ones.

    Args:
        subscriptions: Subscriptions of the agent's node.
        topics: Topics of the transforms.
        frames: Frames of the robot.
    """

    def __init__(self, subscriptions: Subscriptions, topics: Topics, frames: Frames) -> None:
        self._frames = frames
        self._base, self._laser = frames.base_link.lstrip("/"), frames.laser.lstrip("/")
        self._tree = TransformTree()
        self._path: list[Link] = []  # links from base_link to the lidar, once they are known
        self._add(subscriptions, topics.tf_static)
        self._add(subscriptions, topics.tf)

    def find_mount(self) -> Mount | None:
        """Return the lidar's mount on base_link, or None while a transform between them is missing.

        Raises:
            InputError: A transform between them is invalid, moves, or tilts the lidar.
        """
        try:
            transform = self._tree.lookup(self._base, self._laser, self._is_world)
            if transform is not None:
                self._path = self._tree.chain(self._base, self._laser, self._is_world) or []
                return Mount.from_transform(transform)
        except MountError as error:
            reason = f"where the lidar sits on {self._base} cannot be used: {error}; {STATED}"
            raise InputError("ROS", f"frame {self._laser!r}", reason) from error
        for topic, reason in self._tree.rejected_between(self._base, self._laser, self._is_world):
            raise InputError(topic, f"frame {self._laser!r}", f"a transform to it {reason}; {STATED}")
        return None

    @property
    def moving_link(self) -> str:
        """The frames of a transform between base_link and the lidar that has moved since; empty if none has."""
        return next((str(link) for link in self._path if not link.is_fixed), "")

    def _is_world(self, frame: str) -> bool:
        return frame in (self._frames.odom, self._frames.map) or is_world_frame(frame)

    def _add(self, subscriptions: Subscriptions, topic: Topic[ros.TFMessage]) -> None:
        def add_transforms(message: ros.TFMessage) -> None:
            for transform in message.transforms:
                pair = frames_of(transform)
                try:
                    self._tree.add(*pair, decode_rigid_transform(transform))
                except MessageError as error:
                    self._tree.reject(*pair, topic.name, str(error))

        subscriptions.add(topic, add_transforms)
