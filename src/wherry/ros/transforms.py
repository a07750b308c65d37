"""Transforms between the frames of a robot, in the plane."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.space.pose import Pose


@dataclass(frozen=True, slots=True)
class StampedTransform:
    """One edge of the tf tree.

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
