"""The simulator: builds a world with a robot and a referee from a floor plan, and advances its time."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.robot import BOX_HEIGHT, Body, Odometry, Robot, Scan, Velocity
from wherry.simulation.drive import Drive, WheelOdometry, WheelOdometryErrors
from wherry.simulation.lidar import Lidar, LidarSpecification
from wherry.simulation.model import BODY, LIDAR_HEIGHT, TIMESTEP, build_model
from wherry.simulation.physics import Physics
from wherry.simulation.referee import BoxStatus, BoxTruth, Referee
from wherry.simulation.static_geometry import StaticGeometry
from wherry.space.pose import Floats, Pose

ODOMETRY_RATE = 20.0  # Hz
LATCH_REACH = 0.05  # m from base_link to a box's centre within which the latch can hold the box
MAX_BOX_OFFSET = 0.04  # m from a cell's centre to that of the box placed in it


def build(
    plan: FloorPlan,
    rng: np.random.Generator,
    *,
    lidar: LidarSpecification | None = None,
    odometry_errors: WheelOdometryErrors | None = None,
    box_offsets: Floats | None = None,
) -> Simulation:
    """Build a simulation; the same plan, seed and commands give the same run, bit for bit.

    Args:
        plan: The floor plan, with a robot and with its boxes placed.
        rng: Source of the boxes' offsets and of the sensors' noise.
        lidar: Parameters of the lidar; by default 360 beams at 10 Hz.
        odometry_errors: Errors of the wheel odometry; by default the defaults of `WheelOdometryErrors`.
        box_offsets: [B, 2] offset of each box from its cell's centre, m; by default random, at most `MAX_BOX_OFFSET`.

    Raises:
        InputError: The plan has no robot.
        ValueError: The lidar's rate does not divide the odometry's.
    """
    if plan.start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    box_rng, odometry_rng, lidar_rng = rng.spawn(3)
    geometry = StaticGeometry.from_plan(plan)
    offsets = _random_offsets(len(plan.boxes), box_rng) if box_offsets is None else box_offsets
    boxes = np.array([plan.centre(cell) for cell in plan.boxes]).reshape(-1, 2) + offsets
    robot = Pose(*plan.centre(plan.start), math.atan2(plan.heading.dy, plan.heading.dx))
    physics = Physics(build_model(plan, geometry, robot, boxes), len(boxes))
    return Simulation(
        plan,
        physics,
        Lidar(lidar or LidarSpecification(), geometry, lidar_rng),
        WheelOdometry(odometry_errors or WheelOdometryErrors(), odometry_rng),
        Referee(plan, geometry),
        geometry,
    )


class Simulation:
    """A simulated world; its time advances when the robot waits for a measurement.

    Attributes:
        plan: The floor plan.
        physics: The state of the world in MuJoCo.
        lidar: The robot's lidar.
        drive: The robot's drive.
        referee: Records the ground truth.
        geometry: The walls and obstacles.
        robot: The `Robot`, which gives access to no ground truth.
    """

    def __init__(
        self,
        plan: FloorPlan,
        physics: Physics,
        lidar: Lidar,
        odometry: WheelOdometry,
        referee: Referee,
        geometry: StaticGeometry,
    ) -> None:
        self.plan = plan
        self.physics = physics
        self.lidar = lidar
        self.drive = Drive(BODY)
        self.referee = referee
        self.geometry = geometry
        self._odometry = odometry
        # In odometry messages from one scan to the next.
        self._scan_period, remainder = divmod(ODOMETRY_RATE, lidar.specification.rate)
        if remainder or not self._scan_period:
            raise ValueError(
                f"the lidar's rate of {lidar.specification.rate} Hz must divide the odometry's of {ODOMETRY_RATE} Hz"
            )
        self._steps_per_tick = round(1 / (ODOMETRY_RATE * TIMESTEP))
        self._tick = 0
        self._held: int | None = None
        self._delivered: dict[int, tuple[float, float]] = {}
        self.robot: Robot = SimulatedRobot(self)

    @property
    def time(self) -> float:
        """Time since the simulation was built, s."""
        return self._tick / ODOMETRY_RATE

    @property
    def held(self) -> int | None:
        """Index of the box that the latch holds; None for none."""
        return self._held

    def measure(self) -> list[Scan | Odometry]:
        """The measurements at the present time: odometry, and a scan if it is due."""
        self.referee.record(self.time, self.physics.robot_pose)
        self._update_referee()
        measurements: list[Scan | Odometry] = [
            self._odometry.read(self.time, self.physics.wheel_angles, 1 / ODOMETRY_RATE)
        ]
        if self._tick % self._scan_period == 0:
            boxes = self.physics.box_positions
            visible = boxes[boxes[:, 2] > LIDAR_HEIGHT - BOX_HEIGHT / 2, :2]
            lidar = self.physics.robot_pose @ BODY.lidar
            measurements.append(self.lidar.scan(self.time, lidar, visible, BODY.box_radius))
        return measurements

    def advance(self) -> None:
        """Simulate until the next odometry measurement."""
        physics = self.physics
        for _ in range(self._steps_per_tick):
            physics.step(*self.drive.wheel_speeds(physics.time, TIMESTEP))
            self.referee.record_contacts(physics, self._held)
        self._tick += 1

    def close_latch(self) -> bool:
        """Weld the box in the fork, if any, to the robot; return whether the latch holds a box."""
        if self._held is None:
            distances = np.hypot(*(self.physics.box_positions[:, :2] - self.physics.robot_pose.as_array()[:2]).T)
            in_reach = [box for box in np.flatnonzero(distances <= LATCH_REACH) if box not in self._delivered]
            if in_reach:
                self._held = int(in_reach[0])
                self.physics.hold(self._held)
                self._update_referee()
        return self._held is not None

    def open_latch(self) -> bool:
        """Release the box to the conveyor if the robot is over the warehouse; return whether no box is held."""
        if self._held is not None and self._robot_cell() in self.plan.warehouse:
            box = self._held
            x, y, _ = self.physics.box_positions[box].tolist()
            self.physics.release(box)
            self.physics.take_in(box)
            self._delivered[box] = (x, y)
            self._held = None
            self._update_referee()
        return self._held is None

    def _robot_cell(self) -> Cell:
        """The cell that contains base_link."""
        pose = self.physics.robot_pose
        return self.plan.cell_at(pose.x, pose.y)

    def _update_referee(self) -> None:
        """Give the referee the true state of the boxes."""
        positions = self.physics.box_positions.tolist()
        boxes = []
        for box, cell in enumerate(self.plan.boxes):
            x, y, _ = positions[box]
            status = BoxStatus.HELD if box == self._held else BoxStatus.ON_FLOOR
            if box in self._delivered:
                status = BoxStatus.DELIVERED
            boxes.append(BoxTruth(cell, self._delivered.get(box, (x, y)), status))
        self.referee.boxes = tuple(boxes)


class SimulatedRobot:
    """The `Robot` of a simulation; it gives access to sensors, wheels and latch, but not to the ground truth."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._pending = deque(simulation.measure())

    @property
    def body(self) -> Body:
        """The robot's shape and limits."""
        return BODY

    def receive(self) -> Scan | Odometry:
        """Simulate until the next measurement, and return it."""
        if not self._pending:
            self._simulation.advance()
            self._pending.extend(self._simulation.measure())
        return self._pending.popleft()

    def command(self, velocity: Velocity) -> None:
        """Drive with a velocity until the next command; without one the robot stands still 0.5 s later.

        Raises:
            ValueError: A component is not a finite number.
        """
        self._simulation.drive.command(velocity, self._simulation.time)

    def close_latch(self) -> bool:
        """Close the latch; return whether it holds a box now."""
        return self._simulation.close_latch()

    def open_latch(self) -> bool:
        """Open the latch if the robot is over the warehouse; return whether the fork is empty now."""
        return self._simulation.open_latch()


def _random_offsets(count: int, rng: np.random.Generator) -> Floats:
    """Draw [B, 2] offsets, m, uniformly from the disc of radius `MAX_BOX_OFFSET`."""
    angles = rng.uniform(0.0, math.tau, count)
    lengths = MAX_BOX_OFFSET * np.sqrt(rng.uniform(0.0, 1.0, count))
    return np.column_stack([lengths * np.cos(angles), lengths * np.sin(angles)])
