"""MDPs on numbered states, and the base of the compiled learners.

Q-learning and R-max need up to millions of steps where learners of rules need hundreds, and would spend nearly all of
their time on creating and hashing object states. On numbered states the same steps can be compiled.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.oomdp.mdp import DeterministicMdp
from wherry.oomdp.objects import State

Integers = NDArray[np.int32]
Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]

LearningCurve = tuple[tuple[int, int], ...]
"""For every episode, the number of steps up to its end and the number of probes that the greedy policy then solves."""

EpisodeBatch = tuple[list[tuple[int, int]], float]
"""For each episode, its number of steps and the probes solved after it; and the processor time of the batch, s."""


@dataclass(frozen=True, slots=True)
class TabularMdp:
    """A deterministic MDP as arrays over the states that can be reached.

    Attributes:
        state_numbers: Number of every state, from 0; the start states come first, and are drawn uniformly.
        start_count: Number of start states.
        successor: [S, A] number of s'.
        reward: [S, A] r.
        terminates: [S, A] whether the step ends the episode.
    """

    state_numbers: dict[State, int]
    start_count: int
    successor: Integers
    reward: Floats
    terminates: Booleans

    @classmethod
    def of(cls, mdp: DeterministicMdp, starts: list[State]) -> TabularMdp:
        """Number the states that can be reached from the start states; actions keep the domain's order."""
        actions = mdp.domain.ground_actions(starts[0])
        states = list(starts)
        numbers = {state: number for number, state in enumerate(states)}
        rows = []
        for state in states:  # the list grows during the loop
            transitions = [mdp.transition(state, action) for action in actions]
            for transition in transitions:
                if transition.next_state not in numbers:
                    numbers[transition.next_state] = len(states)
                    states.append(transition.next_state)
            rows.append([(numbers[step.next_state], step.reward, step.terminated) for step in transitions])
        table = np.array(rows)
        return cls(
            numbers, len(starts), table[:, :, 0].astype(np.int32), table[:, :, 1], table[:, :, 2].astype(np.bool_)
        )

    def numbered(self, probes: tuple[tuple[State, int], ...]) -> Integers:
        """Return the P probes as numbers, [P, 2]: the state, and the fewest steps from there to the end."""
        return np.array([(self.state_numbers[state], fewest) for state, fewest in probes], np.int32)


class TabularLearner(ABC):
    """A learner that runs the whole published protocol on numbered states."""

    __slots__ = ()

    @abstractmethod
    def batches(
        self, mdp: TabularMdp, probes: Integers, rng: np.random.Generator, *, max_episode_steps: int
    ) -> Iterator[EpisodeBatch]:
        """Learn from scratch, and yield one batch of episodes after the other, without end.

        Args:
            mdp: The world.
            probes: [P, 2] numbered probes, see `TabularMdp.numbered`.
            rng: Random number generator.
            max_episode_steps: Steps after which an episode is truncated.
        """
        ...

    def learn(
        self,
        mdp: TabularMdp,
        probes: tuple[tuple[State, int], ...],
        rng: np.random.Generator,
        *,
        max_episode_steps: int,
        max_steps: int,
    ) -> tuple[LearningCurve, float]:
        """Learn until the greedy policy solves all probes in the fewest steps, or the step limit is reached.

        Args:
            mdp: The world.
            probes: States from which the policy is tested after every episode, each with the fewest steps to the end.
            rng: Random number generator.
            max_episode_steps: Steps after which an episode is truncated.
            max_steps: Step limit; the batch of episodes in which it is reached is completed.

        Returns:
            The learning curve; and the processor time, s, which includes the environment and the tests, as these are
            compiled together with the learner.
        """
        curve, steps, total = list[tuple[int, int]](), 0, 0.0
        for episodes, seconds in self.batches(mdp, mdp.numbered(probes), rng, max_episode_steps=max_episode_steps):
            for length, solved in episodes:
                steps += length
                curve.append((steps, solved))
            total += seconds
            if curve[-1][1] == len(probes) or steps >= max_steps:
                break
        return tuple(curve), total
