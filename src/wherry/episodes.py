"""The agent loop, and its agents (paper, section 6).

The same loop runs on a grid, on the simulated robot and on a real one: perceive, decide, act, learn. It yields every
step, which is all that recording or displaying a run requires.
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
from wherry.planning.planner import Planner
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import Heuristic, Plan, UnmetGoals, a_star, cheapest_experiment, zero_heuristic

MAX_FAILED_ATTEMPTS = 3  # failures of an action in a state after which it is excluded there


class ConditionalLearner(ConditionalModel, Learner, Protocol):
    """A learner that is a conditional model, on which planners and agents can plan."""


@dataclass(frozen=True, slots=True)
class Decision:
    """An agent's choice of action.

    Attributes:
        action: a.
        prediction: The agent's prediction for the action.
        is_exploring: Whether the action is an experiment or a step of the plan towards one.
    """

    action: Action
    prediction: Prediction
    is_exploring: bool


class Agent(Protocol):
    """Chooses actions and learns from their results."""

    @property
    def domain(self) -> Domain:
        """The domain of its states."""
        ...

    @property
    def unknown_pairs(self) -> int:
        """Number of pairs of an observed condition and an action with unknown outcome; 0 if they are not counted."""
        ...

    def predict(self, state: State, action: Action) -> Prediction:
        """Predict the outcomes of an action."""
        ...

    def decide(self, state: State) -> Decision | None:
        """Choose an action; None if the agent stops."""
        ...

    def learn(self, transition: Transition) -> None:
        """Learn from one experience."""
        ...


@dataclass(frozen=True, slots=True)
class Step:
    """One iteration of the agent loop.

    Attributes:
        number: Index of the step in its episode, from 1.
        state: s, as perceived when the action was carried out.
        condition: cond(s).
        action: a.
        prediction: The agent's prediction before the action.
        transition: The experience.
        is_exploring: Whether the action was an experiment or a step of the plan towards one.
        unknown_pairs: Number of pairs of an observed condition and an action with unknown outcome after this step.
    """

    number: int
    state: State
    condition: Condition
    action: Action
    prediction: Prediction
    transition: Transition
    is_exploring: bool
    unknown_pairs: int

    @property
    def is_surprise(self) -> bool:
        """Whether the next state differs from the predicted one."""
        expected = self.prediction.most_likely.next_state
        return expected is not None and expected.objects != self.transition.next_state.objects

    @property
    def is_learning(self) -> bool:
        """Whether the step was exploration or its prediction was wrong."""
        return self.is_exploring or self.is_surprise


def run_episode(
    environment: Environment, agent: Agent, rng: np.random.Generator, *, max_steps: int | None = None
) -> Iterator[Step]:
    """Run one episode, yielding its steps, until it terminates, the agent stops, or a number of steps is reached.

    Args:
        environment: The environment to act in.
        agent: The agent that acts.
        rng: Draws the initial state of the environment.
        max_steps: The largest number of steps; None for no limit.
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
        if transition.state != state:  # a robot perceives again just before it acts
            prediction = agent.predict(transition.state, action)
        agent.learn(transition)
        yield Step(
            number,
            transition.state,
            agent.domain.cond(transition.state),
            action,
            prediction,
            transition,
            decision.is_exploring,
            agent.unknown_pairs,
        )
        if transition.terminated:
            return
        state = transition.next_state


