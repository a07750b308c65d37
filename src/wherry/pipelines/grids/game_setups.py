"""The domains that a person can play: grid, drawing, and the learner that learns from the player's actions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wherry.domains.delivery import DeliveryHeuristic, all_delivered, boxes_left, delivery_grid, delivery_reward
from wherry.domains.taxi import PUBLISHED_GRIDS, taxi_grid
from wherry.environments.grids import SpriteFunction, delivery_sprites, taxi_sprites
from wherry.episodes import Agent, GoalAgent, PolicyAgent
from wherry.errors import InputError
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.learning.registry import RULE_LEARNERS, Job, LearnerEntry, RuleLearnerFactory, learners_for
from wherry.learning.rule_files.files import load_rules
from wherry.learning.rules import RuleLearner
from wherry.oomdp.mdp import DeterministicMdp
from wherry.pipelines.grids.agents import curiosity_of
from wherry.planning.value_iteration import ValueIteration

PLAY_LEARNERS: Mapping[str, LearnerEntry[RuleLearnerFactory]] = learners_for(Job.PLAY, RULE_LEARNERS)
"""The learners that can be used in a game, by name."""


@dataclass(frozen=True, slots=True)
class GameSettings:
    """The settings of a game.

    Attributes:
        domain: Key of `GAME_SETUPS`.
        size: Side of the Taxi grid, cells: 5 or 10.
        world: World of the delivery: a built-in world's name or a world file.
        boxes: Number of boxes to deliver; None for the number in the world file.
        seed: Seed of the start states.
        learner: Key of `PLAY_LEARNERS`.
        rules: Rules file with the learner's initial knowledge; None to begin without knowledge.
    """

    domain: str
    size: int = 5
    world: str = "small"
    boxes: int | None = None
    seed: int = 0
    learner: str = "bayes"
    rules: Path | None = None


@dataclass(frozen=True, slots=True)
class GameSetup:
    """The parts of a game.

    Attributes:
        mdp: The grid's dynamics.
        plan: Floor plan of the drawing.
        sprites: Returns the sprites on the plan in a state.
        learner: Learner that learns from the player's actions.
        agent: Agent that chooses actions with the learner when the player asks for it.
    """

    mdp: DeterministicMdp
    plan: FloorPlan
    sprites: SpriteFunction
    learner: RuleLearner
    agent: Agent


def _taxi(settings: GameSettings) -> GameSetup:
    if settings.size not in PUBLISHED_GRIDS:
        raise InputError("--size", str(settings.size), f"is none of {', '.join(map(str, PUBLISHED_GRIDS))}")
    grid = taxi_grid(settings.size)
    learner = _learner(settings, grid)
    planner = ValueIteration(learner, curiosity=curiosity_of(PLAY_LEARNERS[settings.learner]))
    return GameSetup(grid, grid.plan, taxi_sprites, learner, PolicyAgent(learner, planner))


def _delivery(settings: GameSettings) -> GameSetup:
    plan = find_world(settings.world)
    grid = delivery_grid(plan, settings.boxes)
    learner = _learner(settings, grid, reward=delivery_reward, terminated=all_delivered)
    return GameSetup(grid, plan, delivery_sprites, learner, GoalAgent(learner, boxes_left, DeliveryHeuristic()))


GAME_SETUPS: Mapping[str, Callable[[GameSettings], GameSetup]] = {"taxi": _taxi, "delivery": _delivery}
"""The domains that can be played, by name."""


def _learner(settings: GameSettings, grid: DeterministicMdp, **given: Any) -> RuleLearner:
    """Make the learner, or load it from the rules file; ``given`` are reward and termination functions."""
    if settings.rules is None:
        return PLAY_LEARNERS[settings.learner].factory(grid.domain, **given)
    return load_rules(settings.rules, grid.domain, **given)
