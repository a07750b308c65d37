"""Mapping with faulty odometry: scan matching outvotes it, says so, and goes on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.odometry_check import (
    ContradictionKind,
    OdometryContradiction,
    describe_contradictions,
    is_plausible,
)
from wherry.mapping.particle_slam import ParticleSlam
from wherry.mapping.scan_matching_localizer import ScanMatchingLocalizer
from wherry.mapping.settings import ParticleSlamSettings
from wherry.mapping.slam import Slam
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Floats, Pose, relative
from wherry_testing.buildings import LIDAR, Drive, corridor_waypoints, drive, identical_rooms
from wherry_testing.odometry_faults import FAULTS, Fault, frozen, jump, measured

MAX_GRAPH_ERROR = 0.05  # m, root mean square error of the trajectory of graph SLAM
MAX_PARTICLE_ERROR = 0.12  # m, of particle SLAM, whose error without faults is 0.06 m
COMMON_FAULTS = ("constant", "reset", "jump of 1 m", "frozen for 5 s", "heading jump of 90°", "garbage")


def graph_slam() -> GraphSlam:
    return GraphSlam(LIDAR)


def particle_slam() -> ParticleSlam:
    return ParticleSlam(LIDAR, np.random.default_rng(0), ParticleSlamSettings(particles=10))


def error(slam: Slam, driven: Drive, odometry: list[Odometry | None] | list[Odometry]) -> float:
    """Root mean square position error of a mapped drive, m, aligned at the first pose."""
    for scan, measurement in zip(driven.scans, odometry, strict=True):
        slam.add(scan, measurement)
    slam.finish()
    off = relative(slam.trajectory.poses, driven.truth)
    return float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean()))


def ahead(driven: Drive) -> Drive:
    """The drive with a lidar that sees 180° ahead."""
    scans = [replace(scan, ranges=scan.ranges[90:271].copy(), angle_min=-math.pi / 2.0) for scan in driven.scans]
    return replace(driven, scans=scans)


@pytest.fixture(scope="module")
def driven() -> Drive:
    return drive(noise=0.01, drift=0.03, seed=1)


@pytest.mark.parametrize("name", FAULTS)
def test_faulty_odometry_is_outvoted_by_graph_slam(driven: Drive, name: str) -> None:
    slam = graph_slam()
    assert error(slam, driven, measured(driven, FAULTS[name], np.random.default_rng(0))) < MAX_GRAPH_ERROR
    assert slam.odometry_contradictions


@pytest.mark.parametrize(
    "name", [name if name in COMMON_FAULTS else pytest.param(name, marks=pytest.mark.slow) for name in FAULTS]
)
def test_faulty_odometry_is_outvoted_by_particle_slam(driven: Drive, name: str) -> None:
    slam = particle_slam()
    assert error(slam, driven, measured(driven, FAULTS[name], np.random.default_rng(0))) < MAX_PARTICLE_ERROR
    assert slam.odometry_contradictions


@pytest.mark.slow
@pytest.mark.parametrize("name", FAULTS)
@pytest.mark.parametrize("seed", [2, 3])
def test_every_drive_and_lidar_outvotes_faulty_odometry(name: str, seed: int) -> None:
    for spacing in (0.05, 0.3):
        other = drive(noise=0.02, drift=0.02, seed=seed, spacing=spacing)
        odometry = measured(other, FAULTS[name], np.random.default_rng(seed))
        assert error(graph_slam(), other, odometry) < MAX_GRAPH_ERROR, f"spacing {spacing}"
    if name == "backwards":
        return  # a lidar that only looks ahead along the corridor sees too little of its end to contradict it
    half = ahead(drive(noise=0.01, drift=0.02, seed=seed))
    assert error(graph_slam(), half, measured(half, FAULTS[name], np.random.default_rng(seed))) < MAX_GRAPH_ERROR


@pytest.mark.parametrize("spacing", [0.05, 0.3])
def test_correct_odometry_is_never_contradicted(spacing: float) -> None:
    right = drive(noise=0.01, drift=0.03, spacing=spacing)
    slam = graph_slam()
    assert error(slam, right, right.odometry) < 0.02
    assert not slam.odometry_contradictions


@pytest.mark.parametrize("create", [graph_slam, particle_slam])
def test_odometry_may_have_holes_and_return_with_another_origin(driven: Drive, create: Callable[[], Slam]) -> None:
    odometry: list[Odometry | None] = [*driven.odometry]
    for begin, end in ((100, 160), (300, 301), (400, 500)):
        odometry[begin:end] = [None] * (end - begin)
        odometry[end:] = [
            replace(later, pose=Pose(40.0, -7.0, 2.0) @ later.pose) for later in odometry[end:] if later is not None
        ]
    slam = create()
    assert error(slam, driven, odometry) < (MAX_GRAPH_ERROR if isinstance(slam, GraphSlam) else MAX_PARTICLE_ERROR)
    assert not slam.odometry_contradictions


@pytest.mark.parametrize("create", [graph_slam, particle_slam])
def test_without_odometry_the_map_is_right(driven: Drive, create: Callable[[], Slam]) -> None:
    slam = create()
    limit = MAX_GRAPH_ERROR if isinstance(slam, GraphSlam) else MAX_PARTICLE_ERROR
    assert error(slam, driven, [None] * len(driven.scans)) < limit
    assert not slam.odometry_contradictions


@pytest.mark.parametrize("create", [graph_slam, particle_slam])
def test_scans_without_returns_and_with_other_beam_counts_are_mapped(driven: Drive, create: Callable[[], Slam]) -> None:
    rng = np.random.default_rng(0)
    scans = [_with_beams(scan, int(rng.integers(350, 361))) for scan in driven.scans]
    for dark in (0, 1, 200, 201, 202, 203, 350):
        scans[dark] = replace(scans[dark], ranges=np.full_like(scans[dark].ranges, np.inf))
    scans[100] = replace(scans[100], time=scans[99].time)
    slam = create()
    limit = MAX_GRAPH_ERROR if isinstance(slam, GraphSlam) else MAX_PARTICLE_ERROR
    assert error(slam, replace(driven, scans=scans), driven.odometry) < limit
    assert not slam.odometry_contradictions


def test_seldom_scans_without_odometry_are_placed_by_a_wide_search() -> None:
    """At one scan in seconds the last velocity predicts neither the start of a drive nor its end."""
    seldom = drive(noise=0.01, spacing=0.6)
    scans = [replace(scan, time=3.0 * n) for n, scan in enumerate(seldom.scans)]
    slam = graph_slam()
    assert error(slam, replace(seldom, scans=scans), [None] * len(scans)) < MAX_GRAPH_ERROR


def test_a_lidar_that_is_dark_at_first_still_gets_a_map_without_odometry() -> None:
    right = drive(noise=0.01, spacing=0.05)
    dark = [replace(scan, ranges=np.full_like(scan.ranges, np.nan)) for scan in right.scans[:3]]
    blind_start = replace(right, scans=[*dark, *right.scans[3:]])
    slam = graph_slam()
    for scan in blind_start.scans:
        slam.add(scan)
    poses = slam.trajectory.poses[3:]
    off = relative(relative(poses, poses[0]), relative(right.truth[3:], right.truth[3]))
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    assert slam.grid().occupied.any()


def test_motion_without_scans_and_odometry_stays_bounded() -> None:
    right = drive(noise=0.01, spacing=0.05)
    slam = graph_slam()
    for scan in right.scans[:80]:
        last = slam.add(scan)
    for n in range(600):
        scan = right.scans[80]
        dark = replace(scan, time=scan.time + 0.1 * n, ranges=np.full_like(scan.ranges, np.inf))
        assert slam.add(dark).distance_to(last) < 2.5


def _with_beams(scan: Scan, count: int) -> Scan:
    """The scan without its last beams, as lidars send whose motor's speed varies."""
    return replace(scan, ranges=scan.ranges[:count].copy())


