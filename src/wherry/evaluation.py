"""How good a trajectory is, by relations between poses that people checked (Kümmerle et al. 2009)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wherry.logs.carmen import read_rows
from wherry.space.pose import Floats, relative
from wherry.space.trajectory import Trajectory

FAR = 60.0  # s


@dataclass(frozen=True)
class Relations:
    """True poses relative to each other.

    Attributes:
        times: [R, 2] s, of the first pose and of the second.
        poses: [R, 3] m, m, rad: the second in the frame of the first, δ*.
    """

    times: Floats
    poses: Floats


def load_relations(path: str | Path) -> Relations:
    """Read relations, a line each: ``t1 t2 x y z roll pitch yaw``.

    Raises:
        InputError: The file cannot be read or a line is broken.
    """
    rows = read_rows(path, widths=(8,))
    return Relations(rows[:, :2], rows[:, [2, 3, 7]])


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """Errors of a trajectory over relations.

    Attributes:
        translational_error_m: Mean length of the translational error.
        translational_sd_m: Its standard deviation.
        rotational_error_deg: Mean absolute angle of the rotational error.
        rotational_sd_deg: Its standard deviation.
        far_translational_error_m: The first one, over relations more than a minute apart; NaN if there are none.
        relations: How many there were.
    """

    translational_error_m: float
    translational_sd_m: float
    rotational_error_deg: float
    rotational_sd_deg: float
    far_translational_error_m: float
    relations: int


def relation_errors(trajectory: Trajectory, relations: Relations, odometry: Trajectory | None = None) -> RelationErrors:
    """Compare a trajectory with relations; nothing is aligned, for only relative poses are compared.

    With δ = x₁⁻¹ x₂ of the trajectory at both times, the error is e = δ*⁻¹ δ (Kümmerle et al. 2009, equation 4).

    Args:
        trajectory: What was estimated.
        relations: What is true; those outside the trajectory's time are compared all the same.
        odometry: To interpolate with (`Trajectory.at`).

    Raises:
        ValueError: There are no relations.
    """
    if len(relations.times) == 0:
        raise ValueError("there are no relations to compare with")
    first, second = trajectory.at(relations.times[:, 0], odometry), trajectory.at(relations.times[:, 1], odometry)
    errors = relative(relative(second, first), relations.poses)
    lengths, angles = np.hypot(errors[:, 0], errors[:, 1]), np.degrees(np.abs(errors[:, 2]))
    far = np.abs(relations.times[:, 1] - relations.times[:, 0]) > FAR
    return RelationErrors(
        translational_error_m=float(lengths.mean()),
        translational_sd_m=float(lengths.std()),
        rotational_error_deg=float(angles.mean()),
        rotational_sd_deg=float(angles.std()),
        far_translational_error_m=float(lengths[far].mean()) if far.any() else float("nan"),
        relations=len(lengths),
    )


def alignment(estimated: Floats, reference: Floats) -> Floats:
    """The rigid motion that brings one set of positions closest to another (Umeyama 1991, without scale).

    Args:
        estimated: [N, 2] m.
        reference: [N, 2] m, the same places.

    Returns:
        [3] m, m, rad: the pose that carries ``estimated`` onto ``reference``.
    """
    middle, target = estimated.mean(axis=0), reference.mean(axis=0)
    a, b = estimated - middle, reference - target
    angle = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    cos, sin = np.cos(angle), np.sin(angle)
    offset = target - np.array([cos * middle[0] - sin * middle[1], sin * middle[0] + cos * middle[1]])
    return np.array([offset[0], offset[1], angle])


def absolute_trajectory_error(estimated: Floats, reference: Floats) -> float:
    """Root mean square distance of positions after the best rigid alignment, m (Sturm et al. 2012).

    Args:
        estimated: [N, 3] or [N, 2] m: poses or positions.
        reference: Likewise, of the same instants.
    """
    x, y, angle = alignment(estimated[:, :2], reference[:, :2])
    cos, sin = np.cos(angle), np.sin(angle)
    moved = estimated[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + (x, y)
    return float(np.sqrt(((moved - reference[:, :2]) ** 2).sum(axis=1).mean()))
