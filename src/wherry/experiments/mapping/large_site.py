"""Mapping of a large site: memory and time grow with the observed area, not with the site's extent.

The site is artificial: blocks of walls and crates with streets between them. The robot drives up and down the streets
and then across them. The side of the site is the only parameter.
"""

from __future__ import annotations

import itertools
import math
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.evaluation import absolute_trajectory_error
from wherry.experiments.mapping.drifting_odometry import drifting_odometry
from wherry.experiments.results import markdown_table
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.settings import GraphSlamSettings
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import IDENTITY, Floats, Pose, relative
from wherry.space.raycast import cast_rays

RESOLUTION = 0.05  # m, side of a cell of the site and of its map
STREET_WIDTH, BLOCK_SIZE = 4.0, 16.0  # m, width of a street and side of a block
PITCH = STREET_WIDTH + BLOCK_SIZE  # m from block to block
CRATES = 40  # crates per block
SCAN_DISTANCE = 0.75  # m from scan to scan
SCAN_ANGLE = math.radians(30.0)  # rad from scan to scan where the robot turns on the spot
BEAMS = 360  # beams per scan
RANGE_MAX = 20.0  # m, longest range of the lidar
RANGE_SIGMA = 0.01  # m, standard deviation of a range
SCAN_PERIOD = 0.5  # s from scan to scan
SITE_SIZES = (100.0, 300.0)  # m, sides of the sites in the report
PROGRESS_INTERVAL = 50  # scans from one report of progress to the next


@dataclass(frozen=True, slots=True)
class SiteResult:
    """Cost of mapping a site.

    Attributes:
        side_m: Side of the site, m.
        drive_m: Length of the drive, m.
        scans: Number of scans.
        closures: Number of accepted loop closures.
        rmse_m: Root mean square error of the trajectory after alignment, m.
        map_cells: Cells of the finished map, known or unknown.
        known_share: Share of the map's cells that are known, 0 to 1.
        peak_bytes: Peak memory of the process, the artificial site included, bytes.
        ms_per_scan_median: Median time of adding a scan, ms.
        seconds: Time of all scans and the finished map, s.
    """

    side_m: float
    drive_m: float
    scans: int
    closures: int
    rmse_m: float
    map_cells: int
    known_share: float
    peak_bytes: int
    ms_per_scan_median: float
    seconds: float


