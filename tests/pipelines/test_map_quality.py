"""Doubts about a map that its own scans and odometry raise."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest

from wherry.logs.lidar_log import LidarLog
from wherry.pipelines.logs.map_quality import MapQuality
from wherry.pipelines.logs.motion_check import compare_motions
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Floats, Pose, compose
from wherry.space.raycast import cast_rays
from wherry.space.trajectory import Trajectory
from wherry_testing.carmen_logs import drive_poses, room

POSES = drive_poses(30)
ANGLES = np.linspace(-math.pi / 2, math.pi / 2, 91)


def odometry(poses: Floats) -> list[Odometry | None]:
    return [Odometry(float(n), Pose.from_array(pose), Velocity()) for n, pose in enumerate(poses)]


def log_of(poses: Floats, measured: Sequence[Odometry | None], lidar: Pose) -> LidarLog:
    """Scans at true poses of a lidar at the centre, said to be at another pose."""
    grid = room()
    ranges = cast_rays(grid.occupied, grid.resolution, grid.origin, poses, ANGLES, 20.0)
    step = float(ANGLES[1] - ANGLES[0])
    scans = tuple(Scan(float(n), scan, float(ANGLES[0]), step, 0.01, 20.0) for n, scan in enumerate(ranges))
    return LidarLog(scans, tuple(measured), Trajectory(np.arange(len(poses), dtype=float), poses), lidar, ())


def test_nothing_speaks_against_a_right_map() -> None:
    quality = MapQuality.of(room(), log_of(POSES, odometry(POSES), Pose()), POSES)
    assert quality.fit > 0.99
    assert (quality.doubt, quality.notes, quality.is_doubtful) == ("", (), False)


def test_scans_off_their_map_are_doubted() -> None:
    shuffled = np.random.default_rng(0).permutation(POSES)
    quality = MapQuality.of(room(), log_of(POSES, [None] * 30, Pose()), shuffled + np.array([0.0, 0.0, 1.5]))
    assert quality.is_doubtful
    assert quality.doubt == f"its own scans do not fit it (fit {quality.fit:.2f})"


def test_mirrored_scans_are_doubted() -> None:
    mirrored = POSES * [1.0, -1.0, -1.0]
    motion = compare_motions(mirrored, odometry(POSES))
    assert motion.turn_ratio == pytest.approx(-1.0)
    assert motion.is_mirrored
    # Odometry of the wrong sign looks the same, and then the map is right.
    assert motion.doubt(Pose()) == (
        "the scans turn the other way than odometry: either the map is mirrored, since the lidar is upside down or its "
        "beams are in reverse order, or odometry turns the wrong way"
    )


@pytest.mark.parametrize(("assumed", "true"), [(0.0, 180.0), (90.0, 0.0), (0.0, -90.0), (170.0, -170.0), (30.0, 0.0)])
def test_a_wrong_heading_of_the_lidar_is_found_with_its_right_value(assumed: float, true: float) -> None:
    error = Pose(0.0, 0.0, math.radians(true - assumed))
    seen = compose(POSES, error.as_array())  # base_link as the scans have it with the assumed mount
    motion = compare_motions(seen, odometry(POSES))
    assert motion.is_wrong == (abs(math.degrees(error.theta)) % 360.0 in (180.0, 90.0))
    text = motion.doubt(Pose(0.0, 0.0, math.radians(assumed)))
    offset = math.degrees(math.remainder(error.theta, 2 * math.pi))
    assert text.startswith(f"by odometry the robot drives at {round(offset)}° ") or abs(offset) == 180.0
    assert any(
        f"either the lidar's θ is {round(angle)}° and not {round(assumed)}°" in text for angle in (true, true - 360)
    )


def test_frozen_reset_and_missing_odometry_raise_no_doubt() -> None:
    frozen, reset = POSES.copy(), POSES.copy()
    frozen[:] = POSES[0]
    reset[15:] = 0.0
    for measured in (odometry(frozen), odometry(reset), [None] * 30, odometry(POSES[:1])):
        motion = compare_motions(POSES[: len(measured)], measured)
        assert not motion.is_wrong
        assert motion.doubt(Pose()) == ""


def test_odometry_with_a_wrong_scale_raises_no_doubt() -> None:
    motion = compare_motions(POSES, odometry(POSES * [0.7, 0.7, 1.0]))
    assert motion.heading_offset == pytest.approx(0.0, abs=1e-9)
    assert motion.turn_ratio == pytest.approx(1.0)
