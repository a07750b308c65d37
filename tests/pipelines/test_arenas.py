"""The environment and the true model of every arena agree, and learners converge under the published protocol."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.pipelines.grids.arenas import ARENAS
from wherry.pipelines.grids.learning import LearningExperiment, LearningSettings


@pytest.mark.parametrize("name", ARENAS)
def test_environment_and_true_model_of_an_arena_agree(name: str) -> None:
    arena = ARENAS[name](5, "small")
    rng = np.random.default_rng(1)
    state = arena.environment.reset(rng)
    for _ in range(50):
        actions = arena.environment.domain.ground_actions(state)
        transition = arena.environment.step(actions[rng.integers(len(actions))])
        assert transition == arena.truth.transition(transition.state, transition.action)
        state = arena.environment.reset(rng) if transition.terminated else transition.next_state
    assert arena.environment.reset(rng) in arena.starts
    assert len({length for _, length in arena.probes}) > 1
    assert len({state for state, _ in arena.probes}) == 6


@pytest.mark.parametrize("domain", ["delivery", "gymnasium-taxi"])
def test_near_misses_converge_in_other_domains(domain: str) -> None:
    experiment = LearningExperiment(LearningSettings(learner="doormax-near-miss", repetitions=2, domain=domain))
    list(experiment.repetitions())
    result = experiment.result()
    assert result.converged == 2
    assert result.steps_mean is not None
    assert result.steps_mean < 500


def test_all_states_of_gymnasium_taxi_are_numbered() -> None:
    arena = ARENAS["gymnasium-taxi"](5, "small")
    assert len(arena.tables.state_numbers) == 500
    assert arena.tables.start_count == 300


def test_unknown_domains_worlds_sizes_and_networks_are_refused() -> None:
    for settings, source in (
        (LearningSettings(domain="chess"), "DOMAIN"),
        (LearningSettings(domain="delivery", world="nowhere"), "nowhere"),
        (LearningSettings(domain="taxi", size=6), "--size"),
    ):
        with pytest.raises(InputError) as caught:
            LearningExperiment(settings)
        assert caught.value.source == source
    experiment = LearningExperiment(LearningSettings(domain="delivery", learner="factored-rmax", repetitions=1))
    with pytest.raises(InputError, match="needs a network of dependencies"):
        list(experiment.repetitions())
