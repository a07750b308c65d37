"""Errors of trajectories: against relative poses (Kümmerle et al. 2009), and after alignment (Sturm et al. 2012)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.logs.tables import in_seconds, read_rows
from wherry.space.pose import MAX_COORDINATE, Floats, Pose, relative
from wherry.space.trajectory import Trajectory

__all__ = [
    "RelationErrors",
    "Relations",
    "absolute_trajectory_error",
    "align",
    "load_relations",
    "matching_times",
    "position_errors",
    "relation_errors",
    "root_mean_square",
]

MAX_TIME_DIFFERENCE = 0.01  # s between a pose and the reference's nearest pose up to which they are compared, as in evo
MAX_INTERPOLATED_GAP = 1.0  # s between two poses of a reference up to which it is interpolated
FAR_RELATION_TIME = 60.0  # s between the poses of a relation above which it counts as far


@dataclass(frozen=True)
class Relations:
    """True relative poses between times of a trajectory, verified by hand.

    Attributes:
        times: Times of the first and of the second pose, [R, 2] s.
        poses: True pose δ* at the second time in the frame of the first, [R, 3] m, m, rad.
        notes: What was decided in reading them.
    """

    times: Floats
    poses: Floats
    notes: tuple[str, ...] = ()


def load_relations(path: str | Path) -> Relations:
    """Read relations, one per line: ``t1 t2 x y z roll pitch yaw``.

    Raises:
        InputError: The file cannot be read, or a line is malformed.
    """
    rows = read_rows(path, widths=(8,), stamps=2)
    beyond = np.flatnonzero((np.abs(rows[:, 2:]) > MAX_COORDINATE).any(axis=1))
    if len(beyond):
        raise InputError(path, f"relation {beyond[0] + 1}", f"has a coordinate beyond {MAX_COORDINATE:g} m")
    times, notes = in_seconds(rows[:, :2], path)
    return Relations(times, rows[:, [2, 3, 7]], notes)


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Errors of a trajectory over relations.

    Attributes:
        translational_error_m: Mean translational error, m.
        translational_sd_m: Standard deviation of the translational error, m.
        rotational_error_deg: Mean absolute rotational error, degrees.
        rotational_sd_deg: Standard deviation of the absolute rotational error, degrees.
        far_translational_error_m: Mean translational error of the relations more than a minute apart, m; NaN if there
            are none.
        relations: Number of relations.
    """

    translational_error_m: float
    translational_sd_m: float
    rotational_error_deg: float
    rotational_sd_deg: float
    far_translational_error_m: float
    relations: int


def relation_errors(trajectory: Trajectory, relations: Relations, odometry: Trajectory | None = None) -> RelationErrors:
    """Compare a trajectory with relations; only relative poses are compared, so no alignment is needed.

    With δ = x₁⁻¹ x₂ of the trajectory at both times, the error is e = δ*⁻¹ δ (Kümmerle et al. 2009, equation 4).

    Args:
        trajectory: The estimate.
        relations: True relative poses; beyond the trajectory's time, see `Trajectory.at`.
        odometry: Odometry to interpolate the trajectory with, see `Trajectory.at`; None without odometry.

    Raises:
        ValueError: There are no relations.
    """
    if len(relations.times) == 0:
        raise ValueError("there are no relations to compare with")
    first, second = trajectory.at(relations.times[:, 0], odometry), trajectory.at(relations.times[:, 1], odometry)
    errors = relative(relative(second, first), relations.poses)
    lengths, angles = np.hypot(errors[:, 0], errors[:, 1]), np.degrees(np.abs(errors[:, 2]))
    far = np.abs(relations.times[:, 1] - relations.times[:, 0]) > FAR_RELATION_TIME
    return RelationErrors(
        translational_error_m=float(lengths.mean()),
        translational_sd_m=float(lengths.std()),
        rotational_error_deg=float(angles.mean()),
        rotational_sd_deg=float(angles.std()),
        far_translational_error_m=float(lengths[far].mean()) if far.any() else float("nan"),
        relations=len(lengths),
    )


def align(estimated: Floats, reference: Floats, *, heading_lever: float = 0.0) -> Pose:
    """Least-squares rigid alignment of estimated poses with true ones (Umeyama 1991, without scale).

    The frame of a map is arbitrary, so errors are computed after the alignment that fits the whole trajectory best.

    Args:
        estimated: Poses [N, 3] m, m, rad, or positions [N, 2] m if headings have no weight; N ≥ 1.
        reference: True poses or positions at the same times, of the same shape.
        heading_lever: Weight of an error of the heading relative to one of the position, m/rad; 0 to fit positions
            alone. With headings, a robot that hardly moved can be aligned too.

    Returns:
        The estimates' frame in the reference frame.
    """
    source, target = estimated[:, :2], reference[:, :2]
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    a, b = source - source_mean, target - target_mean
    cosines = float(np.sum(a * b))
    sines = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    if heading_lever > 0.0:
        turns = reference[:, 2] - estimated[:, 2]
        cosines += heading_lever**2 * float(np.cos(turns).sum())
        sines += heading_lever**2 * float(np.sin(turns).sum())
    theta = math.atan2(sines, cosines)
    offset = target_mean - Pose(theta=theta).transform(source_mean[None, :])[0]
    return Pose(float(offset[0]), float(offset[1]), theta)


def position_errors(estimated: Floats, reference: Floats, alignment: Pose) -> Floats:
    """Distances between positions, [N] m.

    Args:
        estimated: Poses [N, 3] m, m, rad, or positions [N, 2] m.
        reference: True poses or positions at the same times.
        alignment: The estimates' frame in the reference frame, see `align`.
    """
    errors: Floats = np.hypot(*(alignment.transform(estimated[:, :2]) - reference[:, :2]).T)
    return errors


def root_mean_square(errors: Floats) -> float:
    """Root mean square of errors [N], in their unit."""
    return math.sqrt(float(np.mean(errors**2)))


def matching_times(reference: Floats, times: Floats) -> NDArray[np.bool_]:
    """Whether a reference has a pose for each time: a near one in time, or two around it to interpolate between.

    Args:
        reference: Times of the reference's poses, [R] s, not decreasing.
        times: [N] s.
    """
    after = np.searchsorted(reference, times)
    padded = np.concatenate([[-np.inf], reference, [np.inf]])
    to_previous, to_next = times - padded[after], padded[after + 1] - times
    is_near = np.minimum(to_previous, to_next) <= MAX_TIME_DIFFERENCE
    has_pose: NDArray[np.bool_] = is_near | (to_previous + to_next <= MAX_INTERPOLATED_GAP)
    return has_pose


def absolute_trajectory_error(estimated: Floats, reference: Floats) -> float:
    """Root mean square position error after the best rigid alignment, m (Sturm et al. 2012).

    Args:
        estimated: Poses [N, 3] m, m, rad, or positions [N, 2] m.
        reference: True poses or positions at the same times.
    """
    return root_mean_square(position_errors(estimated, reference, align(estimated, reference)))
