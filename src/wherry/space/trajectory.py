"""Trajectories: interpolation, merging, and the formats TUM, CSV and KITTI."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from wherry.errors import InputError
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

    def along_arcs(self, times: Floats) -> Floats:
        """Interpolate poses of a robot that drives at a constant velocity and turn rate from one pose to the next.

        Args:
            times: Times, [M] s; before the first and after the last pose the first and the last motion continue. There
                must be two poses.

        Returns:
            Poses, [M, 3] m, m, rad.
        """
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        first, start = self.poses[after - 1], self.times[after - 1]
        share = (times - start) / np.maximum(self.times[after] - start, MIN_DIVISOR)
        motion = relative(self.poses[after], first)
        half = motion[:, 2] / 2.0
        # The chord of a part of an arc is shorter than that of the whole, and its direction lags by half of the rest.
        scale = share * np.sinc(share * half / np.pi) / np.sinc(half / np.pi)
        lag = np.stack([np.zeros(len(share)), np.zeros(len(share)), (share - 1.0) * half], axis=-1)
        chord = compose(lag, motion)
        return compose(first, np.stack([scale * chord[:, 0], scale * chord[:, 1], share * motion[:, 2]], axis=-1))

    def as_tum(self) -> str:
        """The trajectory as text, one pose per line: ``time x y z qx qy qz qw``."""
        half = self.poses[:, 2] / 2.0
        rows = np.column_stack([self.poses[:, :2], np.zeros((len(half), 3)), np.sin(half), np.cos(half)])
        return "# time x y z qx qy qz qw\n" + "".join(
            " ".join(f"{value:.6f}" for value in (time, *row)) + "\n"
            for time, row in zip(self.times.tolist(), rows.tolist(), strict=True)
        )

    def as_csv(self) -> str:
        """The trajectory as a table with a header, one pose per line: time s, x m, y m, θ rad."""
        return "time,x,y,theta\n" + "".join(
            ",".join(f"{value:.6f}" for value in (time, *pose)) + "\n"
            for time, pose in zip(self.times.tolist(), self.poses.tolist(), strict=True)
        )

    def as_kitti(self) -> str:
        """The poses without times as text, one per line: the upper three rows of its 4 × 4 matrix."""
        cos, sin = np.cos(self.poses[:, 2]), np.sin(self.poses[:, 2])
        zero, one = np.zeros(len(cos)), np.ones(len(cos))
        x, y = self.poses[:, 0], self.poses[:, 1]
        rows = np.column_stack([cos, -sin, zero, x, sin, cos, zero, y, zero, zero, one, zero])
        return "".join(" ".join(f"{value:.9g}" for value in row) + "\n" for row in rows.tolist())


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


TRAJECTORY_FORMATS: Mapping[str, Callable[[Trajectory], str]] = MappingProxyType(
    {"tum": Trajectory.as_tum, "csv": Trajectory.as_csv, "kitti": Trajectory.as_kitti}
)
"""The formats of trajectories by name, which is also the suffix of their files."""


def save_trajectory(trajectory: Trajectory, path: str | Path, format_name: str = "") -> None:
    """Write a trajectory.

    Args:
        trajectory: The trajectory.
        path: Path of the file.
        format_name: Name of the format, a key of `TRAJECTORY_FORMATS`; empty to take that of the path's suffix.

    Raises:
        InputError: There is no such format, or the folder does not exist or cannot be written to.
    """
    name = format_name or Path(path).suffix.removeprefix(".")
    if name not in TRAJECTORY_FORMATS:
        known = ", ".join(TRAJECTORY_FORMATS)
        raise InputError(path, "", f"{name!r} is no format of trajectories; there are {known}")
    write_atomically(path, TRAJECTORY_FORMATS[name](trajectory))


def save_tum(trajectory: Trajectory, path: str | Path) -> None:
    """Write a trajectory in TUM format, as `save_trajectory`."""
    save_trajectory(trajectory, path, "tum")


def _extent(motions: Floats) -> Floats:
    """Extents of motions [N, 3] m, m, rad, including turns, see `HEADING_LEVER`, [N] m."""
    extent: Floats = np.hypot(motions[:, 0], motions[:, 1]) + HEADING_LEVER * np.abs(motions[:, 2])
    return extent
