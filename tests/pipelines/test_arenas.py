"""Every arena is what its name says, and learners learn in it under the published protocol."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.pipelines.grids.arenas import ARENAS
from wherry.pipelines.grids.learning import LearningExperiment, LearningSettings


@pytest.mark.parametrize("name", ARENAS)
def test_an_arena_acts_and_tests_in_the_same_world(name: str) -> None:
    arena = ARENAS[name](5, "small")
    rng = np.random.default_rng(1)
    state = arena.environment.reset(rng)
    for _ in range(50):
        actions = arena.environment.domain.ground_actions(state)
        done = arena.environment.step(actions[rng.integers(len(actions))])
        assert done == arena.truth.transition(done.state, done.action)
        state = arena.environment.reset(rng) if done.terminated else done.next_state
    assert arena.environment.reset(rng) in arena.starts
    assert len({length for _, length in arena.probes}) > 1
    assert len({state for state, _ in arena.probes}) == 6


@pytest.mark.parametrize("domain", ["delivery", "gymnasium-taxi"])
def test_near_misses_learn_other_domains_too(domain: str) -> None:
    experiment = LearningExperiment(LearningSettings(learner="doormax-near-miss", repetitions=2, domain=domain))
    list(experiment.repetitions())
    result = experiment.result()
    assert result.converged == 2
    assert result.steps_mean is not None
    assert result.steps_mean < 500


def test_gymnasium_taxi_has_all_of_its_states() -> None:
    arena = ARENAS["gymnasium-taxi"](5, "small")
    assert len(arena.tables.state_numbers) == 500
    assert arena.tables.start_count == 300


def test_what_cannot_be_is_refused() -> None:
    for settings, source in (
        (LearningSettings(domain="chess"), "DOMAIN"),
        (LearningSettings(domain="delivery", world="nowhere"), "nowhere"),
        (LearningSettings(domain="taxi", size=6), "--size"),
    ):
        with pytest.raises(InputError) as caught:
            LearningExperiment(settings)
        assert caught.value.source == source
    experiment = LearningExperiment(LearningSettings(domain="delivery", learner="factored-rmax", repetitions=1))
    with pytest.raises(InputError, match="needs to be told"):
        list(experiment.repetitions())
