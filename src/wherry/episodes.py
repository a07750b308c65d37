"""The agent loop, and the agents that run in it (paper, section 6).

One loop serves the grid, the simulated robot and the real one: perceive, decide, act, learn. What it yields is all that
anyone who watches needs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wherry.learning.unknowns import UnknownPairs
from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.conditions import Condition
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Environment, Learner, Prediction, Transition
from wherry.oomdp.objects import State
from wherry.planning.policy import Planner
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import Heuristic, Plan, UnmetGoals, a_star, cheapest_experiment, zero_heuristic

PATIENCE = 3  # how often an action that fails is tried in one and the same state


class ConditionalLearner(ConditionalModel, Learner, Protocol):
    """A learner whose predictions depend on conditions alone."""


@dataclass(frozen=True, slots=True)
class Decision:
    """What an agent is about to do.

    Attributes:
        action: a.
        prediction: What it expects of that.
        exploring: Whether it does it in order to find something out.
    """

    action: Action
    prediction: Prediction
    exploring: bool


class Agent(Protocol):
    """Decides what to do, and learns from what comes of it."""

    @property
    def domain(self) -> Domain:
        """What its states are described with."""
        ...

    @property
    def unknown(self) -> int:
        """How many pairs of a condition met so far and an action it cannot predict; 0 if it does not count them."""
        ...

    def predict(self, state: State, action: Action) -> Prediction:
        """What it expects of an action."""
        ...

    def decide(self, state: State) -> Decision | None:
        """Choose an action; None where there is nothing (more) to do."""
        ...

    def learn(self, transition: Transition) -> None:
        """Learn from one experience."""
        ...


@dataclass(frozen=True, slots=True)
class Step:
    """One turn of the loop.

    Attributes:
        number: From 1.
        state: s, as perceived when the action was done.
        condition: cond(s).
        action: a.
        prediction: What was expected.
        transition: What came of it.
        exploring: Whether it was done in order to find something out, or on the way to that.
        unknown: How many pairs of a condition met so far and an action cannot be predicted after this step.
    """

    number: int
    state: State
    condition: Condition
    action: Action
    prediction: Prediction
    transition: Transition
    exploring: bool
    unknown: int

    @property
    def surprise(self) -> bool:
        """Whether something else happened than was expected."""
        expected = self.prediction.most_likely.next_state
        return expected is not None and expected.objects != self.transition.next_state.objects

    @property
    def learning(self) -> bool:
        """Whether it served to learn, or was foretold wrongly."""
        return self.exploring or self.surprise


def run(
    environment: Environment, agent: Agent, rng: np.random.Generator, *, max_steps: int | None = None
) -> Iterator[Step]:
    """Run one episode: until it ends, the agent has nothing more to do, or a number of steps is reached.

    Args:
        environment: The world.
        agent: Who acts in it.
        rng: Where the environment's randomness comes from.
        max_steps: The most steps to take; None for no limit.
    """
    state = environment.reset(rng)
    number = 0
    while number != max_steps:
        decision = agent.decide(state)
        if decision is None:
            return
        number += 1
        action, prediction = decision.action, decision.prediction
        transition = environment.step(action)
        if transition.state != state:  # a robot that looked again before it acted saw something new
            prediction = agent.predict(transition.state, action)
        agent.learn(transition)
        condition = agent.domain.cond(transition.state)
        yield Step(
            number, transition.state, condition, action, prediction, transition, decision.exploring, agent.unknown
        )
        if transition.terminated:
            return
        state = transition.next_state


class GoalAgent:
    """An agent that lives once and has a job to do.

    As soon as it knows enough for a plan that does the whole job, it follows the shortest such plan, and goes on
    learning while it does. Until then it does experiments, each time the one that costs least. When there is nothing
    left to find out and no plan does the whole job, it does as much of it as can be done.

    Args:
        learner: What it learns with.
        unmet_goals: How many goals a state leaves unmet; 0 when the task is done.
        heuristic: Never more than the number of steps from a state to the end of the job; makes planning fast.
        detour: How much it gives for settling a doubt when it already knows enough to do the job, in steps.
    """

    def __init__(
        self,
        learner: ConditionalLearner,
        unmet_goals: UnmetGoals,
        heuristic: Heuristic = zero_heuristic,
        *,
        detour: float = 30.0,
    ) -> None:
        self.learner = learner
        self.detour = detour
        self.unmet_goals = unmet_goals
        self.heuristic = heuristic
        self._cache = PredictionCache(learner)
        self._unknown = UnknownPairs(learner)
        self._plan = Plan((), (), 0.0)
        self._exploring = False
        self._planned_with: dict[str, int] = {}
        self._failed = Counter[tuple[State, Action]]()
        self._gave_up: str | None = None

    @property
    def domain(self) -> Domain:
        """What its states are described with."""
        return self.learner.domain

    @property
    def unknown(self) -> int:
        """How many pairs of a condition and an action, among the conditions met so far, it cannot predict."""
        return self._unknown.count()

    @property
    def gave_up(self) -> str | None:
        """Why it stopped before the job was done, in words; None as long as it did not."""
        return self._gave_up

    @property
    def plan(self) -> tuple[State, ...]:
        """The states that it means to go through, the present one first."""
        return self._plan.states

    def predict(self, state: State, action: Action) -> Prediction:
        """What it expects of an action."""
        return self.learner.predict(state, action)

    def decide(self, state: State) -> Decision | None:
        """The next action of its plan, which it makes anew when anything came otherwise; None when it is done."""
        self._unknown.meet(state)
        if self._plan.states[:1] != (state,) or self._planned_with != self.learner.revisions:
            self._make_plan(state)
        if not self._exploring and self.learner.has_disagreement:
            self._settle_disagreement(state)
        if not self._plan.actions:
            self._gave_up = self._why_nothing_is_left(state)
            return None
        action = self._plan.actions[0]
        return Decision(action, self.learner.predict(state, action), self._exploring)

    def learn(self, transition: Transition) -> None:
        """Learn from one experience, and go one step on in the plan.

        What fails again and again in one state, although the learner thinks that it should not, is not tried there any
        more.
        """
        self.learner.add_experience(transition)
        self._plan = Plan(self._plan.actions[1:], self._plan.states[1:], self._plan.cost)
        tried = transition.state, transition.action
        self._failed[tried] += transition.failed
        if self._failed[tried] == PATIENCE:
            self._cache.exclude(*tried)
            self._planned_with = {}

    def _make_plan(self, state: State) -> None:
        """Plan the whole job, or else the cheapest experiment, or else as much of the job as can be done."""
        self._planned_with = dict(self.learner.revisions)
        self._plan, left = a_star(self._cache, state, self.unmet_goals, self.heuristic)
        self._exploring = False
        experiment = cheapest_experiment(self._cache, state) if left > 0 else None
        if experiment is not None:
            self._plan, self._exploring = experiment, True

    def _why_nothing_is_left(self, state: State) -> str | None:
        """What is left of the job, and which of the learner's assumptions were violated; None when the job is done."""
        left = self.unmet_goals(state)
        if left <= 0:
            return None
        reasons = (f"{left:g} left to do, and no way to do it is known or can be found out", *self.learner.violations)
        return "; ".join(reasons)

    def _settle_disagreement(self, state: State) -> None:
        """Leave the plan for an experiment nearby, so that what is learnt here holds elsewhere, too."""
        experiment = cheapest_experiment(self._cache, state, disagreements_only=True, max_cost=self.detour)
        if experiment is not None:
            self._plan, self._exploring = experiment, True


class PolicyAgent:
    """An agent that follows the policy of a planner, step by step; the planner sees to it that it explores.

    Args:
        learner: What it learns with.
        planner: Knows the best action by what was learnt so far.
    """

    def __init__(self, learner: Learner, planner: Planner) -> None:
        self.learner = learner
        self.planner = planner

    @property
    def domain(self) -> Domain:
        """What its states are described with."""
        return self.learner.domain

    @property
    def unknown(self) -> int:
        """Always 0: it does not count what it cannot predict."""
        return 0

    def predict(self, state: State, action: Action) -> Prediction:
        """What it expects of an action."""
        return self.learner.predict(state, action)

    def decide(self, state: State) -> Decision:
        """The policy's action."""
        action = self.planner.policy(state)
        prediction = self.learner.predict(state, action)
        return Decision(action, prediction, exploring=not prediction.most_likely.is_known)

    def learn(self, transition: Transition) -> None:
        """Learn from one experience."""
        self.learner.add_experience(transition)