def test_a_bare_corridor_does_not_contradict_odometry() -> None:
    """Scans that look the same everywhere tell nothing about the distance along a corridor."""
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    with np.errstate(divide="ignore"):
        ranges = 1.0 / np.abs(np.sin(angles))
    ranges[ranges > 8.0] = np.inf
    slam = GraphSlam()
    for n in range(60):
        scan = Scan(0.5 * n, ranges, -math.pi, math.tau / 360, 0.05, 8.0)
        pose = slam.add(scan, Odometry(0.5 * n, Pose(0.2 * n), Velocity()))
    assert pose.x == pytest.approx(0.2 * 59, abs=0.05)
    assert not slam.odometry_contradictions


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (FAULTS["constant"], ContradictionKind.STOPPED),
        (frozen(3.0), ContradictionKind.STOPPED),
        (jump(6.0), ContradictionKind.JUMP),
        (FAULTS["double distances"], ContradictionKind.DISTANCE),
        (FAULTS["mirrored heading"], ContradictionKind.TURN),
    ],
)
def test_contradictions_name_their_kind(driven: Drive, fault: Fault, kind: ContradictionKind) -> None:
    slam = graph_slam()
    error(slam, driven, measured(driven, fault, np.random.default_rng(0)))
    kinds = [contradiction.kind for contradiction in slam.odometry_contradictions]
    assert max(set(kinds), key=kinds.count) is kind


