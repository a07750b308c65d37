"""Pictures of the map and the trajectory of a log."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from wherry.mapping.slam import Slam
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats
from wherry.views.map_picture import LegendEntry, MapPicture, Symbol
from wherry.wording import counted

TRAJECTORY_COLOUR = (31, 84, 196)  # RGB, as the other colours
ACCEPTED_COLOUR = (24, 140, 60)
REJECTED_COLOUR = (214, 120, 110)
LOST_COLOUR = (222, 40, 40)
PARTICLE_COLOUR = (235, 140, 0)
ENDS = (
    LegendEntry("start", (24, 140, 60), Symbol.RING),
    LegendEntry("end", (120, 40, 150), Symbol.DISC),
)


def draw_map(grid: OccupancyGrid, slam: Slam) -> bytes:
    """A PNG of a map with the trajectory and, for graph SLAM, the loop closures.

    Args:
        grid: The map; a small one is enlarged.
        slam: The SLAM method that made it.
    """
    picture = MapPicture(grid, is_enlarged=True)
    legend = [LegendEntry("trajectory", TRAJECTORY_COLOUR)]
    if slam.snapshot() is not None:
        closures = slam.loop_closures
        for closure in sorted(closures, key=lambda closure: closure.is_accepted):
            ends = slam.keyframe_poses[[closure.target, closure.keyframe], :2]
            picture.line(ends, ACCEPTED_COLOUR if closure.is_accepted else REJECTED_COLOUR, width=1)
        accepted = sum(closure.is_accepted for closure in closures)
        legend.append(LegendEntry(counted(accepted, "closed loop"), ACCEPTED_COLOUR))
        legend.append(LegendEntry(f"{len(closures) - accepted} rejected", REJECTED_COLOUR))
    path = slam.trajectory.poses[:, :2]
    picture.line(path, TRAJECTORY_COLOUR)
    _draw_ends(picture, path)
    picture.add_legend([*legend, *ENDS])
    return picture.png()


def draw_localization(grid: OccupancyGrid, poses: Floats, is_lost: Sequence[bool], particles: Floats) -> bytes:
    """A PNG of a map with the trajectory, red where the robot was reported lost, and the last particles.

    Args:
        grid: The map; a small one is enlarged.
        poses: [N, 3] m, m, rad, base_link at the scans, map frame.
        is_lost: [N] whether the robot was reported lost at each scan.
        particles: [M, 3] m, m, rad, the last particles, map frame.
    """
    picture = MapPicture(grid, is_enlarged=True)
    picture.points(particles[:, :2], PARTICLE_COLOUR)
    path, first = poses[:, :2], 0
    for lost, run in groupby(is_lost[1:]):
        last = first + len(list(run))
        picture.line(path[first : last + 1], LOST_COLOUR if lost else TRAJECTORY_COLOUR)
        first = last
    _draw_ends(picture, path)
    legend = [
        LegendEntry("trajectory", TRAJECTORY_COLOUR),
        LegendEntry("probably lost", LOST_COLOUR),
        LegendEntry("last particles", PARTICLE_COLOUR, Symbol.POINTS),
    ]
    picture.add_legend([*legend, *ENDS])
    return picture.png()


def _draw_ends(picture: MapPicture, path: Floats) -> None:
    """Mark the ends of a path [N, 2] m, map frame."""
    for entry, point in zip(ENDS, path[np.array([0, -1])], strict=True):
        picture.marker(point, entry.colour, entry.symbol)
