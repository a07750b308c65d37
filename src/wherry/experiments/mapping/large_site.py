"""Mapping a large site: what it costs in memory and time, and that only what was seen costs.

The site is made up: blocks of walls, racks and crates with streets between them, and a drive that goes up and down the
streets and then across them. Its size is the only thing that is chosen.
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
from wherry.experiments.mapping.drifting_odometry import drifted
from wherry.experiments.results import markdown_table
from wherry.mapping.graph_slam import GraphSlam, GraphSlamSettings
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import IDENTITY, Floats, Pose, relative
from wherry.space.raycast import cast_rays

RESOLUTION = 0.05  # m, a cell of the site and of its map
STREET, BLOCK = 4.0, 16.0  # m
PITCH = STREET + BLOCK
CRATES = 40  # in a block
SPACING = 0.75  # m from scan to scan
TURN = math.radians(30.0)  # likewise, where the robot turns on the spot
BEAMS, RANGE_MAX = 360, 20.0
NOISE = 0.01  # m, σ of a range
SECONDS = 0.5  # from scan to scan
SIDES = (100.0, 300.0)  # m
EVERY_SO_MANY = 50  # scans between two reports of progress


@dataclass(frozen=True, slots=True)
class Result:
    """What a site cost.

    Attributes:
        side_m: The site's side.
        way_m: The drive's length.
        scans: How many there were.
        closures: How many loops were closed.
        rmse_m: Root mean square error of the trajectory, aligned (`absolute_trajectory_error`).
        map_cells: Cells of the finished map, known or not.
        known_share: How many of them are known.
        peak_bytes: The most memory that the process has taken so far, the made-up site included.
        ms_per_scan_median: Of the time that adding a scan took.
        seconds: All scans and the finished map.
    """

    side_m: float
    way_m: float
    scans: int
    closures: int
    rmse_m: float
    map_cells: int
    known_share: float
    peak_bytes: int
    ms_per_scan_median: float
    seconds: float


def site(side: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """[N, N] what is blocked on a site of ``side`` m: no two blocks are alike."""
    size = round(side / RESOLUTION)
    blocked = np.zeros((size, size), np.bool_)
    blocked[:3], blocked[-3:], blocked[:, :3], blocked[:, -3:] = True, True, True, True
    block = round(BLOCK / RESOLUTION)
    for row, column in np.ndindex(blocks(side), blocks(side)):
        low = np.round((np.array([row, column]) * PITCH + STREET) / RESOLUTION).astype(np.int64)
        part = blocked[low[0] : low[0] + block, low[1] : low[1] + block]
        if rng.random() < 0.5:  # a wall on two or three of its sides
            part[:3], part[:, :3] = True, True
            part[-3:] |= rng.random() < 0.5
        corners, sizes = rng.integers(0, block - 20, (CRATES, 2)), rng.integers(6, 40, (CRATES, 2))
        for (y, x), (height, width) in zip(corners, sizes, strict=True):
            part[y : y + height, x : x + width] = True
    return blocked


def blocks(side: float) -> int:
    """How many blocks there are on a side, with a street before, between and behind them."""
    return int((side - STREET) // PITCH)


def drive(side: float) -> Floats:
    """[N, 3] m, m, rad: up and down every street that runs along y, then along every fourth one that runs along x."""
    middles = np.arange(blocks(side) + 1) * PITCH + STREET / 2.0
    first, last = middles[0], middles[-1]
    corners: list[tuple[float, float]] = []
    for number, x in enumerate(middles):
        ends = (first, last) if number % 2 == 0 else (last, first)
        corners += [(float(x), float(y)) for y in ends]
    at_right = True
    for y in middles[::-4] if corners[-1][1] > first else middles[::4]:
        ends = (last, first) if at_right else (first, last)
        corners += [(float(x), float(y)) for x in ends]
        at_right = not at_right
    return _poses(np.array(corners))


def _poses(corners: Floats) -> Floats:
    """[N, 3] on straight lines between corners, [C, 2] m, turning on the spot."""
    poses = []
    heading = math.pi / 2.0
    for start, end in itertools.pairwise(corners):
        length = float(np.hypot(*(end - start)))
        if length == 0.0:
            continue
        bearing = math.atan2(end[1] - start[1], end[0] - start[0])
        turn = math.remainder(bearing - heading, math.tau)
        for share in np.arange(0.0, 1.0, TURN / max(abs(turn), TURN)):
            poses.append([*start, heading + share * turn])
        for share in np.arange(0.0, 1.0, SPACING / length):
            poses.append([*(start + share * (end - start)), bearing])
        heading = bearing
    return np.array(poses)


def run(side: float, seed: int = 0, progress: Callable[[int, int], None] = lambda done, total: None) -> Result:
    """Map a site.

    Args:
        side: m.
        seed: Of the site, of the lidar's noise and of the odometry's drift.
        progress: Told how many scans are done, of how many.
    """
    rng = np.random.default_rng(seed)
    blocked, truth = site(side, rng), drive(side)
    odometry = drifted(truth, rng)
    angles = np.linspace(-math.pi, math.pi, BEAMS, endpoint=False)
    slam = GraphSlam(settings=GraphSlamSettings(resolution=RESOLUTION, range_limit=RANGE_MAX, empty_range=0.0))
    taken = np.zeros(len(truth))
    for number, pose in enumerate(truth):
        ranges = cast_rays(blocked, RESOLUTION, IDENTITY, pose[None], angles, RANGE_MAX)[0]
        ranges += NOISE * rng.normal(size=BEAMS)
        now = SECONDS * number
        scan = Scan(now, ranges, -math.pi, math.tau / BEAMS, 0.05, RANGE_MAX)
        before = time.perf_counter()
        slam.add(scan, Odometry(now, Pose.from_array(odometry[number]), Velocity()))
        taken[number] = time.perf_counter() - before
        if number % EVERY_SO_MANY == 0:
            progress(number, len(truth))
    before = time.perf_counter()
    slam.finish()
    grid = slam.grid()
    finished = time.perf_counter() - before
    steps = relative(truth[1:], truth[:-1])
    return Result(
        side_m=side,
        way_m=float(np.hypot(steps[:, 0], steps[:, 1]).sum()),
        scans=len(truth),
        closures=sum(closure.accepted for closure in slam.closures),
        rmse_m=absolute_trajectory_error(slam.trajectory.poses, truth),
        map_cells=grid.probability.size,
        known_share=float((~grid.unknown).mean()),
        peak_bytes=1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        ms_per_scan_median=1e3 * float(np.median(taken)),
        seconds=float(taken.sum()) + finished,
    )


def reproduce(progress: Callable[[int, int], None]) -> str:
    """Map sites of several sizes; a results section in Markdown.

    Args:
        progress: Told how many scans of the present site are done, of how many.
    """
    rows = []
    for side in SIDES:
        result = run(side, progress=progress)
        rows.append(
            [
                f"{result.side_m:.0f} m",
                f"{result.way_m / 1e3:.1f} km",
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
    header = ["side", "way", "scans", "closures", "rmse", "map cells", "known", "peak memory", "ms a scan", "in all"]
    text = (
        "Made-up sites of blocks and streets, driven up and down every street and mapped at 5 cm with odometry that "
        f"drifts: {BEAMS} beams, {RANGE_MAX:.0f} m. The peak is that of the whole process, the made-up site included."
    )
    return f"## Large sites\n{text}\n\n{markdown_table(header, rows)}\n"
