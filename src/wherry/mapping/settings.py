"""Settings of the SLAM methods."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SlamSettings:
    """Settings that all methods share.

    Attributes:
        resolution: Side of a cell of the occupancy grid, m.
        range_limit: Longest range that is used, m.
        empty_range: Length that is taken as free along a beam without a return, m; 0 for a lidar that gets no returns
            from dark surfaces, whose missing returns mean nothing.
    """

    resolution: float = 0.05
    range_limit: float = 30.0
    empty_range: float = 10.0


@dataclass(frozen=True, slots=True)
class GraphSlamSettings(SlamSettings):
    """Settings of graph SLAM.

    Attributes:
        keyframe_distance: Distance from the last keyframe at which a scan becomes a keyframe, m.
        keyframe_angle: Angle from the last keyframe at which a scan becomes a keyframe, rad.
        submap_scans: Keyframes in a complete submap; the next submap begins at half of them.
        closure_every: Period of the search for loop closures, keyframes.
        closure_scans: Number of the latest keyframes whose points are matched together in a search.
        closure_candidates: Largest number of submaps that are matched in a search.
        close_loops: Whether to search for loop closures.
    """

    keyframe_distance: float = 0.25
    keyframe_angle: float = math.radians(15.0)
    submap_scans: int = 20
    closure_every: int = 4
    closure_scans: int = 8
    closure_candidates: int = 2
    close_loops: bool = True


@dataclass(frozen=True, slots=True)
class ParticleSlamSettings(SlamSettings):
    """Settings of particle SLAM.

    Attributes:
        particles: Number of particles N.
        keyframe_distance: Distance from the last keyframe at which a scan becomes a keyframe, m.
        keyframe_angle: Angle from the last keyframe at which a scan becomes a keyframe, rad.
        resample_below: Share of N below which the effective sample size triggers resampling.
    """

    particles: int = 30
    keyframe_distance: float = 0.25
    keyframe_angle: float = math.radians(15.0)
    resample_below: float = 0.5
