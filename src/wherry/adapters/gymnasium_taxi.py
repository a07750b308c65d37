"""Gymnasium's own Taxi, unmodified, as an OO-MDP.

It differs from the paper's Taxi in two points. Its observation does not contain where a passenger in the taxi departed,
so the passenger's x and y move with the taxi. And the passenger can be dropped off at all four places, not only at the
destination, so the domain has objects for the places (Gymnasium's "locations").
"""

from __future__ import annotations

from typing import Any, cast

import gymnasium
from gymnasium.envs.toy_text.taxi import TaxiEnv

from wherry.adapters.base import GymnasiumAdapter
from wherry.domains.taxi import DELIVERY_REWARD, ILLEGAL_REWARD, STEP_REWARD
from wherry.domains.walls import WALL, wall_objects
from wherry.errors import InputError
from wherry.floorplan.plan import Cell, Direction, Wall
from wherry.oomdp.attributes import boolean, integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.objects import ObjectClass, Scene, State
from wherry.oomdp.relations import DIRECTIONS, ON, TOUCH_EDGE
from wherry.oomdp.terms import attribute_holds, related

ACTIONS = ("S", "N", "E", "W", "PICKUP", "DROPOFF")
"""Names of Gymnasium's actions, by number."""

GRID_SIZE = 5  # cells along a side
IN_TAXI_LOCATION = 4  # the passenger's location index when in the taxi
OPEN_EDGE = b":"  # character between two cells without a wall, in Gymnasium's map

X, Y = integer("x", 0, GRID_SIZE - 1), integer("y", 0, GRID_SIZE - 1)
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


class GymnasiumTaxi(GymnasiumAdapter):
    """Gymnasium's Taxi as an `Environment` of objects.

    Truncation is ignored: an episode ends only when the passenger arrives.

    Args:
        environment: ``gymnasium.make("Taxi-v4")``, wrapped or not.

    Raises:
        InputError: It is another environment, or a variant with rain or a fickle passenger.
    """

    def __init__(self, environment: gymnasium.Env[Any, Any]) -> None:
        taxi = environment.unwrapped
        if not isinstance(taxi, TaxiEnv):
            raise InputError(str(environment), "", "is not Gymnasium's Taxi")
        is_deterministic = all(len(outcomes) == 1 for actions in taxi.P.values() for outcomes in actions.values())
        if taxi.fickle_passenger or not is_deterministic:
            raise InputError(str(environment), "", "is not deterministic: it rains, or the passenger is fickle")
        super().__init__(environment, DOMAIN, title="Gymnasium's Taxi", action_names=ACTIONS)
        self._taxi = taxi
        places = (PLACE(f"place{index}", x=cell.x, y=cell.y) for index, cell in enumerate(map(_cell, taxi.locs)))
        self._scene = Scene((*wall_objects(self._walls()), *places))

    def _perceive(self, observation: int) -> State:
        return self.state(observation)

    def state(self, observation: int) -> State:
        """Decode one of Gymnasium's observations, 0 to 499."""
        row, column, place, destination = self._taxi.decode(observation)
        taxi, target = _cell((row, column)), _cell(self._taxi.locs[destination])
        passenger = taxi if place == IN_TAXI_LOCATION else _cell(self._taxi.locs[place])
        return State(
            (
                TAXI("taxi", x=taxi.x, y=taxi.y),
                PASSENGER("passenger", x=passenger.x, y=passenger.y, in_taxi=place == IN_TAXI_LOCATION),
                DESTINATION("destination", x=target.x, y=target.y),
            ),
            self._scene,
        )

    def _walls(self) -> list[Wall]:
        """The walls of Gymnasium's map and on its outer edge."""
        walls = []
        for row in range(GRID_SIZE):
            for column in range(GRID_SIZE):
                cell = _cell((row, column))
                characters = cast("list[bytes]", list(self._taxi.desc[1 + row]))
                if characters[2 * column + 2] != OPEN_EDGE:
                    walls.append(Wall.between(cell, Direction.EAST))
                if characters[2 * column] != OPEN_EDGE:
                    walls.append(Wall.between(cell, Direction.WEST))
                if row == 0:
                    walls.append(Wall.between(cell, Direction.NORTH))
                if row == GRID_SIZE - 1:
                    walls.append(Wall.between(cell, Direction.SOUTH))
        return walls


def is_delivered(state: State) -> bool:
    """Whether the passenger has arrived, which ends an episode."""
    passenger, destination = state["passenger"], state["destination"]
    return not passenger.in_taxi and ON.holds(passenger, destination)


def gymnasium_taxi_reward(state: State, action: Action, next_state: State) -> float:
    """R(s, a, s') of Gymnasium's Taxi, for learners to which the reward function is given."""
    if action.name in DIRECTIONS:
        return STEP_REWARD
    if state.objects == next_state.objects:
        return ILLEGAL_REWARD
    return DELIVERY_REWARD if is_delivered(next_state) else STEP_REWARD


def _cell(location: tuple[int, int]) -> Cell:
    """The cell at a row, counted from the top, and a column."""
    row, column = location
    return Cell(column, GRID_SIZE - 1 - row)
