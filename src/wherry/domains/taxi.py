"""Taxi (Dietterich 2000): bring a passenger to a destination (paper, section 3; Diuk et al. 2008, section 5).

A passenger in the taxi keeps the x and y of the cell of departure, and the taxi is not "on" that passenger. So the 5×5
grid has 800 states: 25 taxi cells, 4 cells of departure, in the taxi or not, 4 destinations.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace

import numpy as np

from wherry.domains.walls import WALL, wall_objects
from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.floorplan.world_files import find_world
from wherry.oomdp.attributes import boolean, integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import ObjectClass, Scene, State
from wherry.oomdp.relations import DIRECTIONS, ON, TOUCH_EDGE, Relation
from wherry.oomdp.terms import attribute_holds, related

STEP_REWARD = -1.0
ILLEGAL_REWARD = -10.0  # for PICKUP and DROPOFF without effect
DELIVERY_REWARD = 20.0

PUBLISHED_GRIDS = {5: "taxi", 10: "taxi10"}
"""Names of the built-in worlds with the published grids, by the side of the grid in cells."""

PROBES = (
    ((2, 2), "Y", "R"),
    ((2, 2), "Y", "G"),
    ((2, 2), "Y", "B"),
    ((2, 2), "R", "B"),
    ((0, 4), "Y", "R"),
    ((0, 3), "B", "G"),
)
"""Initial states of the published policy test: the taxi's cell, the passenger's mark, the destination's mark."""

ON_STREET = Relation("on", lambda taxi, passenger: not passenger.in_taxi and ON.holds(taxi, passenger))


def taxi_domain(width: int, height: int) -> Domain:
    """The Taxi domain on a grid."""
    x, y = integer("x", 0, width - 1), integer("y", 0, height - 1)
    return Domain(
        name="taxi",
        classes=(
            ObjectClass("Taxi", (x, y)),
            ObjectClass("Passenger", (x, y, boolean("in_taxi"))),
            ObjectClass("Destination", (x, y)),
            WALL,
        ),
        terms=(
            *(related(TOUCH_EDGE[direction], "Taxi", "Wall") for direction in DIRECTIONS),
            related(ON_STREET, "Taxi", "Passenger"),
            related(ON, "Taxi", "Destination"),
            attribute_holds("Passenger", "in_taxi"),
        ),
        actions={"N": (), "S": (), "E": (), "W": (), "PICKUP": (), "DROPOFF": ()},
    )


class TaxiGrid(DeterministicMdp):
    """Taxi on the grid of a floor plan; its marks are where the passenger departs and arrives.

    Args:
        plan: A plan with at least two marks.
    """

    def __init__(self, plan: FloorPlan) -> None:
        super().__init__(taxi_domain(plan.width, plan.height), self._transition, self._draw_initial_state)
        self.plan = plan
        walls = (
            Wall.between(cell, direction)
            for cell in plan.cells()
            for direction in Direction
            if plan.is_blocked(cell, direction)
        )
        self.scene = Scene(wall_objects(walls))

    def state_of(self, taxi: tuple[int, int], passenger: str, destination: str) -> State:
        """The state with the taxi in a cell and the passenger at one mark with another mark as destination."""
        classes = self.domain.classes_by_name
        origin, target = self.plan.marks[passenger], self.plan.marks[destination]
        return State(
            (
                classes["Taxi"]("taxi", x=taxi[0], y=taxi[1]),
                classes["Passenger"]("passenger", x=origin.x, y=origin.y, in_taxi=False),
                classes["Destination"]("destination", x=target.x, y=target.y),
            ),
            self.scene,
        )

    def _draw_initial_state(self, rng: np.random.Generator) -> State:
        """A random initial state: the taxi in any cell, passenger and destination at two different marks."""
        cells, marks = list(self.plan.cells()), sorted(self.plan.marks)
        cell = cells[rng.integers(len(cells))]
        passenger, destination = rng.choice(len(marks), 2, replace=False)
        return self.state_of((cell.x, cell.y), marks[passenger], marks[destination])

    def _transition(self, state: State, action: Action) -> Transition:
        taxi, passenger, destination = state["taxi"], state["passenger"], state["destination"]
        if action.name in DIRECTIONS:
            direction = Direction(DIRECTIONS[action.name])
            moved = Cell(taxi.x, taxi.y).neighbour(direction)
            is_blocked = self.plan.is_blocked(Cell(taxi.x, taxi.y), direction)
            next_state = state if is_blocked else state.replace("taxi", x=moved.x, y=moved.y)
            return Transition(state, action, next_state, STEP_REWARD, terminated=False)
        if action.name == "PICKUP":
            if not ON_STREET.holds(taxi, passenger):
                return Transition(state, action, state, ILLEGAL_REWARD, terminated=False)
            return Transition(state, action, state.replace("passenger", in_taxi=True), STEP_REWARD, terminated=False)
        if action.name == "DROPOFF":
            if not (passenger.in_taxi and ON.holds(taxi, destination)):
                return Transition(state, action, state, ILLEGAL_REWARD, terminated=False)
            next_state = state.replace("passenger", in_taxi=False)
            return Transition(state, action, next_state, DELIVERY_REWARD, terminated=True)
        raise ValueError(f"Taxi has no action {action}")


