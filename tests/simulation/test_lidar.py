"""The simulated lidar: exact ranges, noise, and limits."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from wherry.floorplan.generation import generate_world, place_boxes
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.simulation import build
from wherry.simulation.lidar import Lidar, LidarSpecification, exact_ranges
from wherry.simulation.model import BODY, BOX_RADIUS
from wherry.simulation.static_geometry import StaticGeometry, clearance
from wherry.space.pose import Pose
from wherry_testing.halls import hall, noise_free

ROOM = StaticGeometry.from_plan(FloorPlan("room", 5, 4, cell_size=1.0))
NO_BOXES = np.empty((0, 2))
CROSS = np.array([0.0, math.pi / 2, math.pi, -math.pi / 2])


def test_ranges_in_an_empty_room() -> None:
    assert_allclose(exact_ranges(ROOM, Pose(2.0, 1.0, 0.0), CROSS, NO_BOXES, 0.1), [2.97, 2.97, 1.97, 0.97])
    assert_allclose(exact_ranges(ROOM, Pose(2.0, 1.0, math.pi / 2), CROSS, NO_BOXES, 0.1), [2.97, 1.97, 0.97, 2.97])
    oblique = exact_ranges(ROOM, Pose(2.0, 1.0, 0.0), np.array([math.atan2(3, 4)]), NO_BOXES, 0.1)
    assert_allclose(oblique, [2.97 * 5 / 4])


def test_a_box_occludes_the_wall_behind_it() -> None:
    boxes = np.array([[4.0, 1.0], [2.0, 3.9]])
    assert_allclose(exact_ranges(ROOM, Pose(2.0, 1.0, 0.0), CROSS, boxes, 0.2), [1.8, 2.7, 1.97, 0.97])
    passing = exact_ranges(ROOM, Pose(2.0, 1.0, 0.0), np.array([math.asin(0.2 / 2.0) + 1e-6]), boxes[:1], 0.2)
    assert passing[0] > 2.9


def test_rays_that_start_in_a_wall_have_range_zero() -> None:
    assert_allclose(exact_ranges(ROOM, Pose(0.0, 1.0, 0.0), CROSS, NO_BOXES, 0.1), 0.0)


@pytest.mark.parametrize("seed", range(3))
def test_ranges_equal_those_of_mujoco(seed: int) -> None:
    rng = np.random.default_rng(seed)
    plan = place_boxes(generate_world(12, 9, rng, obstacle_fraction=0.06), 6, rng)
    simulation = build(plan, rng)
    model, data, geometry = simulation.physics.model, simulation.physics.data, simulation.geometry
    mujoco.mj_forward(model, data)
    boxes = simulation.physics.box_positions[:, :2]
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    geom_ids, expected = np.empty(360, dtype=np.int32), np.empty(360)
    group = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)  # only geoms of group 0, without the robot's
    compared = 0
    while compared < 30:
        pose = Pose(*rng.uniform((0.0, 0.0), (7.2, 5.4)), rng.uniform(-math.pi, math.pi))
        is_outside_boxes = np.hypot(boxes[:, 0] - pose.x, boxes[:, 1] - pose.y).min() > BOX_RADIUS
        if clearance(geometry, pose.as_array()[None, :2])[0] == 0 or not is_outside_boxes:
            continue
        directions = np.column_stack([np.cos(angles + pose.theta), np.sin(angles + pose.theta), np.zeros(360)])
        start = np.array([pose.x, pose.y, 0.2])
        mujoco.mj_multiRay(model, data, start, directions.ravel(), group, 1, -1, geom_ids, expected, None, 360, 1e9)
        assert_allclose(exact_ranges(geometry, pose, angles, boxes, BOX_RADIUS), expected, atol=1e-9)
        compared += 1


def test_ranges_ahead_behind_left_and_right_of_the_rear_lidar() -> None:
    simulation = noise_free(hall(o=" "))
    simulation.robot.receive()
    scan = simulation.robot.receive()
    pose = simulation.referee.pose
    ahead = 8 * 0.6 - 0.03 - (pose.x - 0.17)
    ranges = {angle: scan.ranges[np.argmin(np.abs(scan.angles - angle))] for angle in CROSS}
    assert_allclose(list(ranges.values())[:2], [ahead, 4 * 0.6 - 0.03 - pose.y], atol=1e-3)
    assert_allclose(scan.ranges[0], pose.x - 0.17 - 0.03, atol=1e-3)
    assert scan.angle_min == -math.pi
    assert len(scan.ranges) == 360


def test_the_robot_does_not_occlude_its_lidar() -> None:
    simulation = noise_free(hall(o=" "))
    simulation.robot.receive()
    assert simulation.robot.receive().ranges.min() > 0.35


def test_noise_has_the_given_sigma_and_repeats_with_the_seed() -> None:
    exact = Lidar(LidarSpecification(noise=0.0), ROOM, np.random.default_rng(0)).scan(0.0, Pose(2, 1), NO_BOXES, 0.1)
    noisy, again = (Lidar(LidarSpecification(), ROOM, np.random.default_rng(3)) for _ in range(2))
    errors = []
    for time in range(50):
        scan = noisy.scan(time, Pose(2, 1), NO_BOXES, 0.1)
        errors.append(scan.ranges - exact.ranges)
        assert np.array_equal(scan.ranges, again.scan(time, Pose(2, 1), NO_BOXES, 0.1).ranges)
    assert np.std(errors) == pytest.approx(0.01, rel=0.03)
    assert abs(np.mean(errors)) < 0.0003


def test_ranges_beyond_the_maximum_are_infinite() -> None:
    lidar = Lidar(LidarSpecification(range_max=2.5, noise=0.0), ROOM, np.random.default_rng(0))
    scan = lidar.scan(0.0, Pose(2, 1), NO_BOXES, 0.1)
    assert np.isinf(scan.ranges[180])
    assert scan.ranges[0] == pytest.approx(1.97)
    assert scan.valid.sum() == np.isfinite(scan.ranges).sum()


def test_a_docked_box_is_in_range() -> None:
    lidar = Lidar(
        LidarSpecification(noise=0.0), StaticGeometry.from_plan(find_world("small")), np.random.default_rng(0)
    )
    base = Pose(2.0, 2.0, 0.7)
    scan = lidar.scan(0.0, base @ BODY.lidar, np.array([[2.0, 2.0]]), BOX_RADIUS)
    assert scan.ranges[180] == pytest.approx(-BODY.lidar.x - BOX_RADIUS)
    assert scan.valid.all()