def site(side: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Blocked cells of a site with sides of ``side`` m and random blocks, [N, N]."""
    size = round(side / RESOLUTION)
    blocked = np.zeros((size, size), np.bool_)
    blocked[:3], blocked[-3:], blocked[:, :3], blocked[:, -3:] = True, True, True, True
    block = round(BLOCK_SIZE / RESOLUTION)
    for row, column in np.ndindex(blocks(side), blocks(side)):
        low = np.round((np.array([row, column]) * PITCH + STREET_WIDTH) / RESOLUTION).astype(np.int64)
        part = blocked[low[0] : low[0] + block, low[1] : low[1] + block]
        if rng.random() < 0.5:  # walls on two or three sides
            part[:3], part[:, :3] = True, True
            part[-3:] |= rng.random() < 0.5
        corners, sizes = rng.integers(0, block - 20, (CRATES, 2)), rng.integers(6, 40, (CRATES, 2))
        for (y, x), (height, width) in zip(corners, sizes, strict=True):
            part[y : y + height, x : x + width] = True
    return blocked


def blocks(side: float) -> int:
    """Number of blocks along a side of the site, m, with a street before, between and behind them."""
    return int((side - STREET_WIDTH) // PITCH)


def drive(side: float) -> Floats:
    """Poses of a drive along every street in y, then along every fourth street in x, [N, 3] m, m, rad."""
    middles = np.arange(blocks(side) + 1) * PITCH + STREET_WIDTH / 2.0
    first, last = middles[0], middles[-1]
    corners: list[tuple[float, float]] = []
    for number, x in enumerate(middles):
        ends = (first, last) if number % 2 == 0 else (last, first)
        corners += [(float(x), float(y)) for y in ends]
    is_at_right = True
    for y in middles[::-4] if corners[-1][1] > first else middles[::4]:
        ends = (last, first) if is_at_right else (first, last)
        corners += [(float(x), float(y)) for x in ends]
        is_at_right = not is_at_right
    return _poses(np.array(corners))


def _poses(corners: Floats) -> Floats:
    """Poses on straight lines between corners [C, 2] m, turning on the spot, [N, 3] m, m, rad."""
    poses = []
    heading = math.pi / 2.0
    for start, end in itertools.pairwise(corners):
        length = float(np.hypot(*(end - start)))
        if length == 0.0:
            continue
        bearing = math.atan2(end[1] - start[1], end[0] - start[0])
        turn = math.remainder(bearing - heading, math.tau)
        for share in np.arange(0.0, 1.0, SCAN_ANGLE / max(abs(turn), SCAN_ANGLE)):
            poses.append([*start, heading + share * turn])
        for share in np.arange(0.0, 1.0, SCAN_DISTANCE / length):
            poses.append([*(start + share * (end - start)), bearing])
        heading = bearing
    return np.array(poses)


def map_site(side: float, seed: int = 0, progress: Callable[[int, int], None] = lambda done, total: None) -> SiteResult:
    """Map a site.

    Args:
        side: Side of the site, m.
        seed: Seed of the site, of the lidar's noise and of the odometry's drift.
        progress: Called with the number of mapped scans and the number of all scans.
    """
    rng = np.random.default_rng(seed)
    blocked, truth = site(side, rng), drive(side)
    odometry = drifting_odometry(truth, rng)
    angles = np.linspace(-math.pi, math.pi, BEAMS, endpoint=False)
    slam = GraphSlam(settings=GraphSlamSettings(resolution=RESOLUTION, range_limit=RANGE_MAX, empty_range=0.0))
    taken = np.zeros(len(truth))
    for number, pose in enumerate(truth):
        ranges = cast_rays(blocked, RESOLUTION, IDENTITY, pose[None], angles, RANGE_MAX)[0]
        ranges += RANGE_SIGMA * rng.normal(size=BEAMS)
        now = SCAN_PERIOD * number
        scan = Scan(now, ranges, -math.pi, math.tau / BEAMS, 0.05, RANGE_MAX)
        before = time.perf_counter()
        slam.add(scan, Odometry(now, Pose.from_array(odometry[number]), Velocity()))
        taken[number] = time.perf_counter() - before
        if number % PROGRESS_INTERVAL == 0:
            progress(number, len(truth))
    before = time.perf_counter()
    slam.finish()
    grid = slam.grid()
    finished = time.perf_counter() - before
    steps = relative(truth[1:], truth[:-1])
    return SiteResult(
        side_m=side,
        drive_m=float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
        scans=len(truth),
        closures=sum(closure.is_accepted for closure in slam.loop_closures),
        rmse_m=absolute_trajectory_error(slam.trajectory.poses, truth),
        map_cells=grid.probability.size,
        known_share=float((~grid.unknown).mean()),
        peak_bytes=1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        ms_per_scan_median=1e3 * float(np.median(taken)),
        seconds=float(taken.sum()) + finished,
    )


def reproduce(progress: Callable[[int, int], None]) -> str:
    """Map sites of several sizes, and return a section of the results in Markdown.

    Args:
        progress: Called with the number of mapped scans and the number of all scans of the present site.
    """
    rows = []
    for side in SITE_SIZES:
        result = map_site(side, progress=progress)
        rows.append(
            [
                f"{result.side_m:.0f} m",
                f"{result.drive_m / 1e3:.1f} km",
                f"{result.scans:,}",
                str(result.closures),
                f"{result.rmse_m:.2f} m",
                f"{result.map_cells / 1e6:.1f} M",
                f"{result.known_share:.0%}",
                f"{result.peak_bytes / 2**30:.1f} GiB",
                f"{result.ms_per_scan_median:.1f}",
                f"{result.seconds:.0f} s",
            ]
        )
    header = ["side", "drive", "scans", "closures", "rmse", "map cells", "known", "peak memory", "ms per scan", "total"]
    text = (
        "Artificial sites of blocks and streets, mapped at 5 cm along a drive through every street with drifting "
        f"odometry: {BEAMS} beams, {RANGE_MAX:.0f} m. Peak memory is that of the process, the artificial site included."
    )
    return f"## Large sites\n{text}\n\n{markdown_table(header, rows)}\n"
