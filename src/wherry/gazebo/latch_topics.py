"""Topics between Gazebo Sim and the latch, and the names of the models that they are about."""

from __future__ import annotations

from wherry.ros import messages as ros
from wherry.ros.topics import Topic

ROBOT = "wherry"  # name of the robot's model
OPENING_SECONDS = (0, 1)  # s of the world's clock in which the world itself opens the joints, which begin attached
ATTACHED, DETACHED = "attached", "detached"  # states of a detachable joint, as Gazebo spells them
OPEN = Topic("/latch/open", ros.Empty)  # detaches all joints


def box_name(box: int) -> str:
    """Name of a box's model."""
    return f"box_{box}"


def pose_topic(model: str) -> Topic[ros.PoseStamped]:
    """Pose of a model in the world; Gazebo's PosePublisher chooses the name."""
    return Topic(f"/model/{model}/pose", ros.PoseStamped)


def close_topic(box: int) -> Topic[ros.Empty]:
    """Attaches a box to the robot in its present pose."""
    return Topic(f"/latch/close/{box_name(box)}", ros.Empty)


def take_in_topic(box: int) -> Topic[ros.Empty]:
    """Moves a delivered box out of the building."""
    return Topic(f"/latch/take_in/{box_name(box)}", ros.Empty)


def state_topic(box: int) -> Topic[ros.String]:
    """`ATTACHED` or `DETACHED`, published when a joint changes."""
    return Topic(f"/latch/state/{box_name(box)}", ros.String)
