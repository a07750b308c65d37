"""The fixed tree of a robot's frames, from ``/tf_static``."""

from __future__ import annotations

from wherry.errors import InputError
from wherry.ros import messages as ros
from wherry.ros.decoding import MessageError, decode_transform
from wherry.ros.nodes.subscriptions import Subscriptions
from wherry.ros.topics import Topic
from wherry.space.pose import Pose

MAX_CHAIN_LENGTH = 20  # transforms from a frame to one of its ancestors


class StaticTransforms:
    """Looks up poses of frames that are fixed to each other.

    Args:
        subscriptions: Subscriptions of the agent's node.
        topic: Topic of the static transforms, ``/tf_static``.
    """

    def __init__(self, subscriptions: Subscriptions, topic: Topic[ros.TFMessage]) -> None:
        self._topic = topic.name
        self._by_child: dict[str, ros.TransformStamped] = {}
        subscriptions.add(topic, self._on_transforms)

    def lookup(self, parent: str, child: str) -> Pose | None:
        """Return the pose of ``child`` in ``parent``, or None while a transform between them is missing.

        Raises:
            InputError: A transform tilts its child or is not valid, or the transforms form a circle.
        """
        parent, frame, pose = parent.lstrip("/"), child.lstrip("/"), Pose()
        for _ in range(MAX_CHAIN_LENGTH):
            if frame == parent:
                return pose
            if frame not in self._by_child:
                return None
            try:
                transform = decode_transform(self._by_child[frame])
            except MessageError as error:
                raise InputError(self._topic, frame, str(error)) from error
            frame, pose = transform.parent, transform.pose @ pose
        raise InputError(self._topic, child, "the transforms form a circle")

    def _on_transforms(self, message: ros.TFMessage) -> None:
        for transform in message.transforms:
            self._by_child[transform.child_frame_id.lstrip("/")] = transform
