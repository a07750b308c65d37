"""Errors that end a run on a ROS robot."""


class RobotLostError(Exception):
    """The robot no longer answers, or was restarted."""


class TimeMovedBackwardsError(RobotLostError):
    """The robot's clock was set back, for example by a restart; earlier measurements are no longer comparable."""