Variable = tuple[str, str]
"""An attribute of an object, by the object's name and the attribute's."""

TAXI: tuple[Variable, ...] = (("taxi", "x"), ("taxi", "y"))
PASSENGER: tuple[Variable, ...] = (("passenger", "x"), ("passenger", "y"), ("passenger", "in_taxi"))
DESTINATION: tuple[Variable, ...] = (("destination", "x"), ("destination", "y"))


def passenger_location(state: State) -> Hashable:
    """The passenger's location as one variable: a mark's cell, or None in the taxi (Dietterich 2000)."""
    passenger = state["passenger"]
    return None if passenger.in_taxi else (passenger.x, passenger.y)


def published_parents(action: str, variable: Variable) -> tuple[Variable | Callable[[State], Hashable], ...]:
    """The dynamic Bayesian network over Dietterich's variables: taxi's cell, passenger's location, destination.

    PICKUP depends on the first two, DROPOFF on all of them. With this network Factored R-max needs as many steps as
    Diuk et al. (2008) published.

    Args:
        action: Name of the action.
        variable: The predicted variable; one that is not an attribute stands for reward and termination.

    Returns:
        The parents of the variable: attributes, or functions of the state.
    """
    if variable == PASSENGER[2] or variable[0] not in ("taxi", "passenger", "destination"):
        if action == "PICKUP":
            return (*TAXI, passenger_location)
        if action == "DROPOFF":
            return (*TAXI, passenger_location, *DESTINATION)
    return minimal_parents(action, variable)


def minimal_parents(action: str, variable: Variable) -> tuple[Variable, ...]:
    """The smallest correct network: DROPOFF does not depend on where a passenger in the taxi departed.

    Args:
        action: Name of the action.
        variable: The predicted variable; one that is not an attribute stands for reward and termination.

    Returns:
        The parents of the variable.
    """
    if variable in TAXI:
        return TAXI if action in DIRECTIONS else (variable,)
    if variable in DESTINATION or variable in PASSENGER[:2]:
        return (variable,)
    if action in DIRECTIONS:
        return (variable,) if variable in PASSENGER else ()
    return (*TAXI, *PASSENGER) if action == "PICKUP" else (*TAXI, PASSENGER[2], *DESTINATION)


def taxi_grid(size: int) -> TaxiGrid:
    """One of the published grids, 5×5 or 10×10, without the warehouse that the built-in world has for deliveries.

    Raises:
        KeyError: There is no published grid of that size.
    """
    return TaxiGrid(replace(find_world(PUBLISHED_GRIDS[size]), warehouse=frozenset()))
