"""Compiled Q-learning on numbered states; tested against `wherry.baselines.q_learning` step by step."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wherry.baselines.compiled.tabular import Booleans, EpisodeBatch, Floats, Integers, TabularLearner, TabularMdp
from wherry.kernels import kernel

BATCH_SIZE = 64  # episodes per batch; the random numbers of a batch are drawn together


@dataclass(frozen=True, slots=True)
class TabularQLearning(TabularLearner):
    """Q-learning (Watkins 1989) with one-step backups.

    Attributes:
        discount: γ.
        learning_rate: α.
        exploration: ε, probability of a random action.
        initial_value: Q of state–action pairs not tried yet.
    """

    discount: float = 0.95
    learning_rate: float = 1.0
    exploration: float = 0.1
    initial_value: float = 0.0

    def batches(
        self, mdp: TabularMdp, probes: Integers, rng: np.random.Generator, *, max_episode_steps: int
    ) -> Iterator[EpisodeBatch]:
        """Learn as `TabularLearner.batches` says; a batch ends early when all probes are solved."""
        values = np.full(mdp.successor.shape, self.initial_value)
        while True:
            starts = rng.integers(mdp.start_count, size=BATCH_SIZE, dtype=np.int32)
            draws = rng.random((BATCH_SIZE, max_episode_steps, 2))
            began = time.thread_time()
            lengths, solved = _run_episodes(
                starts,
                draws,
                mdp.successor,
                mdp.reward,
                mdp.terminates,
                values,
                probes,
                self.discount,
                self.learning_rate,
                self.exploration,
            )
            seconds = time.thread_time() - began
            yield list(zip(lengths.tolist(), solved.tolist(), strict=True)), seconds


@kernel
def _run_episodes(
    starts: Integers,
    draws: Floats,
    successor: Integers,
    reward: Floats,
    terminates: Booleans,
    values: Floats,
    probes: Integers,
    discount: float,
    learning_rate: float,
    exploration: float,
) -> tuple[Integers, Integers]:
    """Run episodes, each followed by a test from all probes, until all probes are solved.

    Args:
        starts: [E] numbers of the start states of the E episodes.
        draws: [E, L, 2] uniform random numbers in [0, 1) for up to L steps of each episode: the step explores if the
            first is below ε, and the second then selects the action.
        successor: [S, A] number of s'.
        reward: [S, A] r.
        terminates: [S, A] whether the step ends the episode.
        values: [S, A] Q, updated in place.
        probes: [P, 2] number of each probe's state, and the fewest steps from there to the end.
        discount: γ.
        learning_rate: α.
        exploration: ε.

    Returns:
        Number of steps of each of the D ≤ E episodes that were run, [D]; and number of probes solved after each, [D].
    """
    actions = successor.shape[1]
    lengths, solved = np.zeros(len(starts), np.int32), np.zeros(len(starts), np.int32)
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
            if not terminates[state, action]:
                target += discount * values[after].max()
            values[state, action] += learning_rate * (target - values[state, action])
            lengths[done] += 1
            if terminates[state, action]:
                break
            state = after
        solved[done] = _count_solved(probes, successor, terminates, values)
        done += 1
        if solved[done - 1] == len(probes):
            break
    return lengths[:done], solved[:done]


@kernel
def _count_solved(probes: Integers, successor: Integers, terminates: Booleans, values: Floats) -> int:
    """Return how many of the probes [P, 2] the greedy policy solves in the fewest steps."""
    solved = 0
    for probe in range(len(probes)):
        state = probes[probe, 0]
        for step in range(1, probes[probe, 1] + 1):
            action = int(np.argmax(values[state]))
            if terminates[state, action]:
                solved += step == probes[probe, 1]
                break
            state = successor[state, action]
    return solved
