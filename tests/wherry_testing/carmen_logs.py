"""Small CARMEN logs of a robot in a room with a pillar, with exact ranges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wherry.space.map_files import save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose
from wherry.space.raycast import cast_rays

RESOLUTION = 0.05  # m
BEAMS = 181


def room() -> OccupancyGrid:
    """A room of 6 × 4 m with a pillar; its lower left corner is the origin of the map frame."""
    occupied = np.pad(np.zeros((80, 120), np.bool_), 1, constant_values=True)
    occupied[30:40, 60:70] = True
    probability = np.where(occupied, 0.98, 0.02).astype(np.float32)
    return OccupancyGrid(probability, RESOLUTION, Pose(-RESOLUTION, -RESOLUTION))


def write_room_map(folder: Path) -> Path:
    """Write the map of the room, and return the path of its map.yaml."""
    return save_map(room(), folder / "map.yaml")


def drive_poses(scans: int = 16) -> Floats:
    """Poses of a drive through the room along an arc, [N, 3] m, m, rad."""
    n = np.arange(scans)
    return np.column_stack([1.0 + 0.1 * n, 1.0 + 0.05 * n, 0.05 * n])


def write_carmen_log(path: Path, poses: Floats, lidar: Pose | None = None, *, period: float = 1.0) -> Path:
    """Write scans of the room with exact odometry; the log does not say where the lidar sits.

    Args:
        path: The file.
        poses: [N, 3] m, m, rad, true poses of base_link, which are also its odometry.
        lidar: Pose of the lidar in the base_link frame; None for the origin.
        period: Time between scans, s.
    """
    grid, mount = room(), lidar or Pose()
    angles = np.linspace(-math.pi / 2, math.pi / 2, BEAMS)
    places = np.array([(Pose.from_array(pose) @ mount).as_array() for pose in poses])
    ranges = [cast_rays(grid.occupied, RESOLUTION, grid.origin, place[None], angles, 20.0)[0] for place in places]
    return write_scans(path, ranges, poses, period=period)


def write_scans(path: Path, ranges: Sequence[Floats], poses: Floats, *, period: float = 1.0) -> Path:
    """Write FLASER lines with the given ranges [N][B] m and odometry [N, 3] m, m, rad."""
    lines = []
    for n, (scan, pose) in enumerate(zip(ranges, poses, strict=True)):
        place = " ".join(f"{value:.6f}" for value in pose)
        beams = " ".join(f"{distance:.3f}" for distance in scan)
        lines.append(f"FLASER {len(scan)} {beams} {place} {place} {n * period:.3f} host {n * period:.3f}\n")
    path.write_text("".join(lines))
    return path
