"""Trajectories: poses in between, and the TUM format."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.files import write_atomically
from wherry.space.pose import Floats, compose, relative

LEVER = 1.0  # m; a turn counts as the way of a point so far out
STANDING = 0.02  # m; less than this is no movement


@dataclass(frozen=True)
class Trajectory:
    """Where the robot was.

    Attributes:
        times: [N] s, increasing.
        poses: [N, 3] x m, y m, θ rad: base_link in the map frame.
    """

    times: Floats
    poses: Floats

    def at(self, times: Floats, odometry: Trajectory | None = None) -> Floats:
        """Poses at other times.

        Between two poses the robot moved as odometry says; what odometry then is off by at the second one is spread
        over the movement there, as slip is. Without odometry it is the straight line, at a steady speed.

        Args:
            times: [M] s; before the first pose and after the last one, only odometry tells.
            odometry: Poses in a frame of its own, denser in time.

        Returns:
            [M, 3] m, m, rad.
        """
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        before = after - 1
        first, second = self.poses[before], self.poses[after]
        span = self.times[after] - self.times[before]
        share = np.clip((times - self.times[before]) / np.maximum(span, 1e-9), 0.0, 1.0)
        if odometry is None:
            return compose(first, relative(second, first) * share[:, None])
        moved_at = odometry.at(times)
        moved_first, moved_second = odometry.at(self.times[before]), odometry.at(self.times[after])
        predicted = compose(first, relative(moved_at, moved_first))
        end = compose(first, relative(moved_second, moved_first))
        done, rest = _extent(relative(moved_at, moved_first)), _extent(relative(moved_second, moved_at))
        share = np.where(done + rest > STANDING, done / np.maximum(done + rest, 1e-9), share)
        return compose(predicted, relative(second, end) * share[:, None])

    def as_tum(self) -> str:
        """The trajectory as text, a line a pose: ``time x y z qx qy qz qw``."""
        half = self.poses[:, 2] / 2.0
        rows = np.column_stack([self.times, self.poses[:, :2], np.zeros((len(half), 3)), np.sin(half), np.cos(half)])
        return "# time x y z qx qy qz qw\n" + "".join(
            f"{row[0]:.6f} " + " ".join(f"{v:.6f}" for v in row[1:]) + "\n" for row in rows
        )


def save_tum(trajectory: Trajectory, path: str | Path) -> None:
    """Write a trajectory in TUM format.

    Raises:
        InputError: The folder does not exist or cannot be written to.
    """
    write_atomically(path, trajectory.as_tum())


def _extent(movements: Floats) -> Floats:
    """[N] m, how far movements [N, 3] go, turns included."""
    extent: Floats = np.hypot(movements[:, 0], movements[:, 1]) + LEVER * np.abs(movements[:, 2])
    return extent
