"""Delivery: a robot carries every box to the warehouse (paper, section 3, with boxes instead of passengers).

The paper's seven terms, in its order, are touch_N, touch_S, touch_E, touch_W (robot, wall), on(robot, box),
on(robot, warehouse) and box.in_bot. It differs from Taxi in three points, because robots and boxes have a size:

- A box that is dropped off in the warehouse is removed from the state.
- There may be several boxes, so the terms are deictic (see `wherry.oomdp.terms`).
- A robot with a full fork cannot enter the cell of another box, so touch_D(robot, wall) holds there too.

A carried box keeps the x and y of the cell where it was picked up, and the robot is not "on" a box that is in_bot.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from wherry.domains.walls import WALL, wall_objects
from wherry.errors import InputError
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell, Direction, FloorPlan, Wall
from wherry.oomdp.attributes import boolean, integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry.oomdp.objects import ObjectClass, Scene, State
from wherry.oomdp.relations import DIRECTIONS, ON, TOUCH_EDGE, Relation, cell_of, wall_edge
from wherry.oomdp.terms import Binding, Term, attribute_holds, candidates, related

STEP_REWARD = -1.0
ILLEGAL_REWARD = -10.0  # for PICKUP and DROPOFF without effect, as in Taxi
DELIVERY_REWARD = 20.0

MOVES = {Action(name): name for name in DIRECTIONS}
PICKUP, DROPOFF = Action("PICKUP"), Action("DROPOFF")

WAREHOUSE = ObjectClass("Warehouse", (integer("x"), integer("y")), static=True)
ON_FLOOR = Relation("on", lambda robot, box: not box.in_bot and ON.holds(robot, box))


@dataclass(frozen=True, slots=True)
class BoxState:
    """The state of a box.

    Attributes:
        name: Its name, unique in the state.
        cell: The cell where it stands or, if it is carried, where it was picked up.
        in_bot: Whether the robot carries it.
    """

    name: str
    cell: Cell
    in_bot: bool = False


def _touch(direction: str) -> Term:
    """touch_D(robot, wall), which also holds where another box blocks a robot with a full fork."""
    wall = related(TOUCH_EDGE[direction], "Robot", "Wall")
    dx, dy = DIRECTIONS[direction]

    def holds(state: State, binding: Binding) -> bool:
        if wall.holds(state, binding):
            return True
        boxes = state.of_class("Box")
        for robot in candidates("Robot", state, binding):
            ahead = (robot.x + dx, robot.y + dy)
            if any(cell_of(box) == ahead and not box.in_bot for box in boxes):
                return any(box.in_bot or ON.holds(robot, box) for box in boxes)
        return False

    return Term(wall.name, wall.classes, holds)


TOUCH_TERMS = {direction: _touch(direction) for direction in DIRECTIONS}


def delivery_domain(x_range: tuple[int, int], y_range: tuple[int, int]) -> Domain:
    """The delivery domain for columns and rows within bounds, both inclusive."""
    x, y = integer("x", *x_range), integer("y", *y_range)
    return Domain(
        name="delivery",
        classes=(
            ObjectClass("Robot", (x, y)),
            ObjectClass("Box", (x, y, boolean("in_bot")), removable=True),
            WAREHOUSE,
            WALL,
        ),
        terms=(
            *TOUCH_TERMS.values(),
            related(ON_FLOOR, "Robot", "Box"),
            related(ON, "Robot", "Warehouse"),
            attribute_holds("Box", "in_bot"),
        ),
        actions={"N": (), "S": (), "E": (), "W": (), "PICKUP": (), "DROPOFF": ()},
    )


@dataclass(frozen=True)
class DeliverySite:
    """The static part of a delivery, from which its states are built.

    Attributes:
        walls: Cell edges that the robot cannot cross, including those of obstacles and of the outer edge.
        warehouse: Cells to deliver boxes to.
        x_range: First and last column.
        y_range: First and last row.
        domain: The delivery domain within these bounds.
        scene: Walls and warehouse cells as objects.
    """

    walls: frozenset[Wall]
    warehouse: frozenset[Cell]
    x_range: tuple[int, int]
    y_range: tuple[int, int]
    domain: Domain = field(init=False, repr=False, compare=False)
    scene: Scene = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        cells = (
            WAREHOUSE(f"warehouse{index}", x=cell.x, y=cell.y) for index, cell in enumerate(sorted(self.warehouse))
        )
        object.__setattr__(self, "domain", delivery_domain(self.x_range, self.y_range))
        object.__setattr__(self, "scene", Scene((*wall_objects(self.walls), *cells)))

    @classmethod
    def of_cells(cls, cells: Iterable[Cell], walls: Iterable[Wall], warehouse: Iterable[Cell]) -> DeliverySite:
        """The site of some open cells, which may have negative coordinates; every edge to any other cell is a wall.

        Args:
            cells: Cells that the robot can stand in; at least one.
            walls: Walls between the open cells.
            warehouse: Cells to deliver boxes to.
        """
        open_cells = frozenset(cells)
        closed = {
            Wall.between(cell, direction)
            for cell in open_cells
            for direction in Direction
            if cell.neighbour(direction) not in open_cells
        }
        columns, rows = [cell.x for cell in open_cells], [cell.y for cell in open_cells]
        return cls(
            frozenset(walls) | closed,
            frozenset(warehouse),
            (min(columns), max(columns)),
            (min(rows), max(rows)),
        )

    @classmethod
    def of_plan(cls, plan: FloorPlan) -> DeliverySite:
        """The site of a floor plan."""
        return cls.of_cells(plan.cells(), plan.walls, plan.warehouse)

    def state(self, robot: Cell, boxes: Iterable[BoxState]) -> State:
        """The state of a robot in a cell and of the boxes that are not delivered yet.

        Raises:
            ValueError: A cell lies outside the site's bounds, or two boxes have the same name.
        """
        classes = self.domain.classes_by_name
        items = [classes["Box"](box.name, x=box.cell.x, y=box.cell.y, in_bot=box.in_bot) for box in boxes]
        return State((classes["Robot"]("robot", x=robot.x, y=robot.y), *items), self.scene)


def all_delivered(state: State) -> bool:
    """Whether no box is left, which ends an episode."""
    return not state.of_class("Box")


def boxes_left(state: State) -> int:
    """Number of boxes that are not yet delivered."""
    return len(state.of_class("Box"))


class DeliveryHeuristic:
    """Admissible heuristic: a lower bound on the number of steps until all boxes are delivered.

    For every box on the floor it counts a shortest path from the warehouse to the box and back, PICKUP and DROPOFF,
    except that the path to the first box starts in the robot's cell. Paths respect walls and ignore other boxes.
    """

    def __init__(self) -> None:
        self._distances: dict[tuple[Scene, frozenset[Cell]], dict[Cell, int]] = {}

    def __call__(self, state: State) -> float:
        """h(s); boxes that walls separate from the warehouse are ignored."""
        boxes = state.of_class("Box")
        (robot,) = state.of_class("Robot")
        robot_cell = Cell(robot.x, robot.y)
        from_warehouse = self._distances_from(
            state, frozenset(Cell(item.x, item.y) for item in state.scene.of_class("Warehouse"))
        )
        floor_cells = [
            cell for cell in (Cell(box.x, box.y) for box in boxes if not box.in_bot) if cell in from_warehouse
        ]
        steps = sum(2 * from_warehouse[cell] + 2 for cell in floor_cells)  # both ways, PICKUP and DROPOFF
        if any(box.in_bot for box in boxes):
            return steps + (from_warehouse[robot_cell] + 1 if robot_cell in from_warehouse else 0)
        differences = (  # steps to each box from the robot, less those from the warehouse
            self._distances_from(state, frozenset({cell})).get(robot_cell, math.inf) - from_warehouse[cell]
            for cell in floor_cells
        )
        first_box = min(differences, default=0.0)
        return steps + first_box if math.isfinite(first_box) else 0.0

    def _distances_from(self, state: State, origins: frozenset[Cell]) -> dict[Cell, int]:
        """As `_breadth_first_distances`, cached."""
        cached = self._distances.get((state.scene, origins))
        if cached is None:
            cached = self._distances[state.scene, origins] = _breadth_first_distances(state, origins)
        return cached


def _breadth_first_distances(state: State, origins: frozenset[Cell]) -> dict[Cell, int]:
    """Number of steps from the nearest of some cells to every cell that can be reached from them."""
    walls = state.scene.index("Wall", wall_edge)
    (robot,) = state.of_class("Robot")
    x_range, y_range = robot.object_class.attributes
    steps, queue = dict.fromkeys(origins, 0), deque(origins)
    while queue:
        cell = queue.popleft()
        for direction in Direction:
            neighbour, wall = cell.neighbour(direction), Wall.between(cell, direction)
            is_inside = x_range.admits(neighbour.x) and y_range.admits(neighbour.y)
            if neighbour not in steps and is_inside and (wall.cell.x, wall.cell.y, wall.north) not in walls:
                steps[neighbour] = steps[cell] + 1
                queue.append(neighbour)
    return steps


def delivery_reward(state: State, action: Action, next_state: State) -> float:
    """R(s, a, s')."""
    if action in MOVES:
        return STEP_REWARD
    if state.objects == next_state.objects:
        return ILLEGAL_REWARD
    return DELIVERY_REWARD if action == DROPOFF else STEP_REWARD


def delivery_transition(state: State, action: Action) -> Transition:
    """The true dynamics of a delivery.

    Raises:
        ValueError: There is no such action.
    """
    if action in MOVES:
        next_state = _move(state, MOVES[action])
    elif action == PICKUP:
        next_state = _pick_up(state)
    elif action == DROPOFF:
        next_state = _drop_off(state)
    else:
        raise ValueError(f"delivery has no action {action}")
    return Transition(state, action, next_state, delivery_reward(state, action, next_state), all_delivered(next_state))


def _move(state: State, direction: str) -> State:
    if TOUCH_TERMS[direction].holds(state, {}):
        return state
    (robot,), (dx, dy) = state.of_class("Robot"), DIRECTIONS[direction]
    return state.replace(robot.name, x=robot.x + dx, y=robot.y + dy)


def _pick_up(state: State) -> State:
    (robot,) = state.of_class("Robot")
    boxes = state.of_class("Box")
    if any(box.in_bot for box in boxes):
        return state
    here = next((box for box in boxes if ON_FLOOR.holds(robot, box)), None)
    return state if here is None else state.replace(here.name, in_bot=True)


def _drop_off(state: State) -> State:
    (robot,) = state.of_class("Robot")
    carried = next((box for box in state.of_class("Box") if box.in_bot), None)
    over_warehouse = any(ON.holds(robot, cell) for cell in state.scene.of_class("Warehouse"))
    return state.without(carried.name) if carried is not None and over_warehouse else state


def delivery_grid(plan: FloorPlan, box_count: int | None = None) -> DeterministicMdp:
    """Delivery on the grid of a floor plan.

    Args:
        plan: A plan with a robot and a warehouse.
        box_count: Number of boxes, at random cells in every episode; None for the plan's boxes or, if it has none, for
            its number of boxes.

    Raises:
        InputError: The plan has no robot, no warehouse, or no room for that many boxes.
    """
    site, start = DeliverySite.of_plan(plan), plan.start
    if start is None:
        raise InputError(plan.name, "drawing", "has no robot (one of > ^ < v)")
    if not plan.warehouse:
        raise InputError(plan.name, "drawing", "has no warehouse (w)")
    count = plan.box_count if box_count is None else box_count

    def draw_initial_state(rng: np.random.Generator) -> State:
        cells = plan.boxes if plan.boxes and box_count is None else place_boxes(plan, count, rng).boxes
        return site.state(start, (BoxState(f"box{index}", cell) for index, cell in enumerate(cells, start=1)))

    return DeterministicMdp(site.domain, delivery_transition, draw_initial_state)
