"""Q-learning's experiment on numbered states, compiled.

It is `wherry.baselines.q_learning` under the same protocol as the other learners, but for its speed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wherry.baselines.compiled.tables import Block, Booleans, Floats, Integers, Tables, TabularLearner
from wherry.kernels import kernel

BLOCK = 64  # episodes whose random numbers are drawn at once


@dataclass(frozen=True, slots=True)
class TabularQLearning(TabularLearner):
    """Q-learning (Watkins 1989) with one-step backups; see `wherry.baselines.q_learning.QLearning`.

    Attributes:
        discount: γ.
        learning_rate: α.
        exploration: ε, how often a random action is taken.
        first_value: Q of what was never tried.
    """

    discount: float = 0.95
    learning_rate: float = 1.0
    exploration: float = 0.1
    first_value: float = 0.0

    def blocks(self, tables: Tables, tests: Integers, rng: np.random.Generator, *, longest: int) -> Iterator[Block]:
        """As `TabularLearner.blocks`; a block ends early when all probes are solved."""
        values = np.full(tables.successor.shape, self.first_value)
        while True:
            starts = rng.integers(tables.starts, size=BLOCK, dtype=np.int32)
            draws = rng.random((BLOCK, longest, 2))
            began = time.thread_time()
            lengths, found = _episodes(
                starts, draws, tables.successor, tables.reward, tables.ends, values, tests,
                self.discount, self.learning_rate, self.exploration,
            )  # fmt: skip
            seconds = time.thread_time() - began
            yield list(zip(lengths.tolist(), found.tolist(), strict=True)), seconds


@kernel
def _episodes(
    starts: Integers, draws: Floats, successor: Integers, reward: Floats, ends: Booleans, values: Floats,
    tests: Integers, discount: float, learning_rate: float, exploration: float,
) -> tuple[Integers, Integers]:  # fmt: skip
    """Some episodes, each followed by the test, until all probes are solved.

    Args:
        starts: [E] first states.
        draws: [E, L, 2] uniform in [0, 1): whether a step explores, and which action it then takes.
        successor: [S, A].
        reward: [S, A].
        ends: [S, A].
        values: [S, A] Q, overwritten.
        tests: [P, 2] the probes' states and fewest steps.
        discount: γ.
        learning_rate: α.
        exploration: ε.

    Returns:
        [D] steps of the episodes that were run; [D] how many probes were solved after each.
    """
    actions = successor.shape[1]
    lengths, found = np.zeros(len(starts), np.int32), np.zeros(len(starts), np.int32)
    done = 0
    while done < len(starts):
        state = starts[done]
        for step in range(draws.shape[1]):
            if draws[done, step, 0] < exploration:
                action = int(draws[done, step, 1] * actions)
            else:
                action = int(np.argmax(values[state]))
            after = successor[state, action]
            target = reward[state, action]
            if not ends[state, action]:
                target += discount * values[after].max()
            values[state, action] += learning_rate * (target - values[state, action])
            lengths[done] += 1
            if ends[state, action]:
                break
            state = after
        for probe in range(len(tests)):
            state = tests[probe, 0]
            for step in range(1, tests[probe, 1] + 1):
                action = int(np.argmax(values[state]))
                if ends[state, action]:
                    found[done] += step == tests[probe, 1]
                    break
                state = successor[state, action]
        done += 1
        if found[done - 1] == len(tests):
            break
    return lengths[:done], found[:done]
