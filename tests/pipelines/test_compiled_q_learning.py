"""Compiled Q-learning takes the same steps as the reference implementation with the same random numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest

from wherry.baselines.compiled.q_learning import BATCH_SIZE, TabularQLearning
from wherry.baselines.q_learning import QLearning
from wherry.pipelines.grids.arenas import Arena

MAX_EPISODE_STEPS = 300


class RecordedGenerator:
    """Replays recorded random numbers, two in [0, 1) for every step: for exploration, and for the random action."""

    def __init__(self, draws: np.ndarray) -> None:
        self.draws: Iterator[tuple[float, float]] = iter(draws.tolist())
        self.action_draw = 0.0

    def random(self) -> float:
        exploration_draw, self.action_draw = next(self.draws)
        return exploration_draw

    def integers(self, count: int) -> int:
        return int(self.action_draw * count)


@pytest.mark.parametrize(
    "compiled", [TabularQLearning(exploration=0.2), TabularQLearning(exploration=0.0, initial_value=20.0)]
)
def test_compiled_and_plain_q_learning_take_the_same_steps(compiled: TabularQLearning) -> None:
    arena = Arena.of_size(5)
    states = list(arena.tables.state_numbers)
    curve, _ = compiled.learn(
        arena.tables, arena.probes, np.random.default_rng(3), max_episode_steps=MAX_EPISODE_STEPS, max_steps=1
    )
    rng = np.random.default_rng(3)
    starts = rng.integers(arena.tables.start_count, size=BATCH_SIZE, dtype=np.int32)
    draws = rng.random((BATCH_SIZE, MAX_EPISODE_STEPS, 2))
    plain = QLearning(
        arena.environment.domain,
        cast("np.random.Generator", None),
        exploration=compiled.exploration,
        initial_value=compiled.initial_value,
    )
    steps = 0
    for episode in range(BATCH_SIZE):
        plain.rng = cast("np.random.Generator", RecordedGenerator(draws[episode]))
        state = states[starts[episode]]
        for _ in range(MAX_EPISODE_STEPS):
            transition = arena.truth.transition(state, plain.policy(state))
            plain.add_experience(transition)
            steps += 1
            if transition.terminated:
                break
            state = transition.next_state
        assert curve[episode][0] == steps
    assert steps < 0.9 * BATCH_SIZE * MAX_EPISODE_STEPS  # some episodes reached their end, so ends are compared too


def test_numbered_states_are_all_that_can_be_reached() -> None:
    tables = Arena.of_size(5).tables
    assert (len(tables.state_numbers), tables.start_count) == (25 * 4 * 3 * 2, 25 * 4 * 3)
    assert tables.successor.shape == tables.reward.shape == tables.terminates.shape == (len(tables.state_numbers), 6)
    assert 0 <= tables.successor.min() <= tables.successor.max() < len(tables.state_numbers)
    assert set(np.unique(tables.reward)) == {-10.0, -1.0, 20.0}
    assert (tables.reward[tables.terminates] == 20.0).all()
    assert tables.terminates.any()
