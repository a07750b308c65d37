"""The base class of adapters for Gymnasium environments."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import State


class GymnasiumAdapter(ABC):
    """An OO-MDP `Environment` around a Gymnasium environment with discrete actions.

    Truncation is ignored: an episode ends only when the wrapped environment terminates it.

    Args:
        environment: The wrapped environment.
        domain: The domain of the states.
        title: Name of the environment in error messages.
        action_names: Names of the wrapped environment's actions, in the order of their numbers.
    """

    def __init__(
        self, environment: gymnasium.Env[Any, Any], domain: Domain, *, title: str, action_names: Sequence[str]
    ) -> None:
        self.environment = environment
        self.domain = domain
        self._title = title
        self._action_names = action_names
        self._state: State | None = None

    def reset(self, rng: np.random.Generator) -> State:
        """Begin an episode; the generator draws the seed of the wrapped environment.

        Raises:
            InputError: The wrapped environment contains objects that the domain has no class for.
        """
        observation, _ = self.environment.reset(seed=int(rng.integers(2**31)))
        self._begin_episode()
        self._state = self._perceive(observation)
        return self._state

    def step(self, action: Action) -> Transition:
        """Carry out an action.

        Raises:
            RuntimeError: No episode has begun.
            ValueError: There is no such action.
        """
        if self._state is None:
            raise RuntimeError("reset the environment before the first step")
        if action.name not in self._action_names:
            raise ValueError(f"{self._title} has no action {action}")
        state = self._state
        observation, reward, terminated, _, _ = self.environment.step(self._action_names.index(action.name))
        self._state = self._perceive(observation)
        return Transition(state, action, self._state, self._reward(float(reward), terminated=terminated), terminated)

    @abstractmethod
    def _perceive(self, observation: Any) -> State:
        """Return the current state, given the wrapped environment's observation."""

    def _begin_episode(self) -> None:  # noqa: B027 - optional hook
        """Prepare for a new episode after the wrapped environment was reset."""

    def _reward(self, reward: float, *, terminated: bool) -> float:
        """Return the reward of a step, given the wrapped environment's reward."""
        return reward
