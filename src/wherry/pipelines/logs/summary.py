"""What a run over a log tells people first: size of the map, distance, duration, and notes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.logs.lidar_log import LidarLog
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats

MIN_STEP = 0.05  # m, displacement from which on the robot has driven; less is jitter of the estimate
STATIONARY_RADIUS = 0.1  # m, distance from its first position up to which a robot never moved
FEW_RETURNS = 0.05  # fraction of beams with a return below which a log hardly sees anything


@dataclass(frozen=True, slots=True)
class MapExtent:
    """The extent of a map's known part.

    Attributes:
        size: Width and height of the box around the known cells along the axes of the map frame's grid, m.
        free_area: Area of the free cells, m².
        resolution: Side of a cell, m.
    """

    size: tuple[float, float]
    free_area: float
    resolution: float

    @classmethod
    def of(cls, grid: OccupancyGrid) -> MapExtent:
        """The extent of a map; unknown cells around the known ones do not count."""
        known = ~grid.unknown
        width, height = (_span(np.flatnonzero(known.any(axis=axis))) * grid.resolution for axis in (0, 1))
        return cls((width, height), float(grid.free.sum()) * grid.resolution**2, grid.resolution)


def _span(indices: NDArray[np.int64]) -> int:
    """Number of rows or columns from the first of some cells to the last."""
    return int(indices.max() - indices.min()) + 1 if len(indices) else 0


def driven_distance(poses: Floats) -> float:
    """Length of the way along poses [N, 3] m, m, rad, without the jitter of a robot that stands, m."""
    total, last = 0.0, poses[0, :2]
    for position in poses[1:, :2]:
        step = float(np.hypot(*(position - last)))
        if step >= MIN_STEP:
            total, last = total + step, position
    return total


@dataclass(frozen=True, slots=True)
class DriveSummary:
    """A log's drive as a trajectory has it.

    Attributes:
        distance_m: Length of the robot's way, m.
        duration_s: Time from the first scan to the last, s.
        notes: What was decided, assumed or left out in reading, and what the log cannot show, as sentences for people.
    """

    distance_m: float
    duration_s: float
    notes: tuple[str, ...]

    @classmethod
    def of(cls, log: LidarLog, poses: Floats) -> DriveSummary:
        """The summary, given base_link at the scans, [N, 3] m, m, rad, map frame."""
        notes = as_sentences((*log.notes, *_scope_notes(log, poses)))
        return cls(driven_distance(poses), log.scans[-1].time - log.scans[0].time, notes)


def as_sentences(notes: Iterable[str]) -> tuple[str, ...]:
    """The notes, each once, with a full stop and, unless they begin with the name of a field, a capital letter."""
    return tuple(dict.fromkeys(_as_sentence(note) for note in notes))


def _as_sentence(note: str) -> str:
    begins_with_word = note.partition(" ")[0].isalpha()
    return f"{note[:1].upper() if begins_with_word else note[:1]}{note[1:].removesuffix('.')}."


def _scope_notes(log: LidarLog, poses: Floats) -> Iterator[str]:
    """Notes on a log that shows too little for a map or a trajectory."""
    scans, duration = len(log.scans), log.scans[-1].time - log.scans[0].time
    radius = float(np.hypot(*(poses[:, :2] - poses[0, :2]).T).max())
    if scans == 1:
        yield "the log has only one scan, which shows what is seen from one place"
    elif radius < STATIONARY_RADIUS:
        drive = f"the robot moved {radius:.2f} m in {scans:,} scans and {duration:.1f} s"
        yield f"{drive}: the log shows only what is seen from one place"
    beams = sum(len(scan.ranges) for scan in log.scans)
    returns = sum(int(scan.valid.sum()) for scan in log.scans)
    if returns < FEW_RETURNS * beams:
        yield f"only {returns:,} of {beams:,} beams met anything"