class GoalAgent:
    """An agent that completes a task, such as delivering all boxes.

    Once it can plan the whole task it follows the shortest plan, and keeps learning on the way. Until then it carries
    out experiments, the cheapest first. If no plan completes the task and no experiment remains, it completes as much
    of the task as possible and stops.

    Args:
        learner: The learner, on whose predictions the agent plans.
        unmet_goals: Number of unmet goals in a state; 0 when the task is complete.
        heuristic: Admissible heuristic for the number of steps to the end of the task; a good one speeds up planning.
        max_detour_cost: Cost, in steps, below which an experiment is worth interrupting a plan that completes the task.
    """

    def __init__(
        self,
        learner: ConditionalLearner,
        unmet_goals: UnmetGoals,
        heuristic: Heuristic = zero_heuristic,
        *,
        max_detour_cost: float = 30.0,
    ) -> None:
        self.learner = learner
        self.max_detour_cost = max_detour_cost
        self.unmet_goals = unmet_goals
        self.heuristic = heuristic
        self._cache = PredictionCache(learner)
        self._unknown_pair_counter = UnknownPairs(learner)
        self._plan = Plan((), (), 0.0)
        self._is_exploring = False
        self._planned_revisions: dict[str, int] = {}
        self._failures = Counter[tuple[State, Action]]()
        self._failure_reason: str | None = None

    @property
    def domain(self) -> Domain:
        """The domain of its states."""
        return self.learner.domain

    @property
    def unknown_pairs(self) -> int:
        """Number of pairs of an observed condition and an action with unknown outcome."""
        return self._unknown_pair_counter.count()

    @property
    def failure_reason(self) -> str | None:
        """Why the agent stopped before the task was complete; None unless it did."""
        return self._failure_reason

    @property
    def plan(self) -> tuple[State, ...]:
        """The states on the current plan, the current state first."""
        return self._plan.states

    def predict(self, state: State, action: Action) -> Prediction:
        """The learner's prediction."""
        return self.learner.predict(state, action)

    def decide(self, state: State) -> Decision | None:
        """The next action of the plan; plans again in an unexpected state and after a revision; None at the end."""
        self._unknown_pair_counter.add(state)
        if self._plan.states[:1] != (state,) or self._planned_revisions != self.learner.revisions:
            self._replan(state)
        if not self._is_exploring and self.learner.has_disagreement:
            self._plan_detour(state)
        if not self._plan.actions:
            self._failure_reason = self._why_incomplete(state)
            return None
        action = self._plan.actions[0]
        return Decision(action, self.learner.predict(state, action), self._is_exploring)

    def learn(self, transition: Transition) -> None:
        """Learn from one experience and advance the plan.

        An action that fails repeatedly in one state is not tried there again, whatever the learner predicts.
        """
        self.learner.add_experience(transition)
        self._plan = Plan(self._plan.actions[1:], self._plan.states[1:], self._plan.cost)
        attempt = transition.state, transition.action
        self._failures[attempt] += transition.failed
        if self._failures[attempt] == MAX_FAILED_ATTEMPTS:
            self._cache.exclude(*attempt)
            self._planned_revisions = {}

    def _replan(self, state: State) -> None:
        """Plan the whole task, or else the cheapest experiment, or else as much of the task as possible."""
        self._planned_revisions = dict(self.learner.revisions)
        self._plan, unmet = a_star(self._cache, state, self.unmet_goals, self.heuristic)
        self._is_exploring = False
        experiment = cheapest_experiment(self._cache, state) if unmet > 0 else None
        if experiment is not None:
            self._plan, self._is_exploring = experiment, True

    def _plan_detour(self, state: State) -> None:
        """Replace the plan by a cheap experiment on which hypotheses disagree; its result may matter elsewhere."""
        experiment = cheapest_experiment(self._cache, state, disagreements_only=True, max_cost=self.max_detour_cost)
        if experiment is not None:
            self._plan, self._is_exploring = experiment, True

    def _why_incomplete(self, state: State) -> str | None:
        """The number of unmet goals and the violated assumptions of the learner; None when the task is complete."""
        unmet = self.unmet_goals(state)
        if unmet <= 0:
            return None
        reasons = (f"{unmet:g} left to do, and no plan for it is known or can be learnt", *self.learner.violations)
        return "; ".join(reasons)


class PolicyAgent:
    """An agent that follows a planner's policy; exploration is up to the planner.

    Args:
        learner: The learner that learns from the experiences.
        planner: A planner on the learner's predictions.
    """

    def __init__(self, learner: Learner, planner: Planner) -> None:
        self.learner = learner
        self.planner = planner

    @property
    def domain(self) -> Domain:
        """The domain of its states."""
        return self.learner.domain

    @property
    def unknown_pairs(self) -> int:
        """Always 0, since this agent does not count unknown outcomes."""
        return 0

    def predict(self, state: State, action: Action) -> Prediction:
        """The learner's prediction."""
        return self.learner.predict(state, action)

    def decide(self, state: State) -> Decision:
        """The policy's action."""
        action = self.planner.policy(state)
        prediction = self.learner.predict(state, action)
        return Decision(action, prediction, is_exploring=not prediction.most_likely.is_known)

    def learn(self, transition: Transition) -> None:
        """Learn from one experience."""
        self.learner.add_experience(transition)
