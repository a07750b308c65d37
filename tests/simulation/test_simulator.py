"""The simulated robot: driving, docking, picking up, delivering, and reproducibility."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wherry.errors import InputError
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.robot import Odometry, Robot, Scan, Velocity
from wherry.simulation import BoxStatus, Simulation, build
from wherry.simulation.lidar import LidarSpecification
from wherry.simulation.simulator import MAX_BOX_OFFSET
from wherry.space.pose import Pose
from wherry_testing.halls import CELL, box_in_base, drive, drive_to_x, hall, noise_free, stop, turn_to
from wherry_testing.robot_contract import RobotContract

BOX_X = 4.5 * CELL  # m, centre of the cell of the hall's box in front of the robot


class TestSimulatedRobot(RobotContract):
    @pytest.fixture
    def robot(self) -> Robot:
        return build(hall(), np.random.default_rng(0)).robot


def test_the_robot_starts_at_the_plans_pose() -> None:
    simulation = noise_free(hall())
    assert_allclose(simulation.referee.pose.as_array(), [1.5 * CELL, 2.5 * CELL, 0.0], atol=1e-3)
    first, second = simulation.robot.receive(), simulation.robot.receive()
    assert isinstance(first, Odometry)
    assert isinstance(second, Scan)
    assert first.time == second.time == simulation.time == 0.0
    assert first.pose == Pose()


def test_odometry_comes_at_20_hertz_and_scans_at_10() -> None:
    measurements = drive(noise_free(hall()), 0.0, 0.0, 2.0)
    assert sum(isinstance(measurement, Odometry) for measurement in measurements) == 41
    assert sum(isinstance(measurement, Scan) for measurement in measurements) in {20, 21}


def test_the_robot_drives_straight() -> None:
    simulation = noise_free(hall(o=" "))
    start = simulation.referee.pose
    drive(simulation, 0.5, 0.0, 4.0)
    drive(simulation, -0.5, 0.0, 8.0 - 4.0)
    drive(simulation, 0.5, 0.0, 4.0)
    stop(simulation)
    moved = simulation.referee.pose.relative_to(start)
    assert moved.x > 1.9
    assert abs(moved.y) < 0.001
    assert abs(moved.theta) < 0.001


def test_the_robot_turns_on_the_spot() -> None:
    simulation = noise_free(hall(o=" "))
    start = simulation.referee.pose
    measurements = drive(simulation, 0.0, 1.5, 12.0) + drive(simulation, 0.0, 0.0, 1.0)
    turned = [reading.velocity.angular for reading in measurements if isinstance(reading, Odometry)]
    assert np.median(turned) == pytest.approx(1.5, rel=0.02)
    assert simulation.referee.pose.distance_to(start) < 0.01
    truth = np.unwrap(simulation.referee.trajectory[:, 3])[-1]
    assert truth == pytest.approx(sum(turned) / 20, rel=0.01)


def test_odometry_without_errors_differs_only_by_wheel_slip() -> None:
    simulation = noise_free(hall(o=" "))
    start = simulation.referee.pose
    measurements = []
    for linear, angular, seconds in ((0.5, 0.0, 4.0), (0.0, 1.0, 3.0), (0.0, -1.0, 3.0), (-0.4, 0.3, 4.0)):
        measurements += drive(simulation, linear, angular, seconds)
    measurements += drive(simulation, 0.0, 0.0, 1.0)
    last = [reading for reading in measurements if isinstance(reading, Odometry)][-1]
    truth = simulation.referee.pose.relative_to(start)
    assert last.pose.distance_to(truth) < 0.01 * 3.6
    assert abs(math.remainder(last.pose.theta - truth.theta, math.tau)) < 0.03


def test_odometry_drifts_by_a_few_hundredths_of_a_radian_per_metre() -> None:
    errors = []
    for seed in range(6):
        simulation = build(find_world("small"), np.random.default_rng(seed))
        start, measurements = simulation.referee.pose, []
        for _ in range(3):  # 6 m, there and back
            measurements += drive(simulation, 0.5, 0.0, 2.1) + drive(simulation, -0.5, 0.0, 2.1)
        last = [reading for reading in measurements if isinstance(reading, Odometry)][-1]
        truth = simulation.referee.pose.relative_to(start)
        errors.append(abs(math.remainder(last.pose.theta - truth.theta, math.tau)) / 6.0)
    assert 0.002 < np.median(errors) < 0.03  # rad for each metre


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.04, 0.0), (0.0, 0.03), (-0.028, -0.028), (0.0, -0.035)])
def test_the_robot_docks_turns_around_the_box_and_carries_it(offset: tuple[float, float]) -> None:
    simulation = noise_free(hall(), (offset,))
    drive_to_x(simulation, BOX_X + offset[0])
    before = simulation.physics.box_positions[0, :2]
    assert_allclose(before, np.array([4.5, 2.5]) * CELL + offset, atol=0.001)
    turn_to(simulation, math.pi / 2)
    turn_to(simulation, -math.pi)
    turn_to(simulation, -math.pi / 2)
    turn_to(simulation, 0.0)
    assert np.hypot(*(simulation.physics.box_positions[0, :2] - before)) < 0.01
    assert simulation.robot.close_latch() is True
    docked = box_in_base(simulation, 0)
    drive_to_x(simulation, 2.0)
    turn_to(simulation, 2.0)
    drive(simulation, -0.4, 0.6, 1.0)
    stop(simulation)
    assert_allclose(box_in_base(simulation, 0), docked, atol=0.001)
    assert simulation.referee.boxes[0].status is BoxStatus.HELD
    assert simulation.referee.collisions == []


def test_a_held_box_moves_continuously() -> None:
    simulation = noise_free(hall(), ((0.02, 0.02),))
    drive_to_x(simulation, BOX_X)
    positions = [simulation.physics.box_positions[0].copy()]
    simulation.robot.close_latch()
    for _ in range(60):
        drive(simulation, -0.4, 0.2, 0.05)
        positions.append(simulation.physics.box_positions[0].copy())
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert steps.max() < 0.05 * (0.4 + 0.02) * 1.2
    assert steps[-1] > 0.015


def test_an_unheld_box_stays_behind() -> None:
    simulation = noise_free(hall())
    drive_to_x(simulation, BOX_X)
    drive_to_x(simulation, 1.5)
    assert_allclose(simulation.physics.box_positions[0, :2], [BOX_X, 2.5 * CELL], atol=0.001)


def test_the_latch_holds_only_a_box_within_its_reach() -> None:
    simulation = noise_free(hall())
    drive_to_x(simulation, BOX_X - 0.08)
    assert simulation.robot.close_latch() is False
    drive_to_x(simulation, BOX_X - 0.03)
    assert simulation.robot.close_latch() is True
    assert simulation.robot.close_latch() is True


def _deliver(simulation: Simulation) -> None:
    """Pick up the box in front of the robot and carry it, in reverse, over the warehouse."""
    drive_to_x(simulation, BOX_X)
    simulation.robot.close_latch()
    drive_to_x(simulation, 1.5 * CELL)
    turn_to(simulation, math.pi / 2)
    for _ in range(200):
        if simulation.referee.pose.y < 0.52 * CELL:
            break
        drive(simulation, 0.0 if simulation.referee.pose.y < 0.6 * CELL else -0.3, 0.0, 0.05)
    stop(simulation)


def test_the_interlock_opens_the_latch_only_over_the_warehouse() -> None:
    simulation = noise_free(hall())
    drive_to_x(simulation, BOX_X)
    simulation.robot.close_latch()
    assert simulation.robot.open_latch() is False
    assert simulation.referee.boxes[0].status is BoxStatus.HELD
    drive_to_x(simulation, 1.5 * CELL)
    assert simulation.robot.open_latch() is False


def test_the_warehouse_takes_a_released_box() -> None:
    simulation = noise_free(hall())
    _deliver(simulation)
    released_at = simulation.physics.box_positions[0, :2]
    assert simulation.robot.open_latch() is True
    drive(simulation, 0.0, 0.0, 0.3)
    assert simulation.physics.box_positions[0, 2] == pytest.approx(0.15 - 0.3 * 0.3, abs=0.02)  # it sinks
    drive(simulation, 0.0, 0.0, 2.0)
    assert simulation.referee.boxes[0].status is BoxStatus.DELIVERED
    assert simulation.referee.boxes[0].position == pytest.approx(tuple(released_at), abs=0.01)
    assert simulation.referee.delivered == 1
    sunk_height = simulation.physics.box_positions[0, 2]
    assert sunk_height < -0.3
    drive(simulation, 0.3, 0.0, 4.0)
    assert simulation.physics.box_positions[0, 2] == pytest.approx(sunk_height, abs=0.01)
    assert simulation.robot.close_latch() is False
    assert simulation.robot.open_latch() is True
    assert simulation.referee.collisions == []


def test_the_lidar_sees_a_box_until_the_warehouse_has_taken_it() -> None:
    simulation = noise_free(hall())
    _deliver(simulation)

    def nearest_ahead() -> float:
        (scan,) = [measurement for measurement in drive(simulation, 0.0, 0.0, 0.1) if isinstance(measurement, Scan)]
        return float(scan.ranges[np.abs(scan.angles) < 0.3].min())

    assert nearest_ahead() == pytest.approx(0.07, abs=0.005)
    simulation.robot.open_latch()
    stop(simulation)
    assert nearest_ahead() > 1.0


def test_boxes_stand_near_the_centres_of_their_cells() -> None:
    plan = find_world("taxi")
    offsets = []
    for seed in range(20):
        boxes = build(plan, np.random.default_rng(seed)).referee.boxes
        offsets += [
            np.array(box.position) / CELL - (box.initial_cell.x + 0.5, box.initial_cell.y + 0.5) for box in boxes
        ]
        assert tuple(box.initial_cell for box in boxes) == plan.boxes
    lengths = np.hypot(*np.array(offsets).T) * CELL
    assert MAX_BOX_OFFSET / 2 < lengths.max() <= MAX_BOX_OFFSET + 1e-6


def test_boxes_at_rest_do_not_move() -> None:
    simulation = noise_free(hall())
    before = simulation.physics.box_positions.copy()
    drive(simulation, 0.1, 0.5, 20.0)
    assert_allclose(simulation.physics.box_positions, before, atol=1e-6)


def _run_bytes(simulation: Simulation) -> bytes:
    """All measurements, the trajectory and the collisions of a run of twelve seconds with several manoeuvres."""
    recorded = b""
    for linear, angular, seconds in ((0.5, 0.0, 3.0), (0.0, 1.0, 2.0), (-0.4, 0.3, 3.0), (0.6, -0.5, 4.0)):
        for measurement in drive(simulation, linear, angular, seconds):
            recorded += measurement.ranges.tobytes() if isinstance(measurement, Scan) else repr(measurement).encode()
        simulation.robot.close_latch()
    return recorded + simulation.referee.trajectory.tobytes() + repr(simulation.referee.collisions).encode()


def test_the_same_plan_seed_and_commands_give_the_same_bytes() -> None:
    plan = place_boxes(find_world("rooms"), 4, np.random.default_rng(0))
    runs = [_run_bytes(build(plan, np.random.default_rng(seed))) for seed in (1, 1, 2)]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_simulations_are_independent_of_each_other() -> None:
    expected = _run_bytes(noise_free(hall()))
    first, second = noise_free(hall()), noise_free(hall())
    _deliver(second)
    second.robot.open_latch()
    assert _run_bytes(first) == expected


def test_a_plan_without_a_robot_is_rejected() -> None:
    with pytest.raises(InputError, match="has no robot"):
        build(FloorPlan("plan", 3, 3), np.random.default_rng(0))


def test_the_lidars_rate_must_divide_that_of_the_odometry() -> None:
    simulation = build(hall(), np.random.default_rng(0), lidar=LidarSpecification(rate=5.0, beams=90))
    scans = [measurement for measurement in drive(simulation, 0.0, 0.0, 2.0) if isinstance(measurement, Scan)]
    assert np.allclose(np.diff([scan.time for scan in scans]), 0.2)
    assert len(scans[0].ranges) == 90
    with pytest.raises(ValueError, match=r"rate of 7\.0 Hz must divide"):
        build(hall(), np.random.default_rng(0), lidar=LidarSpecification(rate=7.0))


def _speed(work: Callable[[], object], simulation: Simulation) -> float:
    """Simulated time ÷ processor time of a function call."""
    started, before = time.process_time(), simulation.time
    work()
    return (simulation.time - before) / (time.process_time() - started)


def test_the_simulation_is_much_faster_than_real_time() -> None:
    plan = place_boxes(find_world("rooms"), 4, np.random.default_rng(0))
    simulation = build(plan, np.random.default_rng(0))
    drive(simulation, 0.3, 0.0, 1.0)  # compiles the kernels

    def manoeuvre() -> None:
        for _ in range(10):
            drive(simulation, 0.4, 0.2, 1.5)
            drive(simulation, -0.4, -0.2, 1.5)

    assert max(_speed(manoeuvre, simulation) for _ in range(3)) > 75  # 250 on an idle machine


def test_a_command_lasts_until_the_next_one() -> None:
    simulation = noise_free(hall())
    simulation.robot.command(Velocity(0.3))
    while simulation.time < 0.3:
        simulation.robot.receive()
    assert simulation.referee.trajectory[-1, 1] - simulation.referee.trajectory[0, 1] > 0.03