def test_contradictions_are_told_in_a_sentence() -> None:
    stopped = [OdometryContradiction(0.5 * n, 0.5 * n - 0.5, Pose(), Pose(0.25)) for n in (10, 11)]
    jumped = OdometryContradiction(8.0, 7.9, Pose(6.0, 0.0, 0.1), Pose(0.05))
    assert describe_contradictions([], 100) == ""
    assert describe_contradictions([jumped], 100) == (
        "scan matching contradicts odometry at 1 of 100 scans, at 8.000 s (1 × a jump); the map follows the scans there"
    )
    assert describe_contradictions([*stopped, jumped], 405) == (
        "scan matching contradicts odometry at 3 of 405 scans, between 5.000 and 8.000 s (2 × no motion, 1 × a jump); "
        "the map follows the scans there"
    )


def test_speeds_are_only_judged_by_a_clock_that_runs() -> None:
    assert is_plausible(Pose(0.4), 0.05)
    assert not is_plausible(Pose(6.0), 0.1)
    assert not is_plausible(Pose(0.0, 0.0, math.pi), 0.1)
    assert is_plausible(Pose(1.5), 0.0), "rounded times, as in old logs"


def test_localization_on_a_finished_map_survives_a_jump_of_odometry(driven: Drive) -> None:
    slam = graph_slam()
    error(slam, driven, driven.odometry)
    other = drive(noise=0.01, drift=0.03, seed=5)
    localizer = ScanMatchingLocalizer(slam, start=Pose(0.05, -0.03, 0.02))
    faulty = measured(other, jump(3.0, math.radians(90.0)), np.random.default_rng(0))
    poses = np.array([localizer.add(*pair).as_array() for pair in zip(other.scans, faulty, strict=True)])
    off: Floats = relative(poses, other.truth)[1:]
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    assert localizer.odometry_contradictions


@pytest.mark.slow
def test_identical_rooms_do_not_make_right_odometry_a_liar() -> None:
    waypoints = corridor_waypoints([(1, 1), (3, -1)])
    right = drive(noise=0.01, drift=0.02, blocked=identical_rooms(), waypoints=waypoints, range_max=8.0)
    slam = graph_slam()
    assert error(slam, right, right.odometry) < 0.2
    assert len(slam.odometry_contradictions) <= 2
