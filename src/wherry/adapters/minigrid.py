"""MiniGrid's environments, unmodified, seen as OO-MDPs: an agent that faces somewhere, keys, doors, walls and goals.

The whole grid is seen, not only the part in front of the agent. A key that is carried rides along. MiniGrid pays less
the later the goal is reached; a reward that depends on the time is none of the state's, so here success pays 1, and
discounting does the rest. Needs the extra ``wherry[minigrid]``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium
import numpy as np
from minigrid.core.constants import COLOR_NAMES
from minigrid.core.world_object import Door, WorldObj
from minigrid.minigrid_env import MiniGridEnv

from wherry.errors import InputError
from wherry.floorplan.plan import Cell
from wherry.oomdp.attributes import AttributeKind, boolean, enumeration, integer
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.effects import PAPER_TYPES, EffectType
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import Object, ObjectClass, Scene, State
from wherry.oomdp.relations import DIRECTIONS, Relation, cell_of
from wherry.oomdp.terms import attribute_holds, attribute_is, related

ACTIONS = ("left", "right", "forward", "pickup", "drop", "toggle", "done")
"""MiniGrid's actions by their numbers."""

HEADINGS = {"east": "E", "north": "N", "west": "W", "south": "S"}
"""Where the agent may look, each a quarter turn to the left of the one before."""

MINIGRID_HEADINGS = ("east", "south", "west", "north")
"""The same by MiniGrid's numbers."""

STATIC = {"wall": "Wall", "goal": "Goal", "lava": "Lava"}
MOVABLE = {"key": "Key", "door": "Door"}
"""MiniGrid's types of objects, and the classes that they are here."""

SUCCESS = 1.0


def _quarter_turns(before: Any, after: Any) -> int | None:
    """How many quarter turns to the left lead from one heading to another; None for other enumerations."""
    order = list(HEADINGS)
    return (order.index(after) - order.index(before)) % 4 if {before, after} <= set(order) else None


EFFECT_TYPES: Mapping[str, EffectType] = {
    **PAPER_TYPES,
    "turn": EffectType(
        "turn",
        frozenset({AttributeKind.ENUMERATION}),
        between=_quarter_turns,
        apply=lambda heading, turns: list(HEADINGS)[(list(HEADINGS).index(heading) + turns) % 4],
        describe=lambda name, turns: f"{name} turns {('nowhere', 'left', 'about', 'right')[turns]}",
    ),
}
"""What learners need to be given: the paper's effect types, and turns."""


def _ahead(agent: Object) -> tuple[int, int]:
    """The cell in front of the agent."""
    dx, dy = DIRECTIONS[HEADINGS[agent.facing]]
    return agent.x + dx, agent.y + dy


AHEAD = Relation.where_equal("ahead", _ahead, cell_of)
SHUT_AHEAD = Relation("shut_ahead", lambda agent, door: AHEAD.holds(agent, door) and not door.open)
FITS = Relation("fits", lambda key, door: key.held and key.colour == door.colour)


def minigrid_domain(width: int, height: int) -> Domain:
    """The domain of grids of some size; its terms, and so what is learnt with them, are the same for every size."""
    x, y = integer("x", 0, width - 1), integer("y", 0, height - 1)
    colour = enumeration("colour", *COLOR_NAMES)
    return Domain(
        name="minigrid",
        classes=(
            ObjectClass("Agent", (x, y, enumeration("facing", *HEADINGS))),
            ObjectClass("Key", (x, y, colour, boolean("held"))),
            ObjectClass("Door", (x, y, colour, boolean("open"), boolean("locked"))),
            *(ObjectClass(name, (x, y), static=True) for name in STATIC.values()),
        ),
        terms=(
            *(attribute_is("Agent", "facing", heading) for heading in HEADINGS),
            *(related(AHEAD, "Agent", name) for name in (*STATIC.values(), *MOVABLE.values())),
            related(SHUT_AHEAD, "Agent", "Door"),
            attribute_holds("Door", "open"),
            attribute_holds("Door", "locked"),
            attribute_holds("Key", "held"),
            related(FITS, "Key", "Door"),
        ),
        actions=dict.fromkeys(ACTIONS, ()),
    )


class MiniGrid:
    """An `Environment` of objects around one of MiniGrid's.

    Time limits are looked through: an episode ends where MiniGrid says that it terminated.

    Args:
        environment: What ``gymnasium.make("MiniGrid-DoorKey-5x5-v0")`` gives, wrapped or not.

    Raises:
        InputError: It is not one of MiniGrid's.
    """

    def __init__(self, environment: gymnasium.Env[Any, Any]) -> None:
        grid = environment.unwrapped
        if not isinstance(grid, MiniGridEnv):
            raise InputError(str(environment), "", "is not one of MiniGrid's environments")
        self.environment = environment
        self.domain = minigrid_domain(grid.width, grid.height)
        self._grid = grid
        self._names: dict[WorldObj, str] = {}  # of keys and doors
        self._scene = Scene()
        self._state: State | None = None

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode; MiniGrid gets its seed from the generator.

        Raises:
            InputError: The grid has things that this view has no class for: balls and boxes.
        """
        self.environment.reset(seed=int(rng.integers(2**31)))
        classes = self.domain.classes_by_name
        static, self._names = list[Object](), {}
        for cell, thing in self._things():
            if thing.type in STATIC:
                static.append(classes[STATIC[thing.type]](f"{thing.type}{len(static)}", x=cell.x, y=cell.y))
            elif thing.type in MOVABLE:
                self._names[thing] = f"{thing.color}_{thing.type}{len(self._names)}"
            elif thing.type != "floor":
                raise InputError(str(self.environment), thing.type, "has no class in this view")
        self._scene = Scene(tuple(static))
        self._state = self._see()
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
            raise ValueError(f"MiniGrid has no action {action}")
        before = self._state
        _, paid, terminated, _, _ = self.environment.step(ACTIONS.index(action.name))
        self._state = self._see()
        succeeded = terminated and paid == self._grid._reward()  # what success pays at this time
        return Transition(before, action, self._state, SUCCESS if succeeded else 0.0, terminated)

    def _see(self) -> State:
        """The present state."""
        classes = self.domain.classes_by_name
        here = self._cell(*self._grid.agent_pos)
        facing = MINIGRID_HEADINGS[self._grid.agent_dir]
        objects = [classes["Agent"]("agent", x=here.x, y=here.y, facing=facing)]
        things = [(cell, thing) for cell, thing in self._things() if thing in self._names]
        if self._grid.carrying is not None:
            things.append((here, self._grid.carrying))
        for cell, thing in things:
            own = (
                {"open": thing.is_open, "locked": thing.is_locked}
                if isinstance(thing, Door)
                else {"held": thing is self._grid.carrying}
            )
            objects.append(
                classes[MOVABLE[thing.type]](self._names[thing], x=cell.x, y=cell.y, colour=thing.color, **own)
            )
        return State(tuple(objects), self._scene)

    def _things(self) -> Iterator[tuple[Cell, WorldObj]]:
        """All that stands on the grid, cell by cell."""
        grid = self._grid.grid
        for at, thing in enumerate(grid.grid):
            if thing is not None:
                yield self._cell(at % grid.width, at // grid.width), thing

    def _cell(self, column: int, row: int) -> Cell:
        """The cell at a column and a row from the top."""
        return Cell(int(column), self._grid.height - 1 - int(row))


def at_goal(state: State) -> bool:
    """Whether the agent stands on a goal, for learners that are told what they are to do."""
    (agent,) = state.of_class("Agent")
    return cell_of(agent) in state.scene.index("Goal", cell_of)
