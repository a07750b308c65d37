"""Topics between Gazebo Sim and the latch node, and the names of Gazebo's models."""

from __future__ import annotations

from wherry.ros import messages as ros
from wherry.ros.topics import Topic

ROBOT = "wherry"  # name of the robot's model
OPENING_SECONDS = (0, 1)  # s on the world's clock when the world detaches its joints, which begin attached
ATTACHED, DETACHED = "attached", "detached"  # states of a detachable joint, as Gazebo spells them
OPEN = Topic("/latch/open", ros.Empty)  # detaches all joints


def box_name(box: int) -> str:
    """Name of a box's model."""
    return f"box_{box}"


def pose_topic(model: str) -> Topic[ros.PoseStamped]:
    """Pose of a model in the world frame; the topic has the name that Gazebo's PosePublisher gives it."""
    return Topic(f"/model/{model}/pose", ros.PoseStamped)


def close_topic(box: int) -> Topic[ros.Empty]:
    """Attaches a box to the robot in its present pose."""
    return Topic(f"/latch/close/{box_name(box)}", ros.Empty)


def removal_topic(box: int) -> Topic[ros.Empty]:
    """Moves a delivered box out of the building."""
    return Topic(f"/latch/take_in/{box_name(box)}", ros.Empty)


def state_topic(box: int) -> Topic[ros.String]:
    """State of a box's joint, `ATTACHED` or `DETACHED`; published when it changes."""
    return Topic(f"/latch/state/{box_name(box)}", ros.String)
