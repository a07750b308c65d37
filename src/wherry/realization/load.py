"""Detection and masking of the lidar's readings of a box in the fork."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wherry.robot import Body, Scan


def mask_load(scan: Scan, body: Body) -> Scan:
    """Set the readings of a box in the fork to NaN, since they carry no information about the robot's pose."""
    on_load = _is_on_load(scan, body)
    return replace(scan, ranges=np.where(on_load, math.nan, scan.ranges)) if on_load.any() else scan


def detects_load(scan: Scan, body: Body) -> bool:
    """Whether the scan has readings of a box in the fork."""
    return bool(_is_on_load(scan, body).any())


def _is_on_load(scan: Scan, body: Body) -> NDArray[np.bool_]:
    """[R] True for beams that end on a box in the fork."""
    with np.errstate(invalid="ignore"):
        x, y = body.lidar.x + scan.ranges * np.cos(scan.angles), body.lidar.y + scan.ranges * np.sin(scan.angles)
        on_load: NDArray[np.bool_] = np.hypot(x, y) < body.load_radius
    return on_load
