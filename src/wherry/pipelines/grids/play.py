"""Playing a domain by hand while a learner watches, learns, and says beforehand what it expects.

What a person sees is what the learner sees: the state, its condition, and what is predicted of every action.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from wherry.domains.delivery import DeliveryHeuristic, all_delivered, boxes_left, delivery_grid, delivery_reward
from wherry.domains.taxi import SIZES, taxi_grid
from wherry.environments.grids import SpritesOf, delivery_sprites, taxi_sprites
from wherry.environments.pictures import render_text
from wherry.episodes import Agent, GoalAgent, PolicyAgent
from wherry.errors import InputError
from wherry.floorplan.plan import FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.learning.doormax import Doormax
from wherry.learning.learners import LEARNERS as RULE_LEARNERS
from wherry.learning.learners import RuleLearner
from wherry.learning.rule_files.files import load_rules
from wherry.oomdp.attributes import Value
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Prediction, Transition
from wherry.oomdp.objects import State
from wherry.pipelines.grids.learning import CURIOSITY
from wherry.planning.value_iteration import ValueIteration

LEARNERS: Mapping[str, Callable[..., RuleLearner]] = {
    **RULE_LEARNERS,
    "doormax-near-miss": partial(Doormax, inference="near-miss"),
}
"""The learners that can watch."""

SURE = 0.995  # probabilities from here on are not worth a number


@dataclass(frozen=True, slots=True)
class Settings:
    """What to play.

    Attributes:
        domain: A key of `TABLES`.
        size: The Taxi grid's side, 5 or 10.
        world: Where to deliver: a built-in world's name or a world file.
        boxes: How many boxes to deliver; None for what the world says.
        seed: Of first states.
        learner: A key of `LEARNERS`.
        rules: What the learner knows to begin with; None for nothing.
    """

    domain: str
    size: int = 5
    world: str = "small"
    boxes: int | None = None
    seed: int = 0
    learner: str = "bayes"
    rules: Path | None = None


@dataclass(frozen=True, slots=True)
class PredictionText:
    """The most likely outcome of an action, as text.

    Attributes:
        action: The action.
        changes: The attributes that change; "UNKNOWN" where the learner cannot tell.
        reward: The reward and whether the episode ends; empty where that is not known.
        probability: Probability of the outcome; None where the learner is certain or states none.
    """

    action: Action
    changes: str
    reward: str
    probability: float | None


@dataclass(frozen=True, slots=True)
class Table:
    """What a game is played on.

    Attributes:
        mdp: What is true.
        plan: The floor that is drawn.
        sprites: What stands on it.
        learner: Who watches.
        agent: Acts in the learner's place when it is let.
    """

    mdp: DeterministicMdp
    plan: FloorPlan
    sprites: SpritesOf
    learner: RuleLearner
    agent: Agent


class Game:
    """A game, episode after episode.

    Args:
        settings: What to play.

    Raises:
        InputError: There is no such domain, size, world or learner, or the rules cannot be used.

    Attributes:
        state: s.
        steps: Steps of the present episode.
        all_steps: Steps of all episodes.
        episodes: Episodes that came to their end.
        total: Sum of the present episode's rewards.
        surprises: How often the learner was wrong, in all episodes.
        over: Whether the present episode has ended.
        told: What happened last, in words.
    """

    def __init__(self, settings: Settings) -> None:
        if settings.domain not in TABLES:
            raise InputError("DOMAIN", settings.domain, f"is none of {', '.join(TABLES)}")
        if settings.learner not in LEARNERS:
            raise InputError("--learner", settings.learner, f"is none of {', '.join(LEARNERS)}")
        self.settings = settings
        self.table = TABLES[settings.domain](settings)
        self._rng = np.random.default_rng(settings.seed)
        self.episodes, self.surprises, self.all_steps = 0, 0, 0
        self.begin()

    @property
    def actions(self) -> tuple[Action, ...]:
        """What can be done."""
        return self.table.mdp.domain.ground_actions(self.state)

    @property
    def drawing(self) -> str:
        """The world as text."""
        return render_text(self.table.plan, self.table.sprites(self.state))

    @property
    def condition(self) -> tuple[tuple[str, bool], ...]:
        """The terms by name, and whether they hold."""
        bits = str(self.table.mdp.domain.cond(self.state))
        return tuple((name, bit == "1") for name, bit in zip(self.table.mdp.domain.term_names, bits, strict=True))

    @property
    def rules(self) -> tuple[str, ...]:
        """What was learnt so far, in words."""
        return self.table.learner.sentences()

    def predictions(self) -> tuple[PredictionText, ...]:
        """The learner's prediction for every action."""
        probable = self.settings.learner == "bayes"
        return tuple(
            _in_words(self.state, action, self.table.learner.predict(self.state, action), probable)
            for action in self.actions
        )

    def begin(self) -> None:
        """Begin an episode."""
        self.state: State = self.table.mdp.reset(self._rng)
        self.steps, self.total, self.over = 0, 0.0, False
        self.told = "What are the rules? Try."

    def advise(self) -> Action | None:
        """What the learner would do; None where it has nothing more to do."""
        decision = None if self.over else self.table.agent.decide(self.state)
        return None if decision is None else decision.action

    def do(self, action: Action) -> Transition:
        """Do an action; learn from it, and say what came of it.

        Raises:
            RuntimeError: The episode has ended.
        """
        if self.over:
            raise RuntimeError("the episode has ended; begin another")
        expected = self.table.learner.predict(self.state, action).most_likely.next_state
        done = self.table.mdp.step(action)
        self.table.agent.learn(done)
        wrong = expected is not None and expected.objects != done.next_state.objects
        self.surprises += wrong
        self.steps += 1
        self.all_steps += 1
        self.total += done.reward
        self.told = f"{action}: {changes_in_words(self.state, done.next_state)} ({done.reward:+g})" + (
            ", a surprise!" if wrong else ", which nobody knew." if expected is None else ", as foretold."
        )
        self.state = done.next_state
        if done.terminated:
            self.over = True
            self.episodes += 1
            self.told += f" Done after {self.steps} steps, with {self.total:+g}."
        return done


