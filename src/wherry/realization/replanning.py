"""Path following with periodic replanning and a recovery behaviour for a blocked robot."""

from __future__ import annotations

import numpy as np

from wherry.navigation.path import Costmap
from wherry.realization.pilot import DriveStatus, Pilot
from wherry.space.pose import Floats, Pose

REPLANNING_PERIOD = 1.5  # s of driving after which the path is replanned
BACK_OFF_DISTANCE = 0.3  # m, half the side of the square in which a blocked robot seeks the largest clearance


class ReplanningFollower:
    """Follows each path for one replanning period.

    When the robot is blocked for the first time on its way to a goal, it backs off to a position with more clearance,
    since a path on the map may pass a door jamb more closely than `safe_velocity` allows.

    Args:
        pilot: Drives the robot.
    """

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self._has_backed_off = False

    def follow(self, path: Floats, costmap: Costmap) -> bool:
        """Follow a path for one replanning period.

        Args:
            path: [N, 2] waypoints, m, map frame.
            costmap: The costmap on which the path was planned.

        Returns:
            Whether to replan to the same goal; False if the robot has arrived, is lost or is blocked again.
        """
        pilot, reverse = self._pilot, self._pilot.boxes.is_holding
        deadline = pilot.time + REPLANNING_PERIOD
        status = pilot.follow(path, reverse=reverse, is_preempted=lambda: pilot.time >= deadline)
        if status is DriveStatus.BLOCKED and not self._has_backed_off:
            self._has_backed_off = True
            return self._back_off(costmap, reverse=reverse)
        self._has_backed_off &= status is DriveStatus.PREEMPTED
        return status is DriveStatus.PREEMPTED

    def _back_off(self, costmap: Costmap, *, reverse: bool) -> bool:
        """Drive to the nearby position with the largest clearance; return whether the robot arrived."""
        pilot = self._pilot
        row, column = costmap.max_clearance_cell(np.array([pilot.pose.x, pilot.pose.y]), BACK_OFF_DISTANCE)
        x, y = costmap.centres(np.array([[row, column]]))[0].tolist()
        is_ahead = pilot.pose.inverse.transform(np.array([[x, y]]))[0, 0] > 0.0
        return pilot.go_to(Pose(x, y, pilot.pose.theta), reverse=reverse or not is_ahead)
