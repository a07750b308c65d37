"""Deterministic OO-MDPs on a grid as Gymnasium environments: the general one, and the two that are registered."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from wherry.domains.delivery import delivery_grid
from wherry.domains.taxi import taxi_grid
from wherry.environments.observations import Observation, ObservationEncoder
from wherry.environments.rendering import Sprite, render_rgb, render_text
from wherry.errors import InputError
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.oomdp.mdp import DeterministicMdp
from wherry.oomdp.objects import Object, State

RED, GREEN, BLUE, YELLOW, BROWN = (209, 36, 47), (26, 156, 75), (31, 111, 235), (244, 196, 48), (160, 98, 45)

SpriteFunction = Callable[[State], list[Sprite]]
"""Returns the sprites of a state; later ones are drawn over earlier ones."""


class ObjectEnvironment(gymnasium.Env[Observation, np.int64]):
    """An OO-MDP as a Gymnasium environment.

    An observation has an entry for every object and attribute; `gymnasium.wrappers.FlattenObservation` turns it into a
    vector. Actions are numbered in the domain's order. ``info`` contains ``action_mask`` [A], 1 for actions that would
    change the state, as in Gymnasium's own Taxi, and ``terms`` [n], 1 for terms that hold, in the order of
    ``domain.term_names``.

    Args:
        mdp: The true dynamics. All episodes begin with the same objects; objects may be removed but not added.
        plan: The floor plan to render.
        sprites: Returns the sprites to render on it.
        render_mode: "ansi", "rgb_array", or None for no rendering.

    Raises:
        InputError: There is no such render mode.
        ValueError: An attribute of an object has no bounds.
    """

    metadata: dict[str, Any] = {"render_modes": ["ansi", "rgb_array"], "render_fps": 4}  # noqa: RUF012 - declared by gymnasium.Env

    def __init__(
        self, mdp: DeterministicMdp, plan: FloorPlan, sprites: SpriteFunction, *, render_mode: str | None = None
    ) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise InputError("render_mode", render_mode, f"is not one of {', '.join(self.metadata['render_modes'])}")
        self.render_mode = render_mode
        self.mdp = mdp
        self.domain = mdp.domain
        self.plan = plan
        self.sprites = sprites
        example = mdp.draw_initial_state(np.random.default_rng(0))
        self.actions = mdp.domain.ground_actions(example)
        self.state: State | None = None
        self._encoder = ObservationEncoder(example)
        self.observation_space = self._encoder.space
        self.action_space = spaces.Discrete(len(self.actions))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode in a random initial state."""
        super().reset(seed=seed)
        self.state = self.mdp.reset(self.np_random)
        return self._encoder.encode(self.state), self._info(self.state)

    def step(self, action: np.int64) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out an action, given by its number."""
        result = self.mdp.step(self.actions[action])
        self.state = result.next_state
        return self._encoder.encode(self.state), result.reward, result.terminated, False, self._info(self.state)

    def render(self) -> str | NDArray[np.uint8] | None:
        """The current state as text or as an RGB image [H, W, 3], depending on the render mode."""
        if self.render_mode is None or self.state is None:
            return None
        sprites = self.sprites(self.state)
        return render_text(self.plan, sprites) if self.render_mode == "ansi" else render_rgb(self.plan, sprites)

    def _info(self, state: State) -> dict[str, Any]:
        """The mask of actions that would change the state, and the terms that hold."""
        condition = self.domain.cond(state)
        return {
            "action_mask": np.array(
                [not self.mdp.transition(state, action).failed for action in self.actions], np.int8
            ),
            "terms": np.array([condition.value >> bit & 1 for bit in range(condition.size)], np.int8),
        }


class TaxiEnvironment(ObjectEnvironment):
    """Taxi: bring a passenger to a destination.

    Args:
        size: Side of a published grid, 5 or 10 cells.
        render_mode: "ansi", "rgb_array", or None for no rendering.

    Raises:
        InputError: There is no published grid of that size.
    """

    def __init__(self, size: int = 5, *, render_mode: str | None = None) -> None:
        try:
            grid = taxi_grid(size)
        except KeyError:
            raise InputError("wherry/Taxi-v0", "size", f"must be 5 or 10, not {size}") from None
        super().__init__(grid, grid.plan, taxi_sprites, render_mode=render_mode)


class DeliveryEnvironment(ObjectEnvironment):
    """Delivery: bring every box to the warehouse.

    Args:
        world: Name of a built-in world, or a world file.
        boxes: Number of boxes, at random cells; None for those of the world.
        render_mode: "ansi", "rgb_array", or None for no rendering.

    Raises:
        InputError: There is no such world, it has no robot or no warehouse, or no room for that many boxes.
    """

    def __init__(
        self, world: str | Path = "small", boxes: int | None = None, *, render_mode: str | None = None
    ) -> None:
        plan = find_world(world)
        super().__init__(delivery_grid(plan, boxes), plan, delivery_sprites, render_mode=render_mode)


def taxi_sprites(state: State) -> list[Sprite]:
    """Sprites of the destination d, the taxi T and the passenger p, who may be in the taxi."""
    taxi, passenger = state["taxi"], state["passenger"]
    return [
        Sprite(_cell(state["destination"]), "d", GREEN, 0.9, is_disc=False),
        Sprite(_cell(taxi), "T", YELLOW, 0.7),
        Sprite(_cell(taxi if passenger.in_taxi else passenger), "p", BLUE, 0.35),
    ]


def delivery_sprites(state: State) -> list[Sprite]:
    """Sprites of the robot R and the boxes o, one of which it may carry."""
    (robot,) = state.of_class("Robot")
    boxes = state.of_class("Box")
    return [
        Sprite(_cell(robot), "R", RED, 0.7),
        *(Sprite(_cell(robot if box.in_bot else box), "o", BROWN, 0.35) for box in boxes),
    ]


def _cell(item: Object) -> Cell:
    return Cell(item.x, item.y)
