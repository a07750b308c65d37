"""Trajectories: interpolation, merging, and the TUM format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.files import write_atomically
from wherry.space.pose import Floats, compose, relative

HEADING_LEVER = 1.0  # m/rad, distance that a turn counts for in the extent of a motion
MIN_EXTENT = 0.02  # m, extent of a motion below which errors are spread over time instead
MIN_DIVISOR = 1e-9  # s and m, avoids divisions by zero


@dataclass(frozen=True)
class Trajectory:
    """Poses over time.

    Attributes:
        times: Times, [N] s, increasing.
        poses: base_link in the map frame at those times, [N, 3] m, m, rad.
    """

    times: Floats
    poses: Floats

    def at(self, times: Floats, odometry: Trajectory | None = None) -> Floats:
        """Interpolate poses.

        Between two poses the robot moves as odometry measured, and the error of odometry at the second pose is spread
        in proportion to the extent of the motion, as wheel slip is. Without odometry the velocity is constant.

        Args:
            times: Times, [M] s; before the first and after the last pose, odometry extrapolates.
            odometry: Poses in the odom frame, denser in time; None without odometry.

        Returns:
            Poses, [M, 3] m, m, rad.
        """
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        before = after - 1
        first, second = self.poses[before], self.poses[after]
        interval = self.times[after] - self.times[before]
        share = np.clip((times - self.times[before]) / np.maximum(interval, MIN_DIVISOR), 0.0, 1.0)
        if odometry is None:
            return compose(first, relative(second, first) * share[:, None])
        at_times = odometry.at(times)
        at_first, at_second = odometry.at(self.times[before]), odometry.at(self.times[after])
        predicted = compose(first, relative(at_times, at_first))
        predicted_second = compose(first, relative(at_second, at_first))
        done, remaining = _extent(relative(at_times, at_first)), _extent(relative(at_second, at_times))
        whole = done + remaining
        share = np.where(whole > MIN_EXTENT, done / np.maximum(whole, MIN_DIVISOR), share)
        return compose(predicted, relative(second, predicted_second) * share[:, None])

    def as_tum(self) -> str:
        """The trajectory as text, one pose per line: ``time x y z qx qy qz qw``."""
        half = self.poses[:, 2] / 2.0
        rows = np.column_stack([self.times, self.poses[:, :2], np.zeros((len(half), 3)), np.sin(half), np.cos(half)])
        return "# time x y z qx qy qz qw\n" + "".join(
            f"{row[0]:.6f} " + " ".join(f"{v:.6f}" for v in row[1:]) + "\n" for row in rows
        )


def merge_odometry(preferred: Trajectory, dense: Trajectory) -> Trajectory:
    """Merge two records of odometry in the same frame.

    Args:
        preferred: Poses that are used at times that both records contain.
        dense: Poses that are used at all other times.
    """
    times = np.concatenate([preferred.times, dense.times])
    poses = np.vstack([preferred.poses, dense.poses])
    _, first = np.unique(times, return_index=True)
    return Trajectory(times[first], poses[first])


def save_tum(trajectory: Trajectory, path: str | Path) -> None:
    """Write a trajectory in TUM format.

    Raises:
        InputError: The folder does not exist or cannot be written to.
    """
    write_atomically(path, trajectory.as_tum())


def _extent(motions: Floats) -> Floats:
    """Extents of motions [N, 3] m, m, rad, including turns, see `HEADING_LEVER`, [N] m."""
    extent: Floats = np.hypot(motions[:, 0], motions[:, 1]) + HEADING_LEVER * np.abs(motions[:, 2])
    return extent
