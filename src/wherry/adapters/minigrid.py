"""MiniGrid's environments, unmodified, as OO-MDPs: an agent with a heading, keys, doors, walls and goals.

The states are fully observed. A carried key moves with the agent. MiniGrid's reward for success decreases with time and
so is not a function of the state; here it is 1, and discounting favours short episodes. Needs the extra
``wherry[minigrid]``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium
from minigrid.core.constants import COLOR_NAMES
from minigrid.core.world_object import Door, WorldObj
from minigrid.minigrid_env import MiniGridEnv

from wherry.adapters.base import GymnasiumAdapter
from wherry.errors import InputError
from wherry.floorplan.plan import Cell
from wherry.oomdp.attributes import AttributeKind, boolean, enumeration, integer
from wherry.oomdp.domain import Domain
from wherry.oomdp.effects import PAPER_TYPES, EffectType
from wherry.oomdp.objects import Object, ObjectClass, Scene, State
from wherry.oomdp.relations import DIRECTIONS, Relation, cell_of
from wherry.oomdp.terms import attribute_holds, attribute_is, related

ACTIONS = ("left", "right", "forward", "pickup", "drop", "toggle", "done")
"""Names of MiniGrid's actions, by number."""

HEADINGS = {"east": "E", "north": "N", "west": "W", "south": "S"}
"""The agent's headings with their directions; each is a quarter turn to the left of the previous one."""

MINIGRID_HEADINGS = ("east", "south", "west", "north")
"""The headings in the order of MiniGrid's numbers."""

STATIC_CLASSES = {"wall": "Wall", "goal": "Goal", "lava": "Lava"}
"""The classes of objects that never change, by MiniGrid's object type."""

CHANGING_CLASSES = {"key": "Key", "door": "Door"}
"""The classes of objects that can change, by MiniGrid's object type."""

SUCCESS_REWARD = 1.0  # instead of MiniGrid's, which decreases with the number of steps


def _quarter_turns(before: Any, after: Any) -> int | None:
    """Number of quarter turns to the left from one heading to another; None for values that are not headings."""
    order = list(HEADINGS)
    return (order.index(after) - order.index(before)) % 4 if {before, after} <= set(order) else None


MINIGRID_EFFECT_TYPES: Mapping[str, EffectType] = {
    **PAPER_TYPES,
    "turn": EffectType(
        "turn",
        frozenset({AttributeKind.ENUMERATION}),
        between=_quarter_turns,
        apply=lambda heading, turns: list(HEADINGS)[(list(HEADINGS).index(heading) + turns) % 4],
        describe=lambda name, turns: f"{name} {('does not turn', 'turns left', 'turns around', 'turns right')[turns]}",
    ),
}
"""The effect types that learners need for MiniGrid: the paper's, and quarter turns of the agent."""


def _ahead(agent: Object) -> tuple[int, int]:
    """The cell in front of the agent."""
    dx, dy = DIRECTIONS[HEADINGS[agent.facing]]
    return agent.x + dx, agent.y + dy


AHEAD = Relation.where_equal("ahead", _ahead, cell_of)
"""The object is in the cell in front of the agent."""

SHUT_AHEAD = Relation("shut_ahead", lambda agent, door: AHEAD.holds(agent, door) and not door.open)
"""The door in front of the agent is not open."""

FITS = Relation("fits", lambda key, door: key.held and key.colour == door.colour)
"""The agent carries the key, and its colour is the door's."""


def minigrid_domain(width: int, height: int) -> Domain:
    """The domain of grids of a width and height in cells; all sizes have the same terms, so rules carry over."""
    x, y = integer("x", 0, width - 1), integer("y", 0, height - 1)
    colour = enumeration("colour", *COLOR_NAMES)
    return Domain(
        name="minigrid",
        classes=(
            ObjectClass("Agent", (x, y, enumeration("facing", *HEADINGS))),
            ObjectClass("Key", (x, y, colour, boolean("held"))),
            ObjectClass("Door", (x, y, colour, boolean("open"), boolean("locked"))),
            *(ObjectClass(name, (x, y), static=True) for name in STATIC_CLASSES.values()),
        ),
        terms=(
            *(attribute_is("Agent", "facing", heading) for heading in HEADINGS),
            *(related(AHEAD, "Agent", name) for name in (*STATIC_CLASSES.values(), *CHANGING_CLASSES.values())),
            related(SHUT_AHEAD, "Agent", "Door"),
            attribute_holds("Door", "open"),
            attribute_holds("Door", "locked"),
            attribute_holds("Key", "held"),
            related(FITS, "Key", "Door"),
        ),
        actions=dict.fromkeys(ACTIONS, ()),
    )


