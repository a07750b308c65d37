"""Sensor models: how likely a scan is from every particle's place on the map (Probabilistic Robotics, chapter 6).

All of them add logarithms: sixty beams multiply to numbers that no floating-point type can hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import kernel, reordering_kernel
from wherry.localization.parameters import AmclParameters
from wherry.robot import Scan
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Pose

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Beams:
    """The beams of one scan that are weighed, as base_link sees them.

    Attributes:
        ends: [B, 2] m, where they ended, base_link frame.
        origin: The lidar's pose, base_link frame.
        ranges: [B] m.
        range_max: m.
    """

    ends: Floats
    origin: Pose
    ranges: Floats
    range_max: float

    def __len__(self) -> int:
        return len(self.ranges)

    def only(self, kept: NDArray[np.bool_]) -> Beams:
        """The beams for which [B] ``kept`` holds."""
        return Beams(self.ends[kept], self.origin, self.ranges[kept], self.range_max)


def choose_beams(scan: Scan, lidar: Pose, parameters: AmclParameters, count: int | None = None) -> Beams:
    """Pick evenly among a scan's readings; NaN, infinite and out-of-limit values are none, nor is the robot's own load.

    Args:
        scan: The scan.
        lidar: The lidar's pose, base_link frame.
        parameters: The range limits and the robot's radius count, and max_beams where no count is given.
        count: How many at most.
    """
    furthest = min(scan.range_max, parameters.laser_max_range)
    nearest = max(scan.range_min, parameters.laser_min_range)
    with np.errstate(invalid="ignore"):
        readings = np.flatnonzero((scan.ranges >= nearest) & (scan.ranges < furthest))
    if parameters.robot_radius > 0.0:
        ends = _ends(scan, readings, lidar)
        readings = readings[np.square(ends).sum(axis=1) > parameters.robot_radius**2]
    most = parameters.max_beams if count is None else count
    if len(readings) > most:
        readings = readings[np.linspace(0, len(readings) - 1, most).astype(np.int64)]
    return Beams(_ends(scan, readings, lidar), lidar, scan.ranges[readings], furthest)


def _ends(scan: Scan, readings: NDArray[np.int64], lidar: Pose) -> Floats:
    """[B, 2] m, base_link frame: where the beams of these numbers ended."""
    ranges, angles = scan.ranges[readings], scan.angle_min + scan.angle_increment * readings + lidar.theta
    ends = np.empty((len(readings), 2))
    ends[:, 0] = lidar.x + ranges * np.cos(angles)
    ends[:, 1] = lidar.y + ranges * np.sin(angles)
    return ends


class SensorModel(Protocol):
    """Anything that weighs particles by a scan."""

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """Add log p(scan | particle, map).

        Args:
            particles: [N, 3] m, m, rad, map frame.
            beams: The scan.
            log_weights: [N] added to in place.
        """
        ...


class LikelihoodField:
    """A reading is likely where it ends near an obstacle of the map (table 6.3).

    The table of log likelihoods is made once, so that a beam costs one look-up.
    """

    def __init__(self, field: DistanceField, parameters: AmclParameters) -> None:
        self._field = field
        self._parameters = parameters
        self._table = np.empty((0, 0), np.float32)
        self._range_max = math.nan

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """See `SensorModel`."""
        if beams.range_max != self._range_max:
            distance = _bordered(self._field.distance, self._field.limit)
            self._table = log_likelihood(distance, beams.range_max, self._parameters)
            self._range_max = beams.range_max
        _add_from_table(self._table, _place(self._field), particles, _kernel_ends(beams), log_weights)


class BeamSkippingLikelihoodField(LikelihoodField):
    """The likelihood field without the beams that hardly any particle can explain (nav2's do_beamskip).

    People and boxes that are not on the map then do not pull a belief that has already converged.
    """

    def __init__(self, field: DistanceField, parameters: AmclParameters) -> None:
        super().__init__(field, parameters)
        self._distance = _bordered(field.distance, field.limit)

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """See `SensorModel`."""
        p = self._parameters
        reach = p.beam_skip_distance
        agreeing = _count_agreeing(self._distance, _place(self._field), particles, _kernel_ends(beams), reach)
        kept = agreeing >= p.beam_skip_threshold * len(particles)
        if np.count_nonzero(~kept) > p.beam_skip_error_threshold * len(beams):
            kept[:] = True  # the belief itself is wrong: every beam is needed to find out
        super().add_log_likelihood(particles, beams.only(kept), log_weights)


def log_likelihood(distance: NDArray[np.float32], range_max: float, parameters: AmclParameters) -> NDArray[np.float32]:
    """Log likelihood of readings that end so far (m) from the nearest obstacle: z_hit·N(0, σ) + z_rand."""
    p = parameters
    hit = np.float32(p.z_hit) * np.exp(np.square(distance) * np.float32(-0.5 / p.sigma_hit**2))
    found: NDArray[np.float32] = np.log(hit + np.float32(p.z_rand / range_max))
    return found


class BeamModel:
    """A reading is likely where it is as long as the way to the first obstacle of the map (table 6.1).

    The way is found by sphere tracing in the distance field. Beams are judged one by one, so this is the model for
    maps whose free space matters: it knows that a beam cannot pass through a wall.
    """

    def __init__(self, field: DistanceField, parameters: AmclParameters) -> None:
        self._field = field
        p = parameters
        self._mixture = np.array([p.z_hit, p.z_short, p.z_max, p.z_rand, p.sigma_hit, p.lambda_short])

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """See `SensorModel`."""
        _add_from_rays(
            self._field.distance,
            _place(self._field),
            particles,
            beams.ends,
            np.array([beams.origin.x, beams.origin.y, beams.range_max]),
            beams.ranges,
            self._mixture,
            log_weights,
        )


SENSOR_MODELS: MappingProxyType[str, Callable[[DistanceField, AmclParameters], SensorModel]] = MappingProxyType(
    {
        "likelihood_field": LikelihoodField,
        "likelihood_field_prob": BeamSkippingLikelihoodField,
        "beam": BeamModel,
    }
)


def _kernel_ends(beams: Beams) -> NDArray[np.float32]:
    """[2, B] m, as kernels take the beams' ends."""
    return np.ascontiguousarray(beams.ends.T, np.float32)


def _place(field: DistanceField) -> Floats:
    """[4] the grid's origin x m, y m, θ rad and its resolution m, as kernels take them."""
    return np.array([field.origin.x, field.origin.y, field.origin.theta, field.resolution])


def _bordered(table: NDArray[np.float32], outside: float) -> NDArray[np.float32]:
    """[H + 2, W + 2] the table with a border that stands for everything off the map."""
    return np.pad(table, 1, constant_values=np.float32(outside))


@reordering_kernel
def _add_from_table(
    table: NDArray[np.float32], place: Floats, particles: Floats, ends: NDArray[np.float32], log_weights: Floats
) -> None:
    """Sum up the table's values at the beams' ends for every particle.

    Args:
        table: [H + 2, W + 2] bordered.
        place: [4] the grid's origin and resolution.
        particles: [N, 3] m, m, rad.
        ends: [2, B] m, base_link frame.
        log_weights: [N] added to.
    """
    flat = table.ravel()
    cells = np.empty(ends.shape[1], np.int32)
    for i in range(len(particles)):
        _find_cells(table.shape, place, particles[i], ends, cells)
        log_weights[i] += _sum_of(flat, cells)


@reordering_kernel
def _sum_of(flat: NDArray[np.float32], cells: NDArray[np.int32]) -> float:
    """The sum of the table's values, in whatever order is fastest."""
    total = np.float32(0.0)
    for b in range(len(cells)):
        total += flat[np.uint64(cells[b])]  # unsigned: numba need not look for negative indices
    return float(total)


@kernel
def _count_agreeing(
    table: NDArray[np.float32], place: Floats, particles: Floats, ends: NDArray[np.float32], reach: float
) -> NDArray[np.int64]:
    """[B] how many particles see each beam end within ``reach`` m of an obstacle; arguments as `_add_from_table`."""
    flat = table.ravel()
    cells = np.empty(ends.shape[1], np.int32)
    agreeing = np.zeros(ends.shape[1], np.int64)
    for i in range(len(particles)):
        _find_cells(table.shape, place, particles[i], ends, cells)
        for b in range(len(cells)):
            agreeing[b] += flat[cells[b]] <= reach
    return agreeing


@reordering_kernel
def _find_cells(
    shape: tuple[int, int], place: Floats, pose: Floats, ends: NDArray[np.float32], cells: NDArray[np.int32]
) -> None:
    """Write [B] where in a bordered table the beams end; no branches, so that it runs on vector units."""
    width, last_column, last_row = np.int32(shape[1]), np.float32(shape[1] - 1), np.float32(shape[0] - 1)
    zero = np.float32(0.0)
    turned_cos, turned_sin = math.cos(place[2]), math.sin(place[2])
    dx, dy = pose[0] - place[0], pose[1] - place[1]
    x = np.float32((turned_cos * dx + turned_sin * dy) / place[3] + 1.0)
    y = np.float32((turned_cos * dy - turned_sin * dx) / place[3] + 1.0)
    cos = np.float32(math.cos(pose[2] - place[2]) / place[3])
    sin = np.float32(math.sin(pose[2] - place[2]) / place[3])
    for b in range(ends.shape[1]):
        column = np.int32(min(max(x + cos * ends[0, b] - sin * ends[1, b], zero), last_column))
        row = np.int32(min(max(y + sin * ends[0, b] + cos * ends[1, b], zero), last_row))
        cells[b] = row * width + column


@kernel
def trace_ray(
    distance: NDArray[np.float32], resolution: float, column: float, row: float, cos: float, sin: float, furthest: float
) -> float:
    """Sphere tracing: step by the distance to the nearest obstacle, which no step can pass.

    Args:
        distance: [H, W] m, a distance field.
        resolution: m.
        column: Where the ray starts, in cells.
        row: Likewise.
        cos: The ray's direction in the grid.
        sin: Likewise.
        furthest: m, where to give up.

    Returns:
        m to the first occupied cell, or ``furthest``; off the map everything is free.
    """
    height, width = distance.shape
    travelled = 0.0
    while travelled < furthest:
        x = column + cos * travelled / resolution
        y = row + sin * travelled / resolution
        if not (0.0 <= x < width and 0.0 <= y < height):
            return furthest
        gap = distance[int(y), int(x)]
        if gap < 0.5 * resolution:
            return travelled
        # The ray is up to 0.71 cells from the centre for which the gap holds, and the obstacle as wide.
        travelled += max(gap - 1.42 * resolution, 0.5 * resolution)
    return furthest


@kernel
def _add_from_rays(
    distance: NDArray[np.float32],
    place: Floats,
    particles: Floats,
    ends: Floats,
    lidar: Floats,
    ranges: Floats,
    mixture: Floats,
    log_weights: Floats,
) -> None:
    """Sum up the beam model's log likelihoods, equations 6.4 to 6.12."""
    z_hit, z_short, z_max, z_rand, sigma, decay = mixture
    turned_cos, turned_sin = math.cos(place[2]), math.sin(place[2])
    for i in range(len(particles)):
        heading = particles[i, 2]
        x = particles[i, 0] + math.cos(heading) * lidar[0] - math.sin(heading) * lidar[1] - place[0]
        y = particles[i, 1] + math.sin(heading) * lidar[0] + math.cos(heading) * lidar[1] - place[1]
        column = (turned_cos * x + turned_sin * y) / place[3]
        row = (turned_cos * y - turned_sin * x) / place[3]
        cos, sin = math.cos(heading - place[2]), math.sin(heading - place[2])
        total = 0.0
        for b in range(len(ranges)):
            along = (ends[b, 0] - lidar[0]) / ranges[b]
            across = (ends[b, 1] - lidar[1]) / ranges[b]
            expected = trace_ray(
                distance, place[3], column, row, cos * along - sin * across, sin * along + cos * across, lidar[2]
            )
            error = ranges[b] - expected
            p = z_hit * math.exp(-0.5 * error * error / (sigma * sigma)) + z_rand / lidar[2]
            if error < 0.0:
                p += z_short * decay * math.exp(-decay * ranges[b])
            if ranges[b] >= lidar[2]:
                p += z_max
            total += math.log(p)
        log_weights[i] += total
