"""Grid Markov localization: a histogram filter over positions and headings (Fox et al., 1999).

The paper's section 5.A compares Monte Carlo localization with it. It localizes globally, but every cell is stored and
updated, even the improbable ones, and the precision is limited to the size of a cell.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from wherry.localization.parameters import AmclParameters
from wherry.localization.sensor import SENSOR_MODELS, valid_beams
from wherry.robot import Odometry, Scan
from wherry.space.distance_field import DistanceField
from wherry.space.grid_cells import cell_centres
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Floats, Pose, wrap_angles

CELL_SIZE = 0.25  # m, side of the cells of the position
HEADINGS = 72  # bins of the heading, 5° each
SELECTIVE_UPDATE_THRESHOLD = 1e-4  # fraction of the peak below which a cell is left out of the measurement update
MIN_PROBABILITY = 1e-12  # probability that is added to every free cell, so that a kidnapped robot can be found again
PEAK_RADIUS = 2  # cells and bins around the most probable cell over which the estimate is averaged


class GridMarkov:
    """A histogram over poses on a known map.

    Args:
        grid: The map.
        lidar: The lidar's pose, base_link frame.
        parameters: The filter's parameters, of which those of the motion and sensor models are used.
        cell_size: Side of the cells of the position, m.
        headings: Number of heading bins.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        lidar: Pose,
        parameters: AmclParameters,
        cell_size: float = CELL_SIZE,
        headings: int = HEADINGS,
    ) -> None:
        self._parameters = parameters
        self._lidar = lidar
        self._origin = grid.origin
        self._cell_size = cell_size
        field = DistanceField.of(grid, parameters.laser_likelihood_max_dist)
        self._sensor = SENSOR_MODELS[parameters.laser_model_type](field, parameters)
        height, width = (math.ceil(side * grid.resolution / cell_size) for side in grid.probability.shape)
        self._headings = np.arange(headings) * math.tau / headings
        free_rows, free_columns = np.nonzero(grid.free)
        self._free = np.zeros((height, width), np.bool_)
        ratio = grid.resolution / cell_size
        self._free[(free_rows * ratio).astype(int), (free_columns * ratio).astype(int)] = True
        self._belief = np.zeros((headings, height, width), np.float32)
        self._pending_motion = Pose()
        self._odometry: Pose | None = None
        self._is_update_due = True
        self.initialize_globally()

    @property
    def memory(self) -> int:
        """Size of the histogram, bytes."""
        return self._belief.nbytes

    def initialize_globally(self) -> None:
        """Spread the probability evenly over the map's free space."""
        self._belief[:] = self._free
        self._belief /= max(float(self._belief.sum()), 1.0)
        self._is_update_due = True

    def initialize(self, pose: Pose, covariance: Floats) -> None:
        """Set the histogram to a Gaussian.

        Args:
            pose: Mean pose of base_link, map frame.
            covariance: [3, 3] m, m, rad.
        """
        offset = self._poses(np.arange(self._belief.size)) - pose.as_array()
        offset[:, 2] = wrap_angles(offset[:, 2])
        cell_size = np.array([self._cell_size, self._cell_size, math.tau / len(self._headings)])
        widened = covariance + np.diag(cell_size**2) / 4.0
        distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(widened), offset)
        self._belief[:] = np.exp(-0.5 * distance).reshape(self._belief.shape)
        self._is_update_due = True
        self._normalize()

    def update(self, odometry: Odometry, scan: Scan) -> Pose:
        """Process one scan and the odometry of the same instant.

        The histogram is updated once the robot has moved by a cell or turned by a bin, since interpolating smaller
        shifts would only blur it; in between, the estimate is moved on by odometry.

        Returns:
            The mean pose of base_link around the most probable cell, map frame.
        """
        motion = Pose() if self._odometry is None else odometry.pose.relative_to(self._odometry)
        self._odometry = odometry.pose
        self._pending_motion = self._pending_motion @ motion
        has_moved = math.hypot(self._pending_motion.x, self._pending_motion.y) >= self._cell_size
        has_turned = abs(self._pending_motion.theta) >= math.tau / len(self._headings)
        if self._is_update_due or has_moved or has_turned:
            self._predict(self._pending_motion)
            self._correct(scan)
            self._pending_motion = Pose()
            self._is_update_due = False
        return self._mean()

    def _predict(self, motion: Pose) -> None:
        """Shift the layer of every heading by the motion, and blur by its noise: Bel'(x) = Σ p(x | u, x') Bel(x')."""
        moved = np.empty_like(self._belief)
        _, rows, columns = np.indices((1, *self._free.shape))
        for index, heading in enumerate(self._headings):
            angle = heading - self._origin.theta
            dx = (math.cos(angle) * motion.x - math.sin(angle) * motion.y) / self._cell_size
            dy = (math.sin(angle) * motion.x + math.cos(angle) * motion.y) / self._cell_size
            moved[index] = map_coordinates(self._belief[index], [rows[0] - dy, columns[0] - dx], order=1)
        turned = motion.theta * len(self._headings) / math.tau
        whole = math.floor(turned)
        share = turned - whole
        moved = (1.0 - share) * np.roll(moved, whole, axis=0) + share * np.roll(moved, whole + 1, axis=0)
        p = self._parameters
        length, turn = math.hypot(motion.x, motion.y), abs(motion.theta)
        blur = math.sqrt(p.alpha3 * length**2 + p.alpha4 * turn**2) / self._cell_size
        heading_blur = math.sqrt(p.alpha1 * turn**2 + p.alpha2 * length**2) * len(self._headings) / math.tau
        self._belief[:] = gaussian_filter(
            moved, (heading_blur, blur, blur), mode=("wrap", "constant", "constant"), truncate=3.0
        )
        self._normalize()

    def _correct(self, scan: Scan) -> None:
        """Multiply all but negligible cells by the scan's likelihood: Bel(x) ∝ p(z | x, m) Bel'(x)."""
        beams = valid_beams(scan, self._lidar, self._parameters).evenly_spaced(self._parameters.max_beams)
        if not len(beams):
            return
        flat = self._belief.ravel()
        updated = np.flatnonzero(flat > SELECTIVE_UPDATE_THRESHOLD * flat.max())
        log_likelihood = np.zeros(len(updated))
        self._sensor.add_log_likelihood(self._poses(updated), beams, log_likelihood)
        log_likelihood *= min(1.0, self._parameters.independent_beams / len(beams))
        flat[updated] *= np.exp(log_likelihood - log_likelihood.max())
        self._normalize()

    def _poses(self, cells: NDArray[np.int64]) -> Floats:
        """[N, 3] m, m, rad, map frame: centres of cells given by flat indices [N]."""
        heading, row, column = np.unravel_index(cells, self._belief.shape)
        positions = cell_centres(np.column_stack([row, column]), self._origin, self._cell_size)
        return np.column_stack([positions, self._headings[heading]])

    def _normalize(self) -> None:
        self._belief *= self._free
        self._belief /= max(float(self._belief.sum()), 1e-30)
        self._belief += np.float32(MIN_PROBABILITY) * self._free

    def _mean(self) -> Pose:
        """The mean pose over the cells around the most probable one, moved on by the pending motion."""
        peak = np.unravel_index(int(self._belief.argmax()), self._belief.shape)
        ranges = [np.arange(i - PEAK_RADIUS, i + PEAK_RADIUS + 1) for i in peak]
        layer = ranges[0] % self._belief.shape[0]
        row = np.clip(ranges[1], 0, self._belief.shape[1] - 1)
        column = np.clip(ranges[2], 0, self._belief.shape[2] - 1)
        cells = np.ravel_multi_index(np.ix_(layer, row, column), self._belief.shape).ravel()
        cells = np.unique(cells)
        weights = self._belief.ravel()[cells].astype(np.float64)
        weights /= weights.sum()
        poses = self._poses(cells)
        x, y = weights @ poses[:, :2]
        heading = math.atan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
        return Pose(float(x), float(y), heading) @ self._pending_motion
