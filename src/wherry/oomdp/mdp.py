"""Markov decision processes: what environments, models and learners have to offer each other (paper, section 2)."""

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
        """Whether nothing changed: s' = s. What was newly perceived of the scene does not count as a change."""
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
"""R(s, a, s') where it is given, not learnt."""

TerminationFunction = Callable[[State], bool]
"""Whether a state ends the episode, where that is given, not learnt."""


class Environment(Protocol):
    """A world that can be acted in: a grid, a simulated robot, or a real one."""

    @property
    def domain(self) -> Domain:
        """What the world is described with."""
        ...

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode and return its first state; a robot that lives once goes on from where it is."""
        ...

    def step(self, action: Action) -> Transition:
        """Do an action and return what came of it."""
        ...


class DeterministicMdp:
    """An MDP whose dynamics are known, with a single next state for every state and action: environment and true model.

    Args:
        domain: What its states are described with.
        transition: What an action does in a state.
        start: Draws an episode's first state.
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
        """Begin an episode in a random first state."""
        self.state = self.start(rng)
        return self.state

    def step(self, action: Action) -> Transition:
        """Do an action in the present state.

        Raises:
            RuntimeError: No episode has begun.
        """
        if self.state is None:
            raise RuntimeError("reset the environment before the first step")
        transition = self.transition(self.state, action)
        self.state = transition.next_state
        return transition

    def predict(self, state: State, action: Action) -> Prediction:
        """What an action does in a state."""
        done = self.transition(state, action)
        return Prediction((Outcome(done.next_state, done.reward, done.terminated),))


class Model(Protocol):
    """Tells what actions do: the truth about an environment, or what was learnt about it."""

    def predict(self, state: State, action: Action) -> Prediction:
        """Tell what an action does in a state. Asking never changes the answer."""
        ...


class Learner(Model, Protocol):
    """A model that experience makes better."""

    @property
    def domain(self) -> Domain:
        """What states are described with."""
        ...

    @property
    def violations(self) -> tuple[str, ...]:
        """The assumptions that experience has contradicted, in words: which action and attribute, what was seen."""
        ...

    def add_experience(self, transition: Transition) -> None:
        """Learn from one experience."""
        ...
