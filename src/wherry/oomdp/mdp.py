"""Markov decision processes: experiences and predictions; environments, models and learners (paper, section 2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.objects import State


@dataclass(frozen=True, slots=True)
class Transition:
    """An experience (s, a, r, s').

    Attributes:
        state: s.
        action: a.
        next_state: s'.
        reward: r = R(s, a).
        terminated: Whether s' ends the episode.
    """

    state: State
    action: Action
    next_state: State
    reward: float
    terminated: bool

    @property
    def failed(self) -> bool:
        """Whether no object changed; static objects that were perceived for the first time do not count."""
        return self.state.objects == self.next_state.objects


class Outcome(NamedTuple):
    """One possible result of an action in a state.

    Attributes:
        next_state: s'; None where the model does not know it (the fictitious state s_max of R-max).
        reward: r; None where the model does not know it.
        terminated: Whether s' ends the episode; None where the model does not know it.
        probability: P(s'|s, a).
    """

    next_state: State | None
    reward: float | None = None
    terminated: bool | None = None
    probability: float = 1.0

    @property
    def is_known(self) -> bool:
        """Whether the model knows s', r, and whether the episode ends."""
        return self.next_state is not None and self.reward is not None and self.terminated is not None


class Prediction(NamedTuple):
    """The possible outcomes of an action in a state, as a model predicts them.

    Attributes:
        outcomes: At least one outcome, the most likely first. The probability of an unknown outcome is the probability
            that the action has any effect; it is 0 if nothing more can be learnt about the action.
        disagreement: How evenly the hypotheses that agree with past experience are split about the outcome, 0 to 1: 1
            if half of them predict it, so that trying the action is most informative; 0 if all agree.
    """

    outcomes: tuple[Outcome, ...]
    disagreement: float = 0.0

    @property
    def most_likely(self) -> Outcome:
        """The outcome of the highest probability."""
        return self.outcomes[0]


UNKNOWN = Prediction((Outcome(None),))
"""The answer "I don't know" of KWIK learning; an optimistic planner explores actions with this prediction."""

IMPOSSIBLE = Prediction((Outcome(None, probability=0.0),))
"""The prediction for an action that is impossible, or about which nothing can be learnt."""

RewardFunction = Callable[[State, Action, State], float]
"""Returns R(s, a, s')."""

TerminationFunction = Callable[[State], bool]
"""Returns whether a state ends the episode."""


class Environment(Protocol):
    """A world to act in: a grid, a simulated robot, or a real one."""

    @property
    def domain(self) -> Domain:
        """The domain of its states."""
        ...

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode and return its initial state; a robot continues from where it stands."""
        ...

    def step(self, action: Action) -> Transition:
        """Carry out an action and return the experience."""
        ...


class DeterministicMdp:
    """An MDP with known, deterministic dynamics: an environment, and at the same time its true model.

    Args:
        domain: The domain of its states.
        transition: Returns the experience of taking an action in a state.
        draw_initial_state: Draws the initial state of an episode.

    Attributes:
        state: The current state; None before the first episode.
    """

    def __init__(
        self,
        domain: Domain,
        transition: Callable[[State, Action], Transition],
        draw_initial_state: Callable[[np.random.Generator], State],
    ) -> None:
        self.domain = domain
        self.transition = transition
        self.draw_initial_state = draw_initial_state
        self.state: State | None = None

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode in a random initial state."""
        self.state = self.draw_initial_state(rng)
        return self.state

    def step(self, action: Action) -> Transition:
        """Carry out an action in the current state.

        Raises:
            RuntimeError: No episode has begun.
        """
        if self.state is None:
            raise RuntimeError("reset the environment before the first step")
        transition = self.transition(self.state, action)
        self.state = transition.next_state
        return transition

    def predict(self, state: State, action: Action) -> Prediction:
        """The true outcome, with probability 1."""
        result = self.transition(state, action)
        return Prediction((Outcome(result.next_state, result.reward, result.terminated),))


class Model(Protocol):
    """Predicts the outcomes of actions: the true dynamics of an environment, or learnt ones."""

    def predict(self, state: State, action: Action) -> Prediction:
        """Predict the outcomes of an action in a state. Predicting never changes the model."""
        ...


class Learner(Model, Protocol):
    """A model that is learnt from experience."""

    @property
    def domain(self) -> Domain:
        """The domain of the states."""
        ...

    @property
    def violations(self) -> tuple[str, ...]:
        """The assumptions that experience has contradicted, as sentences with action, attribute and observation."""
        ...

    def add_experience(self, transition: Transition) -> None:
        """Learn from one experience."""
        ...
