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
    """One experience <s, a, r, s'>.

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
        """Whether no object changed. Static objects that were perceived for the first time do not count."""
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
        outcomes: At least one, the most likely first. The probability of an unknown outcome is the probability that
            the action has any effect at all; where nothing more can be learnt about the action it is 0.
        disagreement: How evenly the model's explanations of past experience disagree about the outcome: 1 where half
            of them predict it and half do not, so that trying the action settles most; 0 where all agree.
    """

    outcomes: tuple[Outcome, ...]
    disagreement: float = 0.0

    @property
    def most_likely(self) -> Outcome:
        """The outcome of the highest probability."""
        return self.outcomes[0]


UNKNOWN = Prediction((Outcome(None),))
"""The answer "I don't know" of KWIK learning; an optimistic planner explores actions of which the model says this."""

IMPOSSIBLE = Prediction((Outcome(None, probability=0.0),))
"""The prediction for an action that is impossible, or about which nothing can be learnt."""

RewardFunction = Callable[[State, Action, State], float]
"""R(s, a, s')."""

TerminationFunction = Callable[[State], bool]
"""Whether a state ends the episode."""


class Environment(Protocol):
    """A world to act in: a grid, a simulated robot, or a real one."""

    @property
    def domain(self) -> Domain:
        """The domain of its states."""
        ...

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode and return its first state; a robot goes on from where it is."""
        ...

    def step(self, action: Action) -> Transition:
        """Carry out an action and return the experience."""
        ...


class DeterministicMdp:
    """An MDP with known, deterministic dynamics; it is an environment, and also the true model of it.

    Args:
        domain: The domain of its states.
        transition: The experience that an action brings in a state.
        start: Draws the first state of an episode.
    """

    def __init__(
        self,
        domain: Domain,
        transition: Callable[[State, Action], Transition],
        start: Callable[[np.random.Generator], State],
    ) -> None:
        self.domain = domain
        self.transition = transition
        self.start = start
        self.state: State | None = None

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode in a randomly drawn state."""
        self.state = self.start(rng)
        return self.state

    def step(self, action: Action) -> Transition:
        """Carry out an action in the present state.

        Raises:
            RuntimeError: No episode has begun.
        """
        if self.state is None:
            raise RuntimeError("reset the environment before the first step")
        transition = self.transition(self.state, action)
        self.state = transition.next_state
        return transition

    def predict(self, state: State, action: Action) -> Prediction:
        """The true outcome, with certainty."""
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