def _taxi(settings: Settings) -> Table:
    if settings.size not in SIZES:
        raise InputError("--size", str(settings.size), f"is none of {', '.join(map(str, SIZES))}")
    grid = taxi_grid(settings.size)
    learner = _learner(settings, grid)
    curiosity = CURIOSITY if settings.learner == "bayes" else 0.0
    agent = PolicyAgent(learner, ValueIteration(learner, curiosity=curiosity))
    return Table(grid, grid.plan, taxi_sprites, learner, agent)


def _delivery(settings: Settings) -> Table:
    plan = find_world(settings.world)
    grid = delivery_grid(plan, settings.boxes)
    learner = _learner(settings, grid, reward=delivery_reward, terminated=all_delivered)
    return Table(grid, plan, delivery_sprites, learner, GoalAgent(learner, boxes_left, DeliveryHeuristic()))


TABLES: Mapping[str, Callable[[Settings], Table]] = {"taxi": _taxi, "delivery": _delivery}
"""What can be played."""


def _learner(settings: Settings, grid: DeterministicMdp, **given: Callable[..., float | bool]) -> RuleLearner:
    if settings.rules is None:
        return LEARNERS[settings.learner](grid.domain, **given)
    return load_rules(settings.rules, grid.domain, **given)  # type: ignore[arg-type]


def _in_words(state: State, action: Action, prediction: Prediction, probable: bool) -> PredictionText:
    likely = prediction.most_likely
    if likely.next_state is None:
        return PredictionText(action, "UNKNOWN", "", None)
    probability = likely.probability / sum(outcome.probability for outcome in prediction.outcomes)
    reward = [] if likely.reward is None else [f"{likely.reward:+g}"]
    reward += ["the end"] if likely.terminated else []
    return PredictionText(
        action,
        changes_in_words(state, likely.next_state),
        ", ".join(reward),
        probability if probable and probability < SURE else None,
    )


def changes_in_words(state: State, after: State) -> str:
    """What differs between two states: ``taxi.y += 1``, ``box1.in_bot := True``, ``box1 leaves``."""
    parts = []
    for item in state.objects:
        later = after.get(item.name)
        if later is None:
            parts.append(f"{item.name} leaves")
            continue
        for attribute, old, new in zip(item.object_class.attributes, item.values, later.values, strict=True):
            if old != new:
                parts.append(_change(f"{item.name}.{attribute.name}", old, new))
    return ", ".join(parts) or "nothing changes"


def _change(name: str, old: Value, new: Value) -> str:
    if isinstance(old, bool | str) or isinstance(new, bool | str):
        return f"{name} := {new}"
    return f"{name} {'+' if new > old else '-'}= {abs(new - old)}"
