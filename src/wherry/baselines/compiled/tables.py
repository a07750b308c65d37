"""An experiment's states as numbers, for learners that need very many steps.

Q-learning and R-max need up to millions of steps for what others learn in hundreds, and nearly all of that time would
go into making and hashing states. On tables they do the same, compiled; how states look does not matter to them.
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

Curve = tuple[tuple[int, int], ...]
"""After every episode the steps so far, and how many probes were solved then."""

Block = tuple[list[tuple[int, int]], float]
"""Some episodes: the steps of each, and how many probes were solved after it; and the seconds that they took."""


@dataclass(frozen=True, slots=True)
class Tables:
    """What is true of all states that can be reached, by number.

    Attributes:
        numbers: The number of every state; episodes begin in the first ones, each as likely as the others.
        starts: How many these are.
        successor: [S, A] s'.
        reward: [S, A] r.
        ends: [S, A] whether the episode is over.
    """

    numbers: dict[State, int]
    starts: int
    successor: Integers
    reward: Floats
    ends: Booleans

    @classmethod
    def of(cls, environment: DeterministicMdp, starts: list[State]) -> Tables:
        """Number the states that can be reached from all first ones; actions are in the domain's order."""
        actions = environment.domain.ground_actions(starts[0])
        states = list(starts)
        numbers = {state: number for number, state in enumerate(states)}
        rows = []
        for state in states:  # which grows while it is gone through
            done = [environment.transition(state, action) for action in actions]
            for transition in done:
                if transition.next_state not in numbers:
                    numbers[transition.next_state] = len(states)
                    states.append(transition.next_state)
            rows.append([(numbers[each.next_state], each.reward, each.terminated) for each in done])
        table = np.array(rows)
        return cls(
            numbers, len(starts), table[:, :, 0].astype(np.int32), table[:, :, 1], table[:, :, 2].astype(np.bool_)
        )

    def tests(self, probes: tuple[tuple[State, int], ...]) -> Integers:
        """Probes as numbers, [P, 2]: the state, and the fewest steps that solve it."""
        return np.array([(self.numbers[state], fewest) for state, fewest in probes], np.int32)


class TabularLearner(ABC):
    """A learner that goes through the whole protocol by itself."""

    __slots__ = ()

    @abstractmethod
    def blocks(self, tables: Tables, tests: Integers, rng: np.random.Generator, *, longest: int) -> Iterator[Block]:
        """Learn, from knowing nothing on, for as long as it is asked to.

        Args:
            tables: The world.
            tests: [P, 2] the probes as numbers, see `Tables.tests`.
            rng: Of all that is random.
            longest: The most steps of an episode.
        """
        ...

    def learn(
        self,
        tables: Tables,
        probes: tuple[tuple[State, int], ...],
        rng: np.random.Generator,
        *,
        longest: int,
        patience: int,
    ) -> tuple[Curve, float]:
        """Learn until the greedy policy solves all probes in the fewest steps, or patience ends.

        Args:
            tables: The world.
            probes: The states to test from after every episode, with the fewest steps that solve each.
            rng: Of all that is random.
            longest: The most steps of an episode.
            patience: How many steps it may take; the block of episodes in which it ends is finished.

        Returns:
            The curve; and the seconds that all this took, the environment's steps and the tests included, which are
            not told apart here.
        """
        curve, steps, total = list[tuple[int, int]](), 0, 0.0
        for episodes, seconds in self.blocks(tables, tables.tests(probes), rng, longest=longest):
            for length, solved in episodes:
                steps += length
                curve.append((steps, solved))
            total += seconds
            if curve[-1][1] == len(probes) or steps >= patience:
                break
        return tuple(curve), total
