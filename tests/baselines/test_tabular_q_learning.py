"""Q-learning on tables does, step by step, what Q-learning on objects does with the same random numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest

from wherry.baselines.compiled.q_learning import BLOCK, TabularQLearning
from wherry.baselines.q_learning import QLearning
from wherry.pipelines.grids.learning import Arena

LONGEST_EPISODE = 300


class Drawn:
    """A generator whose numbers were drawn before: for every step one that decides whether, one that decides what."""

    def __init__(self, draws: np.ndarray) -> None:
        self.steps: Iterator[tuple[float, float]] = iter(draws.tolist())
        self.what = 0.0

    def random(self) -> float:
        whether, self.what = next(self.steps)
        return whether

    def integers(self, count: int) -> int:
        return int(self.what * count)


@pytest.mark.parametrize(
    "settings", [TabularQLearning(exploration=0.2), TabularQLearning(exploration=0.0, first_value=20.0)]
)
def test_tables_and_objects_learn_the_same(settings: TabularQLearning) -> None:
    arena = Arena.of_size(5)
    states = list(arena.tables.numbers)
    curve, _ = settings.learn(arena.tables, arena.probes, np.random.default_rng(3), longest=LONGEST_EPISODE, patience=1)
    rng = np.random.default_rng(3)
    starts = rng.integers(arena.tables.starts, size=BLOCK, dtype=np.int32)
    draws = rng.random((BLOCK, LONGEST_EPISODE, 2))
    learner = QLearning(
        arena.environment.domain,
        cast("np.random.Generator", None),
        exploration=settings.exploration,
        first_value=settings.first_value,
    )
    steps = 0
    for episode in range(BLOCK):
        learner.rng = cast("np.random.Generator", Drawn(draws[episode]))
        state = states[starts[episode]]
        for _ in range(LONGEST_EPISODE):
            done = arena.environment.transition(state, learner.policy(state))
            learner.add_experience(done)
            steps += 1
            if done.terminated:
                break
            state = done.next_state
        assert curve[episode][0] == steps
    assert steps < 0.9 * BLOCK * LONGEST_EPISODE  # some episodes came to their end, which tells more


def test_all_states_of_the_small_grid_are_numbered_and_lead_on() -> None:
    tables = Arena.of_size(5).tables
    assert (len(tables.numbers), tables.starts) == (25 * 4 * 3 * 2, 25 * 4 * 3)
    assert tables.successor.shape == tables.reward.shape == tables.ends.shape == (len(tables.numbers), 6)
    assert 0 <= tables.successor.min() <= tables.successor.max() < len(tables.numbers)
    assert set(np.unique(tables.reward)) == {-10.0, -1.0, 20.0}
    assert (tables.reward[tables.ends] == 20.0).all()
    assert tables.ends.any()
