"""Sensor models: the likelihood p(z | x, m) of a scan at every particle's pose (Probabilistic Robotics, chapter 6).

All of them sum logarithms, since the product of many beams' likelihoods underflows.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from wherry.kernels import fastmath_kernel, kernel
from wherry.localization.parameters import AmclParameters
from wherry.robot import Scan
from wherry.space.distance_field import DistanceField
from wherry.space.pose import Floats, Pose


@dataclass(frozen=True, slots=True)
class Beams:
    """Beams of one scan with valid readings.

    Attributes:
        ends: [B, 2] m, ends of the beams, base_link frame.
        origin: Pose of the lidar, base_link frame.
        ranges: [B] m, lengths of the beams.
        range_max: Range from which readings are invalid, m.
    """

    ends: Floats
    origin: Pose
    ranges: Floats
    range_max: float

    def __len__(self) -> int:
        return len(self.ranges)

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Beams:
        """The beams chosen by a mask [B] or by indices."""
        return Beams(self.ends[chosen], self.origin, self.ranges[chosen], self.range_max)

    def evenly_spaced(self, max_count: int) -> Beams:
        """At most ``max_count`` beams, evenly spaced in the order of the beams."""
        if len(self) <= max_count:
            return self
        return self.select(np.linspace(0, len(self) - 1, max_count).astype(np.int64))


def valid_beams(scan: Scan, lidar: Pose, parameters: AmclParameters) -> Beams:
    """The beams of a scan whose readings are finite, within the range limits, and not of the robot's own load.

    Args:
        scan: The scan.
        lidar: Pose of the lidar, base_link frame.
        parameters: The filter's parameters, of which the range limits and the robot's radius are used.
    """
    max_range = min(scan.range_max, parameters.laser_max_range) if parameters.laser_max_range > 0.0 else scan.range_max
    min_range = max(scan.range_min, parameters.laser_min_range)
    with np.errstate(invalid="ignore"):
        indices = np.flatnonzero((scan.ranges >= min_range) & (scan.ranges < max_range))
    ranges, angles = scan.ranges[indices], scan.angles[indices] + lidar.theta
    ends = np.empty((len(indices), 2))
    ends[:, 0] = lidar.x + ranges * np.cos(angles)
    ends[:, 1] = lidar.y + ranges * np.sin(angles)
    beams = Beams(ends, lidar, ranges, max_range)
    if parameters.robot_radius > 0.0:
        return beams.select(np.square(ends).sum(axis=1) > parameters.robot_radius**2)
    return beams


class SensorModel(Protocol):
    """Likelihood of a scan at given poses."""

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """Add log p(scan | particle, map).

        Args:
            particles: [N, 3] m, m, rad, map frame.
            beams: The beams of the scan.
            log_weights: [N] added to in place.
        """
        ...


class LikelihoodField:
    """The likelihood field: a reading is likely if it ends near an obstacle of the map (table 6.3).

    The log likelihoods of all cells are tabulated, so that a beam takes a single lookup.
    """

    def __init__(self, field: DistanceField, parameters: AmclParameters) -> None:
        self._field = field
        self._parameters = parameters
        self._table = np.empty((0, 0), np.float32)
        self._range_max = math.nan

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """See `SensorModel`."""
        if beams.range_max != self._range_max:
            distance = _padded(self._field.distance, self._field.limit)
            self._table = log_likelihood(distance, beams.range_max, self._parameters)
            self._range_max = beams.range_max
        _add_from_table(self._table, _grid_frame(self._field), particles, _kernel_ends(beams), log_weights)


class BeamSkippingLikelihoodField(LikelihoodField):
    """The likelihood field without the beams that agree with hardly any particle (nav2's do_beamskip).

    Unmapped people and boxes then do not bias a posterior that has already converged.
    """

    def __init__(self, field: DistanceField, parameters: AmclParameters) -> None:
        super().__init__(field, parameters)
        self._distance = _padded(field.distance, field.limit)

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """See `SensorModel`."""
        p = self._parameters
        grid_frame, ends = _grid_frame(self._field), _kernel_ends(beams)
        agreeing = _count_agreeing(self._distance, grid_frame, particles, ends, p.beam_skip_distance)
        kept = agreeing >= p.beam_skip_threshold * len(particles)
        if np.count_nonzero(~kept) > p.beam_skip_error_threshold * len(beams):
            kept[:] = True  # if most beams disagree, the posterior itself may be wrong, and all beams are needed
        super().add_log_likelihood(particles, beams.select(kept), log_weights)


def log_likelihood(distance: NDArray[np.float32], range_max: float, parameters: AmclParameters) -> NDArray[np.float32]:
    """Log likelihood of readings by the distance of their ends from the nearest obstacle: z_hit·N(0, σ) + z_rand.

    Args:
        distance: Distances of any shape, m.
        range_max: Maximum range of the lidar, m.
        parameters: The filter's parameters, of which z_hit, z_rand and sigma_hit are used.
    """
    p = parameters
    hit = np.float32(p.z_hit) * np.exp(np.square(distance) * np.float32(-0.5 / p.sigma_hit**2))
    logarithm: NDArray[np.float32] = np.log(hit + np.float32(p.z_rand / range_max))
    return logarithm


class BeamModel:
    """The beam model: a reading is likely if it is as long as the ray to the first obstacle of the map (table 6.1).

    Rays are cast by sphere tracing in the distance field. Unlike the likelihood field, the model makes beams through
    walls improbable.
    """

    def __init__(self, field: DistanceField, parameters: AmclParameters) -> None:
        self._field = field
        p = parameters
        self._mixture = np.array([p.z_hit, p.z_short, p.z_max, p.z_rand, p.sigma_hit, p.lambda_short])

    def add_log_likelihood(self, particles: Floats, beams: Beams, log_weights: Floats) -> None:
        """See `SensorModel`."""
        _add_from_rays(
            self._field.distance,
            _grid_frame(self._field),
            particles,
            beams.ends,
            np.array([beams.origin.x, beams.origin.y]),
            beams.ranges,
            beams.range_max,
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
    """[2, B] m, ends of the beams in the layout of the kernels."""
    return np.ascontiguousarray(beams.ends.T, np.float32)


def _grid_frame(field: DistanceField) -> Floats:
    """[4] the grid's origin x m, y m, θ rad and its resolution m."""
    return np.array([field.origin.x, field.origin.y, field.origin.theta, field.resolution])


def _padded(table: NDArray[np.float32], outside: float) -> NDArray[np.float32]:
    """[H + 2, W + 2] the table with a border that holds the value of all cells off the map."""
    return np.pad(table, 1, constant_values=np.float32(outside))


@fastmath_kernel
def _add_from_table(
    table: NDArray[np.float32], grid_frame: Floats, particles: Floats, ends: NDArray[np.float32], log_weights: Floats
) -> None:
    """Add the sum of the table's values at the beams' ends to the log weight of every particle.

    Args:
        table: [H + 2, W + 2] padded log likelihoods.
        grid_frame: [4] the grid's origin and resolution, see `_grid_frame`.
        particles: [N, 3] m, m, rad.
        ends: [2, B] m, base_link frame.
        log_weights: [N] added to in place.
    """
    flat = table.ravel()
    cells = np.empty(ends.shape[1], np.int32)
    for i in range(len(particles)):
        _find_cells(table.shape, grid_frame, particles[i], ends, cells)
        log_weights[i] += _sum_of(flat, cells)


@fastmath_kernel
def _sum_of(flat: NDArray[np.float32], cells: NDArray[np.int32]) -> float:
    """The sum of the flattened table's values at the cells [B], in an order that the compiler may vectorize."""
    total = np.float32(0.0)
    for b in range(len(cells)):
        total += flat[np.uint64(cells[b])]  # unsigned, so that numba does not check for negative indices
    return float(total)


@kernel
def _count_agreeing(
    table: NDArray[np.float32], grid_frame: Floats, particles: Floats, ends: NDArray[np.float32], max_distance: float
) -> NDArray[np.int64]:
    """[B] particles for which each beam ends within ``max_distance`` m of an obstacle; see `_add_from_table`."""
    flat = table.ravel()
    cells = np.empty(ends.shape[1], np.int32)
    agreeing = np.zeros(ends.shape[1], np.int64)
    for i in range(len(particles)):
        _find_cells(table.shape, grid_frame, particles[i], ends, cells)
        for b in range(len(cells)):
            agreeing[b] += flat[cells[b]] <= max_distance
    return agreeing


@fastmath_kernel
def _find_cells(
    shape: tuple[int, int], grid_frame: Floats, pose: Floats, ends: NDArray[np.float32], cells: NDArray[np.int32]
) -> None:
    """Write the flat indices [B] of the beams' ends in a padded table, without branches so that the loop vectorizes."""
    width, last_column, last_row = np.int32(shape[1]), np.float32(shape[1] - 1), np.float32(shape[0] - 1)
    zero = np.float32(0.0)
    turned_cos, turned_sin = math.cos(grid_frame[2]), math.sin(grid_frame[2])
    dx, dy = pose[0] - grid_frame[0], pose[1] - grid_frame[1]
    x = np.float32((turned_cos * dx + turned_sin * dy) / grid_frame[3] + 1.0)
    y = np.float32((turned_cos * dy - turned_sin * dx) / grid_frame[3] + 1.0)
    cos = np.float32(math.cos(pose[2] - grid_frame[2]) / grid_frame[3])
    sin = np.float32(math.sin(pose[2] - grid_frame[2]) / grid_frame[3])
    for b in range(ends.shape[1]):
        column = np.int32(min(max(x + cos * ends[0, b] - sin * ends[1, b], zero), last_column))
        row = np.int32(min(max(y + sin * ends[0, b] + cos * ends[1, b], zero), last_row))
        cells[b] = row * width + column


@kernel
def trace_ray(
    distance: NDArray[np.float32],
    resolution: float,
    column: float,
    row: float,
    cos: float,
    sin: float,
    max_range: float,
) -> float:
    """Cast a ray by sphere tracing: no step is longer than the distance to the nearest obstacle.

    Args:
        distance: [H, W] m, a distance field.
        resolution: Side of a cell, m.
        column: Column where the ray starts, in cells.
        row: Row where the ray starts, in cells.
        cos: Cosine of the ray's direction in the grid.
        sin: Sine of the ray's direction in the grid.
        max_range: Length at which the ray ends, m.

    Returns:
        Distance to the first occupied cell, m, or ``max_range``; everything off the map is free.
    """
    height, width = distance.shape
    travelled = 0.0
    while travelled < max_range:
        x = column + cos * travelled / resolution
        y = row + sin * travelled / resolution
        if not (0.0 <= x < width and 0.0 <= y < height):
            return max_range
        gap = distance[int(y), int(x)]
        if gap < 0.5 * resolution:
            return travelled
        # The gap is between centres of cells; the ray and the obstacle's surface may each be 0.71 cells from theirs.
        travelled += max(gap - 1.42 * resolution, 0.5 * resolution)
    return max_range


@kernel
def _add_from_rays(
    distance: NDArray[np.float32],
    grid_frame: Floats,
    particles: Floats,
    ends: Floats,
    lidar: Floats,
    ranges: Floats,
    range_max: float,
    mixture: Floats,
    log_weights: Floats,
) -> None:
    """Add the beam model's log likelihood to the log weight of every particle, equations 6.4 to 6.12.

    Args:
        distance: [H, W] m, distances to the nearest obstacle.
        grid_frame: [4] the grid's origin and resolution, see `_grid_frame`.
        particles: [N, 3] m, m, rad, map frame.
        ends: [B, 2] m, ends of the beams, base_link frame.
        lidar: [2] m, position of the lidar, base_link frame.
        ranges: [B] m, lengths of the beams.
        range_max: Maximum range of the lidar, m.
        mixture: [6] z_hit, z_short, z_max, z_rand, sigma_hit m, lambda_short 1/m.
        log_weights: [N] added to in place.
    """
    z_hit, z_short, z_max, z_rand, sigma, decay = mixture
    turned_cos, turned_sin = math.cos(grid_frame[2]), math.sin(grid_frame[2])
    for i in range(len(particles)):
        heading = particles[i, 2]
        x = particles[i, 0] + math.cos(heading) * lidar[0] - math.sin(heading) * lidar[1] - grid_frame[0]
        y = particles[i, 1] + math.sin(heading) * lidar[0] + math.cos(heading) * lidar[1] - grid_frame[1]
        column = (turned_cos * x + turned_sin * y) / grid_frame[3]
        row = (turned_cos * y - turned_sin * x) / grid_frame[3]
        cos, sin = math.cos(heading - grid_frame[2]), math.sin(heading - grid_frame[2])
        total = 0.0
        for b in range(len(ranges)):
            along = (ends[b, 0] - lidar[0]) / ranges[b]
            across = (ends[b, 1] - lidar[1]) / ranges[b]
            expected = trace_ray(
                distance, grid_frame[3], column, row, cos * along - sin * across, sin * along + cos * across, range_max
            )
            error = ranges[b] - expected
            p = z_hit * math.exp(-0.5 * error * error / (sigma * sigma)) + z_rand / range_max
            if error < 0.0:
                p += z_short * decay * math.exp(-decay * ranges[b])
            if ranges[b] >= range_max:
                p += z_max
            total += math.log(p)
        log_weights[i] += total
