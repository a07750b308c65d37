"""The simulator: a floor plan becomes a world with a robot that senses and drives, and a referee that sees all."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from wherry.errors import InputError
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.robot import Body, Odometry, Robot, Scan, Velocity
from wherry.simulation.drive import Drive, EncoderErrors, Encoders
from wherry.simulation.lidar import Lidar, LidarSpecification
from wherry.simulation.model import BODY, BOX_HEIGHT, LIDAR_HEIGHT, TIMESTEP, build_model
from wherry.simulation.physics import Physics
from wherry.simulation.referee import BoxPlace, BoxTruth, Referee
from wherry.simulation.solids import Solids
from wherry.space.pose import Floats, Pose

ODOMETRY_RATE = 20.0  # Hz
LATCH_REACH = 0.05  # m, how far from base_link a box's middle may be for the latch to close around it
LARGEST_BOX_OFFSET = 0.04  # m, how far boxes may stand from the middles of their cells


def build(
    plan: FloorPlan,
    rng: np.random.Generator,
    *,
    lidar: LidarSpecification | None = None,
    encoders: EncoderErrors | None = None,
    box_offsets: Floats | None = None,
) -> Simulation:
    """Build a world with a robot and boxes; the same plan, seed and commands give the same run, bit by bit.

    Args:
        plan: The building, with a robot and with its boxes placed.
        rng: Where the boxes' places in their cells and the sensors' noise come from.
        lidar: The lidar's data sheet; by default 360 beams at 10 Hz.
        encoders: The wheel encoders' errors.
        box_offsets: [B, 2] m, how far each box stands from the middle of its cell; by default random, up to 0.04 m.

    Raises:
        InputError: The plan has no robot.
        ValueError: The lidar's rate does not divide the odometry's.
    """
    if plan.start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    of_boxes, of_encoders, of_lidar = rng.spawn(3)
    solids = Solids.of(plan)
    offsets = _random_offsets(len(plan.boxes), of_boxes) if box_offsets is None else box_offsets
    boxes = np.array([plan.centre(cell) for cell in plan.boxes]).reshape(-1, 2) + offsets
    heading = math.atan2(plan.heading.dy, plan.heading.dx)
    physics = Physics(build_model(plan, solids, Pose(*plan.centre(plan.start), heading), boxes), len(boxes))
    return Simulation(
        plan,
        physics,
        Lidar(lidar or LidarSpecification(), solids, of_lidar),
        Encoders(encoders or EncoderErrors(), of_encoders),
        Referee(plan, solids),
        solids,
    )


class Simulation:
    """A world in which time passes as the robot receives measurements.

    Attributes:
        robot: What drives may know of it: a `Robot`.
        referee: What is true.
    """

    def __init__(
        self, plan: FloorPlan, physics: Physics, lidar: Lidar, encoders: Encoders, referee: Referee, solids: Solids
    ) -> None:
        self.plan = plan
        self.physics = physics
        self.lidar = lidar
        self.drive = Drive(BODY)
        self.referee = referee
        self.solids = solids
        self._encoders = encoders
        self._scan_period, rest = divmod(ODOMETRY_RATE, lidar.specification.rate)  # in ticks of the odometry
        if rest or not self._scan_period:
            raise ValueError(
                f"a lidar cannot turn at {lidar.specification.rate} Hz beside odometry at {ODOMETRY_RATE} Hz"
            )
        self._steps = round(1 / (ODOMETRY_RATE * TIMESTEP))
        self._tick = 0
        self._held: int | None = None
        self._delivered: dict[int, tuple[float, float]] = {}
        self.robot: Robot = SimulatedRobot(self)

    @property
    def time(self) -> float:
        """s, since the world was built."""
        return self._tick / ODOMETRY_RATE

    @property
    def held(self) -> int | None:
        """Which box the latch holds."""
        return self._held

    def measure(self) -> list[Scan | Odometry]:
        """What the sensors say now."""
        self.referee.record(self.time, self.physics.robot_pose)
        self._show_boxes()
        measurements: list[Scan | Odometry] = [
            self._encoders.read(self.time, self.physics.wheel_angles, 1 / ODOMETRY_RATE)
        ]
        if self._tick % self._scan_period == 0:
            boxes = self.physics.box_positions
            seen = boxes[boxes[:, 2] > LIDAR_HEIGHT - BOX_HEIGHT / 2, :2]
            laser = self.physics.robot_pose @ BODY.lidar
            measurements.append(self.lidar.scan(self.time, laser, seen, BODY.box_radius))
        return measurements

    def advance(self) -> None:
        """Let time pass until the next measurement."""
        physics = self.physics
        for _ in range(self._steps):
            physics.step(*self.drive.wheel_speeds(physics.time, TIMESTEP))
            self.referee.watch(physics, self._held)
        self._tick += 1

    def close_latch(self) -> bool:
        """Weld the box that stands in the fork, if there is one, to the robot; return whether it is held."""
        if self._held is None:
            distances = np.hypot(*(self.physics.box_positions[:, :2] - self.physics.robot_pose.as_array()[:2]).T)
            near = [box for box in np.flatnonzero(distances <= LATCH_REACH) if box not in self._delivered]
            if near:
                self._held = int(near[0])
                self.physics.hold(self._held)
                self._show_boxes()
        return self._held is not None

    def open_latch(self) -> bool:
        """Let the box go, if the robot is over the warehouse, whose conveyor takes it; return whether none is held."""
        if self._held is not None and self._cell() in self.plan.warehouse:
            box = self._held
            x, y, _ = self.physics.box_positions[box].tolist()
            self.physics.release(box)
            self.physics.take_in(box)
            self._delivered[box] = (x, y)
            self._held = None
            self._show_boxes()
        return self._held is None

    def _cell(self) -> Cell:
        """The cell that base_link is over."""
        pose, size = self.physics.robot_pose, self.plan.cell_size
        return Cell(math.floor(pose.x / size), math.floor(pose.y / size))

    def _show_boxes(self) -> None:
        """Tell the referee where the boxes are."""
        places = self.physics.box_positions.tolist()
        boxes = []
        for box, cell in enumerate(self.plan.boxes):
            x, y, _ = places[box]
            place = BoxPlace.HELD if box == self._held else BoxPlace.FLOOR
            if box in self._delivered:
                place = BoxPlace.DELIVERED
            boxes.append(BoxTruth(cell, self._delivered.get(box, (x, y)), place))
        self.referee.boxes = tuple(boxes)


class SimulatedRobot:
    """The robot in a simulation, as its driver sees it: sensors, wheels and latch, and nothing of the truth."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._pending = deque(simulation.measure())

    @property
    def body(self) -> Body:
        """The robot's shape and limits."""
        return BODY

    def receive(self) -> Scan | Odometry:
        """Let time pass until the next measurement, and return it."""
        if not self._pending:
            self._simulation.advance()
            self._pending.extend(self._simulation.measure())
        return self._pending.popleft()

    def command(self, velocity: Velocity) -> None:
        """Drive so until the next command, for half a second at most.

        Raises:
            ValueError: A component is not a finite number.
        """
        self._simulation.drive.command(velocity, self._simulation.time)

    def close_latch(self) -> bool:
        """Close the latch; return whether it holds a box now."""
        return self._simulation.close_latch()

    def open_latch(self) -> bool:
        """Open the latch if the warehouse allows it; return whether the fork is free now."""
        return self._simulation.open_latch()


def _random_offsets(count: int, rng: np.random.Generator) -> Floats:
    """[B, 2] m, uniform on a disc."""
    angles = rng.uniform(0.0, math.tau, count)
    lengths = LARGEST_BOX_OFFSET * np.sqrt(rng.uniform(0.0, 1.0, count))
    return np.column_stack([lengths * np.cos(angles), lengths * np.sin(angles)])
