"""A short run with everything in it, at places that tests know."""

from __future__ import annotations

import numpy as np

from wherry.space.frame import CellFrame
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.records import (
    Began,
    CellsLaid,
    Explored,
    Learnt,
    LearntRule,
    Perceived,
    Record,
    Said,
    Seen,
    Stepped,
    Thing,
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
    """A hall of so many grid cells of 0.1 m by 40, walled, from (−1, −1) on; a column of unknown at its end."""
    probability = np.full((40, width), 0.02, np.float32)
    probability[[0, -1]] = probability[:, 0] = 0.98
    probability[:, -1] = 0.5
    return OccupancyGrid(probability, 0.1, Pose(-1.0, -1.0))


def seen(time: float, x: float, *, particles: int = 0, loaded: bool = False) -> Seen:
    """The robot at (x, 0), looking along x."""
    cloud = np.zeros((particles, 3), np.float32)
    cloud[:, 0] = x
    cloud[:, 1] = np.linspace(-0.9, -0.5, particles)
    return Seen(
        time=time,
        pose=Pose(x, 0.0, 0.0),
        lidar=Pose(x - 0.15, 0.0, 0.0),
        points=np.array(LASER, np.float32),
        particles=cloud,
        path=np.array([[x, 0.0], [x + 1.0, 0.0]], np.float32),
        boxes=np.array([BOX], np.float32),
        loaded=loaded,
    )


def stepped(time: float, action: str, unknown: int, *, delivered: int = 0) -> Stepped:
    """An action."""
    plan = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0]], np.float32)
    return Stepped(time, "0010000", action, unknown > 0, True, unknown, delivered, 1 - delivered, plan)


def perceived(time: float, *, in_bot: bool) -> Perceived:
    """The robot's cell is (2, 2), the box's (5, 4)."""
    box = Thing("Box", "box1", (("x", 5), ("y", 4), ("in_bot", in_bot)))
    return Perceived(time, f"001000{in_bot:d}", (Thing("Robot", "robot", (("x", 2), ("y", 2))), box))


def short_run(particles: int = 50) -> list[Record]:
    """Exploring from 0 to 4 s, learning to 8 s, the box delivered at 10 s."""
    rule = LearntRule("N", "0000000", "robot.y += 1")
    wider = LearntRule("N", "0******", "robot.y += 1")
    records: list[Record] = [
        Began("deliver", "hall", "Doormax", TERMS, ACTIONS, 0.2, 0.1),
        Said(0.0, "explore", "I know nothing of this place."),
        Explored(0.0, room(30), 0.5, 2.0),
        *(seen(0.2 * step, 0.05 * step) for step in range(11)),
        Explored(2.0, room(51), 0.9, 0.5),
        *(seen(2.0 + 0.2 * step, 0.5) for step in range(1, 10)),
        CellsLaid(
            4.0,
            CellFrame(Pose(-1.0, -1.0), 0.6),
            np.array([[6, 1]], np.int32),
            np.array([[x, 5, 1] for x in range(8)] + [[x, -1, 1] for x in range(8)], np.int32),
        ),
        Learnt(4.0, (), ()),
        Said(4.0, "learn", "I try what I can do."),
        seen(4.2, 0.5, particles=particles),
        stepped(5.0, "N", 3),
        perceived(5.0, in_bot=False),
        Learnt(5.0, (rule,), (("PICKUP", ("0010000", "1010000")),)),
        seen(5.2, 0.5, particles=particles),
        stepped(7.0, "N", 1),
        perceived(7.0, in_bot=False),
        Learnt(7.0, (wider,), (("PICKUP", ("0010000", "1010000")),)),
        seen(7.2, 0.5, particles=particles),
        stepped(8.0, "PICKUP", 0),
        perceived(8.0, in_bot=True),
        seen(8.2, 0.5, particles=particles, loaded=True),
        stepped(10.0, "DROPOFF", 0, delivered=1),
        perceived(10.0, in_bot=False),
        Said(10.0, "done", "Everything is delivered."),
    ]
    return records


TAXI_TERMS = tuple(
    term.replace("robot", "taxi").replace("box", "passenger").replace("in_bot", "in_taxi") for term in TERMS
)


def taxi_ride() -> list[Record]:
    """A learner on a grid of 4 by 3 cells: the taxi is in (1, 1), then with the passenger in (2, 1)."""

    def at(time: float, x: int, *, in_taxi: bool) -> Perceived:
        things = (
            Thing("Destination", "destination", (("x", 3), ("y", 2))),
            Thing("Passenger", "passenger", (("x", 0), ("y", 0), ("in_taxi", in_taxi))),
            Thing("Taxi", "taxi", (("x", x), ("y", 1))),
        )
        return Perceived(time, "0000000", things)

    def acted(time: float, action: str, *, learning: bool) -> Stepped:
        return Stepped(time, "0000000", action, learning, True, 2, 0, 0, np.empty((0, 2), np.float32))

    edges = [[x, y, 1] for x in range(4) for y in (-1, 2)] + [[x, y, 0] for x in (-1, 3) for y in range(3)]
    return [
        Began("learn", "Taxi", "Doormax", TAXI_TERMS, ACTIONS),
        CellsLaid(0.0, CellFrame(Pose(), 1.0), np.empty((0, 2), np.int32), np.array(edges, np.int32)),
        Said(0.0, "learn", "I know nothing of what my actions do."),
        acted(1.0, "E", learning=True),
        at(1.0, 1, in_taxi=False),
        Learnt(1.0, (LearntRule("E", "**0****", "taxi.x += 1"),), ()),
        acted(1.5, "N", learning=True),
        acted(2.0, "E", learning=True),
        at(2.0, 2, in_taxi=True),
        acted(3.0, "E", learning=False),
        at(3.0, 3, in_taxi=True),
    ]
