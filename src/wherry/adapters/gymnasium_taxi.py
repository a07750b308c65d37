"""Gymnasium's own Taxi, unmodified, seen as an OO-MDP.

It differs from the paper's Taxi in two points. Its number says that the passenger is in the taxi but not from where, so
here the passenger's x and y ride along. And the passenger may be let out at all four places, not at the destination
alone, so there are places to be on.
"""

from __future__ import annotations

from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium.envs.toy_text.taxi import TaxiEnv

from wherry.domains.taxi import DELIVERY_REWARD, ILLEGAL_REWARD, STEP_REWARD, WALL
from wherry.errors import InputError
from wherry.floorplan.plan import Cell, Direction, Wall
from wherry.oomdp.attributes import boolean, integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import ObjectClass, Scene, State
from wherry.oomdp.relations import DIRECTIONS, ON, TOUCH_EDGE
from wherry.oomdp.terms import attribute_holds, related

ACTIONS = ("S", "N", "E", "W", "PICKUP", "DROPOFF")
"""Gymnasium's actions by their numbers."""

SIDE = 5  # cells
IN_TAXI = 4  # the number of the place "in the taxi"
FREE = b":"  # in Gymnasium's drawing, between two cells that no wall divides

X, Y = integer("x", 0, SIDE - 1), integer("y", 0, SIDE - 1)
TAXI = ObjectClass("Taxi", (X, Y))
PASSENGER = ObjectClass("Passenger", (X, Y, boolean("in_taxi")))
DESTINATION = ObjectClass("Destination", (X, Y))
PLACE = ObjectClass("Place", (X, Y), static=True)

DOMAIN = Domain(
    name="gymnasium-taxi",
    classes=(TAXI, PASSENGER, DESTINATION, PLACE, WALL),
    terms=(
        *(related(TOUCH_EDGE[direction], "Taxi", "Wall") for direction in DIRECTIONS),
        related(ON, "Taxi", "Passenger"),
        related(ON, "Taxi", "Destination"),
        related(ON, "Taxi", "Place"),
        attribute_holds("Passenger", "in_taxi"),
    ),
    actions=dict.fromkeys(ACTIONS, ()),
)


class GymnasiumTaxi:
    """An `Environment` of objects around Gymnasium's Taxi.

    Time limits are looked through: an episode ends where the passenger arrives.

    Args:
        environment: What ``gymnasium.make("Taxi-v4")`` gives, wrapped or not.

    Raises:
        InputError: It is another environment, or one in which it rains or the passenger is fickle.
    """

    def __init__(self, environment: gymnasium.Env[Any, Any]) -> None:
        taxi = environment.unwrapped
        if not isinstance(taxi, TaxiEnv):
            raise InputError(str(environment), "", "is not Gymnasium's Taxi")
        certain = all(len(outcomes) == 1 for actions in taxi.P.values() for outcomes in actions.values())
        if taxi.fickle_passenger or not certain:
            raise InputError(str(environment), "", "is not deterministic: it rains, or the passenger is fickle")
        self.domain = DOMAIN
        self.environment = environment
        self._taxi = taxi
        self._state: State | None = None
        walls = sorted(set(self._walls()))
        self._scene = Scene(
            (
                *(WALL(f"wall{at}", x=wall.cell.x, y=wall.cell.y, north=wall.north) for at, wall in enumerate(walls)),
                *(PLACE(f"place{at}", x=cell.x, y=cell.y) for at, cell in enumerate(map(_cell, taxi.locs))),
            )
        )

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode; Gymnasium gets its seed from the generator."""
        observation, _ = self.environment.reset(seed=int(rng.integers(2**31)))
        self._state = self.state(observation)
        return self._state

    def step(self, action: Action) -> Transition:
        """Do an action.

        Raises:
            RuntimeError: No episode has begun.
            ValueError: There is no such action.
        """
        if self._state is None:
            raise RuntimeError("reset the environment before the first step")
        if action.name not in ACTIONS:
            raise ValueError(f"Gymnasium's Taxi has no action {action}")
        before = self._state
        observation, reward, terminated, _, _ = self.environment.step(ACTIONS.index(action.name))
        self._state = self.state(observation)
        return Transition(before, action, self._state, float(reward), terminated)

    def state(self, observation: int) -> State:
        """The state that one of Gymnasium's numbers stands for."""
        row, column, place, destination = self._taxi.decode(observation)
        taxi, wanted = _cell((row, column)), _cell(self._taxi.locs[destination])
        passenger = taxi if place == IN_TAXI else _cell(self._taxi.locs[place])
        return State(
            (
                TAXI("taxi", x=taxi.x, y=taxi.y),
                PASSENGER("passenger", x=passenger.x, y=passenger.y, in_taxi=place == IN_TAXI),
                DESTINATION("destination", x=wanted.x, y=wanted.y),
            ),
            self._scene,
        )

    def _walls(self) -> list[Wall]:
        """The walls of Gymnasium's drawing, and those around it."""
        walls = []
        for row in range(SIDE):
            for column in range(SIDE):
                cell = _cell((row, column))
                characters = cast("list[bytes]", list(self._taxi.desc[1 + row]))
                if characters[2 * column + 2] != FREE:
                    walls.append(Wall.between(cell, Direction.EAST))
                if characters[2 * column] != FREE:
                    walls.append(Wall.between(cell, Direction.WEST))
                if row == 0:
                    walls.append(Wall.between(cell, Direction.NORTH))
                if row == SIDE - 1:
                    walls.append(Wall.between(cell, Direction.SOUTH))
        return walls


def delivered(state: State) -> bool:
    """Whether the passenger has arrived, which ends an episode."""
    passenger, destination = state["passenger"], state["destination"]
    return not passenger.in_taxi and ON.holds(passenger, destination)


def reward(state: State, action: Action, next_state: State) -> float:
    """What Gymnasium pays for a step, for learners that are told."""
    if action.name in DIRECTIONS:
        return STEP_REWARD
    if state.objects == next_state.objects:
        return ILLEGAL_REWARD
    return DELIVERY_REWARD if delivered(next_state) else STEP_REWARD


def _cell(place: tuple[int, int]) -> Cell:
    """The cell at a row from the top and a column."""
    row, column = place
    return Cell(column, SIDE - 1 - row)
