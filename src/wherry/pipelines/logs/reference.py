"""Errors of an estimated trajectory against a reference, in the map frame or aligned as by ``evo_ape --align``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.evaluation import absolute_trajectory_error, align, matching_times, position_errors, root_mean_square
from wherry.logs.tables import read_trajectory
from wherry.space.pose import IDENTITY, Floats, Pose
from wherry.space.trajectory import Trajectory

OTHER_FRAME_MIN_ERROR = 0.5  # m, root mean square error in the map frame from which the reference may be in another one
CLOCK_OFFSETS = np.round(np.arange(-5.0, 5.05, 0.1), 1)  # s, of the reference's clock that are tried
MIN_CLOCK_SHARE = 0.5  # share of the compared scans that must have a pose of the reference at another offset
CLOCK_MIN_ERROR = 0.1  # m, aligned error from which they are tried
CLOCK_MIN_RATIO = 3.0  # aligned error ÷ that with the offset from which the clocks differ
OTHER_FRAME_MIN_RATIO = 3.0  # error in the map frame ÷ aligned error from which the reference is in another one


@dataclass(frozen=True, slots=True)
class ReferenceErrors:
    """Distances of a trajectory to its reference.

    Attributes:
        rmse_m: Root mean square distance in the map frame, m; None if the reference is in another frame.
        median_m: Median distance, m, aligned if the reference is in another frame.
        p99_m: 99th percentile of the distances, m, aligned if the reference is in another frame.
        aligned_rmse_m: Root mean square distance after the best rigid alignment of the trajectory, m.
        reference_offset: The reference's frame in the map frame, x m, y m, θ rad; None if it is the map frame.
        reference_scans: Number of scans that the reference has a pose for.
        reference_verdict: What the reference was compared with, in a sentence.
    """

    rmse_m: float | None = None
    median_m: float | None = None
    p99_m: float | None = None
    aligned_rmse_m: float | None = None
    reference_offset: tuple[float, float, float] | None = None
    reference_scans: int | None = None
    reference_verdict: str | None = None


class Reference:
    """A reference trajectory for the scans of a log.

    Args:
        path: Path of the file, for errors.
        trajectory: The reference trajectory.
        times: [N] s, times of the log's scans.
        notes: What was decided in reading it.

    Attributes:
        path: Path of the file.
        notes: What was decided in reading it.
        indices: [M] indices of the scans that the reference has a pose for.
        poses: [M, 3] m, m, rad, the reference's poses at these scans.

    Raises:
        InputError: The reference has no pose for any scan.
    """

    def __init__(self, path: Path, trajectory: Trajectory, times: Floats, notes: tuple[str, ...] = ()) -> None:
        self.path = path
        self.notes = notes
        self._trajectory, self._times = trajectory, times
        self.indices = np.flatnonzero(matching_times(trajectory.times, times))
        if not len(self.indices):
            raise InputError(path, "", _time_mismatch(trajectory.times, times))
        self.poses = trajectory.at(times[self.indices])

    def errors(self, estimated: Floats) -> ReferenceErrors:
        """Compare a trajectory with the reference.

        Args:
            estimated: [N, 3] m, m, rad, estimated poses at the scans so far, map frame.

        Raises:
            InputError: The reference has no pose for any of these scans.
        """
        inside = self.indices < len(estimated)
        poses, reference = estimated[self.indices[inside]], self.poses[inside]
        if not len(poses):
            raise InputError(self.path, "", "has no pose at the time of any localized scan")
        alignment = align(poses, reference)
        aligned = position_errors(poses, reference, alignment)
        direct = position_errors(poses, reference, IDENTITY)
        aligned_rmse, rmse = root_mean_square(aligned), root_mean_square(direct)
        is_other_frame = rmse > max(OTHER_FRAME_MIN_ERROR, OTHER_FRAME_MIN_RATIO * aligned_rmse)
        errors = aligned if is_other_frame else direct
        offset = alignment.inverse
        return ReferenceErrors(
            rmse_m=None if is_other_frame else rmse,
            median_m=float(np.median(errors)),
            p99_m=float(np.quantile(errors, 0.99)),
            aligned_rmse_m=aligned_rmse,
            reference_offset=(offset.x, offset.y, offset.theta) if is_other_frame else None,
            reference_scans=len(poses),
            reference_verdict=_verdict(offset if is_other_frame else None, rmse, aligned_rmse)
            + f"{self._clock_text(estimated, aligned_rmse)}; {len(poses):,} of {len(estimated):,} scans are compared.",
        )

    def _clock_text(self, estimated: Floats, aligned_rmse: float) -> str:
        """By how much the reference's clock differs if poses [N, 3] m, m, rad, fit far better then; else empty."""
        if aligned_rmse < CLOCK_MIN_ERROR:
            return ""
        times = self._times[: len(estimated)]
        errors = []
        for offset in CLOCK_OFFSETS:
            inside = matching_times(self._trajectory.times, times + offset)
            is_comparable = inside.sum() >= MIN_CLOCK_SHARE * len(self.indices)
            reference = self._trajectory.at(times[inside] + offset)
            errors.append(absolute_trajectory_error(estimated[inside], reference) if is_comparable else math.inf)
        best = int(np.argmin(errors))
        if errors[best] * CLOCK_MIN_RATIO > aligned_rmse:
            return ""
        side = "ahead of" if CLOCK_OFFSETS[best] > 0.0 else "behind"
        clock = f"its clock is probably {abs(CLOCK_OFFSETS[best]):.1f} s {side} the log's"
        return f"; {clock}, with which the aligned error would be {errors[best]:.2f} m"


def read_reference(path: Path, times: Floats) -> Reference:
    """Read the reference of a log's scans at times [N] s.

    Raises:
        InputError: The file cannot be read, or has no pose for any scan.
    """
    trajectory, notes = read_trajectory(path)
    return Reference(path, trajectory, times, notes)


def _verdict(offset: Pose | None, rmse: float, aligned_rmse: float) -> str:
    """What the errors mean, without a full stop."""
    if offset is not None:
        return (
            f"The reference is in another frame than the map (offset x {offset.x:.2f} m, y {offset.y:.2f} m, "
            f"{math.degrees(offset.theta):.1f}°), or every pose is wrong by as much: without alignment the error is "
            f"{rmse:.2f} m. Errors are those after alignment"
        )
    if rmse > OTHER_FRAME_MIN_ERROR:
        return (
            f"Trajectory and reference contradict each other, by {rmse:.2f} m and after alignment by "
            f"{aligned_rmse:.2f} m: the trajectory is wrong, or the reference is of another drive or not a rigid copy"
        )
    return "The reference is in the map frame"


def _time_mismatch(reference: Floats, times: Floats) -> str:
    """Why the reference has no pose for any scan."""
    return (
        f"has no pose at the time of any scan: it covers {reference[0]:.3f} to {reference[-1]:.3f} s, "
        f"the log {times[0]:.3f} to {times[-1]:.3f} s"
    )
