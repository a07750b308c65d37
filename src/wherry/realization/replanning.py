"""Following paths while the map changes: for a replanning period at a time, with one recovery where blocked."""

from __future__ import annotations

import numpy as np

from wherry.navigation.path import Costmap
from wherry.realization.pilot import DriveStatus, Pilot
from wherry.space.pose import Floats, Pose

REPLANNING_PERIOD = 1.5  # s of driving after which the path is planned anew
BACK_OFF_DISTANCE = 0.3  # m within which a blocked robot goes to the place with the largest clearance


class ReplanningFollower:
    """Follows the first stretch of each path it is given.

    A robot that is blocked for the first time on its way to a goal backs off to a place with more clearance, since
    paths pass door jambs more closely than the scan allows.

    Args:
        pilot: Drives the robot.
    """

    def __init__(self, pilot: Pilot) -> None:
        self._pilot = pilot
        self._has_backed_off = False

    def follow(self, path: Floats, costmap: Costmap) -> bool:
        """Follow a path, [N, 2] m, map frame, for a replanning period.

        Returns:
            Whether to plan anew to the same goal; False if the robot has arrived or is blocked for good.
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
        """Drive to the nearby place with the largest clearance; return whether the robot arrived."""
        pilot = self._pilot
        row, column = costmap.max_clearance_cell(np.array([pilot.pose.x, pilot.pose.y]), BACK_OFF_DISTANCE)
        x, y = costmap.centres(np.array([[row, column]]))[0].tolist()
        is_ahead = pilot.pose.inverse.transform(np.array([[x, y]]))[0, 0] > 0.0
        return pilot.go_to(Pose(x, y, pilot.pose.theta), reverse=reverse or not is_ahead)
