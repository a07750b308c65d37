"""Short traces with every record type, with known values at known times."""

from __future__ import annotations

import numpy as np

from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import (
    CellLayout,
    LearntModel,
    LearntRule,
    MapUpdate,
    Narration,
    ObjectSnapshot,
    PerceivedState,
    Phase,
    Record,
    RobotSnapshot,
    RunStarted,
    StepTaken,
)

TERMS = (
    *(f"touch_{way}(robot, wall)" for way in "NSEW"),
    "on(robot, box)",
    "on(robot, warehouse)",
    "box.in_bot",
)
ACTIONS = ("N", "S", "E", "W", "PICKUP", "DROPOFF")
LASER = [(3.9, 0.0), (3.9, 1.0), (2.0, 2.9)]  # m, map frame
BOX = (2.5, 1.5)  # m


def room(width: int) -> OccupancyGrid:
    """A walled hall, `width` × 40 grid cells of 0.1 m, origin (−1, −1) m; its last column is unknown."""
    probability = np.full((40, width), 0.02, np.float32)
    probability[[0, -1]] = probability[:, 0] = 0.98
    probability[:, -1] = 0.5
    return OccupancyGrid(probability, 0.1, Pose(-1.0, -1.0))


def snapshot_at(time: float, x: float, *, particles: int = 0, has_load: bool = False) -> RobotSnapshot:
    """A snapshot of the robot at (x, 0) m, heading along x."""
    cloud = np.zeros((particles, 3), np.float32)
    cloud[:, 0] = x
    cloud[:, 1] = np.linspace(-0.9, -0.5, particles)
    return RobotSnapshot(
        time=time,
        pose=Pose(x, 0.0, 0.0),
        lidar=Pose(x - 0.15, 0.0, 0.0),
        points=np.array(LASER, np.float32),
        particles=cloud,
        path=np.array([[x, 0.0], [x + 1.0, 0.0]], np.float32),
        boxes=np.array([BOX], np.float32),
        has_load=has_load,
    )


def step_taken(time: float, action: str, unknown: int, *, delivered: int = 0) -> StepTaken:
    """A step under one condition; the learner learns from it while pairs are unknown."""
    plan = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]], np.float32)
    return StepTaken(time, "0010000", action, unknown > 0, True, unknown, delivered, 1 - delivered, plan)


def perceived_state(time: float, *, in_bot: bool) -> PerceivedState:
    """A state with the robot in cell (2, 2) and the box in cell (5, 4)."""
    box = ObjectSnapshot("Box", "box1", (("x", 5), ("y", 4), ("in_bot", in_bot)))
    return PerceivedState(time, f"001000{in_bot:d}", (ObjectSnapshot("Robot", "robot", (("x", 2), ("y", 2))), box))


def short_run(particles: int = 50) -> list[Record]:
    """A delivery: exploring until 4 s, learning until 8 s, the box delivered at 10 s."""
    rule = LearntRule("N", "0000000", "robot.y += 1")
    wider = LearntRule("N", "0******", "robot.y += 1")
    records: list[Record] = [
        RunStarted("deliver", "hall", "Doormax", TERMS, ACTIONS, 0.2, 0.1),
        Narration(0.0, Phase.EXPLORE, "I know nothing of this place."),
        MapUpdate(0.0, room(30), 0.5, 2.0),
        *(snapshot_at(0.2 * step, 0.05 * step) for step in range(11)),
        MapUpdate(2.0, room(51), 0.9, 0.5),
        *(snapshot_at(2.0 + 0.2 * step, 0.5) for step in range(1, 10)),
        CellLayout(
            4.0,
            CellFrame(Pose(-1.0, -1.0), 0.6),
            np.array([[6, 1]], np.int32),
            np.array([[x, 5, 1] for x in range(8)] + [[x, -1, 1] for x in range(8)], np.int32),
        ),
        LearntModel(4.0, (), ()),
        Narration(4.0, Phase.LEARN, "I try what I can do."),
        snapshot_at(4.2, 0.5, particles=particles),
        step_taken(5.0, "N", 3),
        perceived_state(5.0, in_bot=False),
        LearntModel(5.0, (rule,), (("PICKUP", ("0010000", "1010000")),)),
        snapshot_at(5.2, 0.5, particles=particles),
        step_taken(7.0, "N", 1),
        perceived_state(7.0, in_bot=False),
        LearntModel(7.0, (wider,), (("PICKUP", ("0010000", "1010000")),)),
        snapshot_at(7.2, 0.5, particles=particles),
        step_taken(8.0, "PICKUP", 0),
        perceived_state(8.0, in_bot=True),
        snapshot_at(8.2, 0.5, particles=particles, has_load=True),
        step_taken(10.0, "DROPOFF", 0, delivered=1),
        perceived_state(10.0, in_bot=False),
        Narration(10.0, Phase.DONE, "Everything is delivered."),
    ]
    return records


TAXI_TERMS = tuple(
    term.replace("robot", "taxi").replace("box", "passenger").replace("in_bot", "in_taxi") for term in TERMS
)


def taxi_ride() -> list[Record]:
    """A learner on a grid of 4 × 3 cells: the taxi in (1, 1), then with the passenger in (2, 1) and (3, 1)."""

    def at(time: float, x: int, *, in_taxi: bool) -> PerceivedState:
        things = (
            ObjectSnapshot("Destination", "destination", (("x", 3), ("y", 2))),
            ObjectSnapshot("Passenger", "passenger", (("x", 0), ("y", 0), ("in_taxi", in_taxi))),
            ObjectSnapshot("Taxi", "taxi", (("x", x), ("y", 1))),
        )
        return PerceivedState(time, "0000000", things)

    def acted(time: float, action: str, *, learning: bool) -> StepTaken:
        return StepTaken(time, "0000000", action, learning, True, 2, 0, 0, np.empty((0, 2), np.float32))

    edges = [[x, y, 1] for x in range(4) for y in (-1, 2)] + [[x, y, 0] for x in (-1, 3) for y in range(3)]
    return [
        RunStarted("learn", "Taxi", "Doormax", TAXI_TERMS, ACTIONS),
        CellLayout(0.0, CellFrame(Pose(), 1.0), np.empty((0, 2), np.int32), np.array(edges, np.int32)),
        Narration(0.0, Phase.LEARN, "I know nothing of what my actions do."),
        acted(1.0, "E", learning=True),
        at(1.0, 1, in_taxi=False),
        LearntModel(1.0, (LearntRule("E", "**0****", "taxi.x += 1"),), ()),
        acted(1.5, "N", learning=True),
        acted(2.0, "E", learning=True),
        at(2.0, 2, in_taxi=True),
        acted(3.0, "E", learning=False),
        at(3.0, 3, in_taxi=True),
    ]