class MiniGrid(GymnasiumAdapter):
    """One of MiniGrid's environments as an `Environment` of objects.

    Truncation is ignored: an episode ends only when MiniGrid terminates it.

    Args:
        environment: ``gymnasium.make("MiniGrid-DoorKey-5x5-v0")`` or another one, wrapped or not.

    Raises:
        InputError: It is not one of MiniGrid's environments.
    """

    def __init__(self, environment: gymnasium.Env[Any, Any]) -> None:
        grid = environment.unwrapped
        if not isinstance(grid, MiniGridEnv):
            raise InputError(str(environment), "", "is not one of MiniGrid's environments")
        super().__init__(environment, minigrid_domain(grid.width, grid.height), title="MiniGrid", action_names=ACTIONS)
        self._grid = grid
        self._names: dict[WorldObj, str] = {}  # of keys and doors
        self._scene = Scene()

    def _begin_episode(self) -> None:
        """Name the keys and doors of a new grid, and collect its static objects.

        Raises:
            InputError: The grid contains objects that the domain has no class for: balls or boxes.
        """
        classes = self.domain.classes_by_name
        static_objects, self._names = list[Object](), {}
        for cell, item in self._grid_objects():
            if item.type in STATIC_CLASSES:
                static_objects.append(
                    classes[STATIC_CLASSES[item.type]](f"{item.type}{len(static_objects)}", x=cell.x, y=cell.y)
                )
            elif item.type in CHANGING_CLASSES:
                self._names[item] = f"{item.color}_{item.type}{len(self._names)}"
            elif item.type != "floor":
                raise InputError(str(self.environment), item.type, "has no class in this domain")
        self._scene = Scene(tuple(static_objects))

    def _reward(self, reward: float, *, terminated: bool) -> float:
        """The constant reward for success; 0 for all other steps."""
        succeeded = terminated and reward == self._grid._reward()
        return SUCCESS_REWARD if succeeded else 0.0

    def _perceive(self, observation: object) -> State:
        """Read the current state from the grid, since MiniGrid's observation shows only a part of it."""
        classes = self.domain.classes_by_name
        agent_cell = self._cell(*self._grid.agent_pos)
        facing = MINIGRID_HEADINGS[self._grid.agent_dir]
        objects = [classes["Agent"]("agent", x=agent_cell.x, y=agent_cell.y, facing=facing)]
        items = [(cell, item) for cell, item in self._grid_objects() if item in self._names]
        if self._grid.carrying is not None:
            items.append((agent_cell, self._grid.carrying))
        for cell, item in items:
            own_values = (
                {"open": item.is_open, "locked": item.is_locked}
                if isinstance(item, Door)
                else {"held": item is self._grid.carrying}
            )
            object_class = classes[CHANGING_CLASSES[item.type]]
            objects.append(object_class(self._names[item], x=cell.x, y=cell.y, colour=item.color, **own_values))
        return State(tuple(objects), self._scene)

    def _grid_objects(self) -> Iterator[tuple[Cell, WorldObj]]:
        """All objects on the grid with their cells, row by row from the top."""
        grid = self._grid.grid
        for index, item in enumerate(grid.grid):
            if item is not None:
                yield self._cell(index % grid.width, index // grid.width), item

    def _cell(self, column: int, row: int) -> Cell:
        """The cell at a column and a row, counted from the top."""
        return Cell(int(column), self._grid.height - 1 - int(row))


def is_at_goal(state: State) -> bool:
    """Whether the agent stands on a goal, for learners to which the termination function is given."""
    (agent,) = state.of_class("Agent")
    return cell_of(agent) in state.scene.index("Goal", cell_of)
