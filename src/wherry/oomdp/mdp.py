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


class Prediction(NamedTuple):
    """What a model says that an action will do.

    Attributes:
        state: s', or None where the model cannot tell: the fictitious state s_max.
        reward: r, or None where the model cannot tell.
        terminated: Whether s' ends the episode, or None where the model cannot tell.
        probability: How sure the model is of s'; where it cannot tell, how likely the action does anything at all. An
            action that nothing more can be learnt about has 0, and is not worth trying.
        otherwise: What else may happen, each with its own probability.
        doubt: How much trying it would settle: 1 where two explanations disagree, 0 where nothing is in doubt.
    """

    state: State | None
    reward: float | None = None
    terminated: bool | None = None
    probability: float = 1.0
    otherwise: tuple[Prediction, ...] = ()
    doubt: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the model can tell s', r, and whether the episode ends."""
        return self.state is not None and self.reward is not None and self.terminated is not None


UNKNOWN = Prediction(None)
"""The answer "I don't know" (⊥ in KWIK learning), which sends an optimistic planner to find out."""

IMPOSSIBLE = Prediction(None, probability=0.0)
"""What cannot be, or cannot be found out."""

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
        return Prediction(done.next_state, done.reward, done.terminated)


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
