"""Reasons to end a run with a robot of ROS."""


class RobotLostError(Exception):
    """The robot does not answer any more, or was restarted."""


class TimeMovedBackwardsError(RobotLostError):
    """The robot's clock was set back, for example by a restart; earlier measurements are no longer comparable."""
