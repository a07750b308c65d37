"""The published learning experiment: its protocol, and the number of steps that the learners need."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import pytest

from wherry.errors import InputError
from wherry.learning.registry import RULE_LEARNERS, Job
from wherry.pipelines.grids.arenas import Arena
from wherry.pipelines.grids.learners import LEARNERS
from wherry.pipelines.grids.learning import (
    LearningExperiment,
    LearningResult,
    LearningSettings,
    probes_solved_by_transfer,
)


def run(learner: str, size: int, repetitions: int, seed: int = 0) -> LearningResult:
    experiment = LearningExperiment(LearningSettings(size=size, learner=learner, repetitions=repetitions, seed=seed))
    for _ in experiment.repetitions():
        pass
    return experiment.result()


@pytest.mark.parametrize(("size", "lengths"), [(5, [10, 14, 13, 13, 10, 13]), (10, [17, 22, 20, 24, 13, 21])])
def test_the_probes_are_the_published_ones(size: int, lengths: list[int]) -> None:
    assert [length for _, length in Arena.of_size(size).probes] == lengths


@pytest.mark.parametrize(
    ("learner", "repetitions", "mean"), [("doormax", 20, 450), ("doormax-near-miss", 10, 220), ("bayes", 10, 80)]
)
def test_rule_learners_converge_quickly_on_the_small_grid(learner: str, repetitions: int, mean: float) -> None:
    result = run(learner, 5, repetitions)
    assert result.converged == repetitions
    assert result.steps_mean is not None
    assert result.steps_mean <= mean


@pytest.mark.parametrize(("learner", "mean"), [("doormax", 1000), ("doormax-near-miss", 320), ("bayes", 110)])
def test_rule_learners_converge_quickly_on_the_large_grid(learner: str, mean: float) -> None:
    result = run(learner, 10, 5)
    assert result.converged == 5
    assert result.steps_mean is not None
    assert result.steps_mean <= mean


@pytest.mark.slow
@pytest.mark.parametrize(
    ("learner", "size", "mean", "p95"),
    [
        ("doormax", 5, 450, math.inf),
        ("doormax", 10, 800, math.inf),
        ("doormax-near-miss", 5, 200, math.inf),
        ("doormax-near-miss", 10, 260, math.inf),
        ("bayes", 5, 80, 150),
        ("bayes", 10, 110, 200),
    ],
)
def test_a_hundred_repetitions_need_few_steps(learner: str, size: int, mean: float, p95: float) -> None:
    result = run(learner, size, 100)
    assert result.converged == 100
    assert result.steps_mean is not None
    assert result.steps_p95 is not None
    assert result.steps_mean <= mean
    assert result.steps_p95 <= p95


@pytest.mark.parametrize("learner", ["rmax", "factored-rmax", "q-learning", "q-learning-optimistic"])
def test_baselines_converge_after_more_steps(learner: str) -> None:
    result = run(learner, 5, 1)
    assert result.converged == 1
    assert result.steps_mean is not None
    assert result.steps_mean > 600


@pytest.mark.parametrize("learner", ["bayes", "doormax"])
def test_rules_learnt_on_the_small_grid_solve_the_large_one(learner: str) -> None:
    large = Arena.of_size(10)
    experiment = LearningExperiment(LearningSettings(size=5, learner=learner, repetitions=5))
    for _ in experiment.repetitions():
        assert experiment.learner is not None
        assert probes_solved_by_transfer(experiment.learner, large) == 6


def test_unknown_answers_stay_below_the_bound_in_the_experiment() -> None:
    result = run("doormax", 5, 2)
    assert result.unknown_answers is not None
    assert result.unknown_answers_bound == 17
    assert 0 < result.unknown_answers <= result.unknown_answers_bound


def test_the_same_seed_gives_the_same_steps() -> None:
    steps = [[repetition.steps for repetition in run("bayes", 5, 3, seed).runs] for seed in (4, 4, 5)]
    assert steps[0] == steps[1] != steps[2]


def test_a_curve_ends_with_all_probes_solved() -> None:
    (repetition,) = run("bayes", 5, 1).runs
    assert repetition.curve[-1] == (repetition.steps, 6)
    assert all(earlier[0] < later[0] for earlier, later in pairwise(repetition.curve))


def test_the_result_is_plain_data() -> None:
    statistics = json.loads(json.dumps(run("bayes", 5, 2).as_json(), allow_nan=False))
    assert {"steps_mean", "steps_sd", "steps_p95", "converged", "repetitions", "ms_per_step"} <= statistics.keys()
    assert statistics["repetitions"] == statistics["converged"] == 2


@pytest.mark.parametrize("name", RULE_LEARNERS)
def test_every_rule_learner_is_kept_with_its_rules(name: str) -> None:
    experiment = LearningExperiment(LearningSettings(learner=name, repetitions=1))
    list(experiment.repetitions())
    assert experiment.learner is not None
    assert "N: if not touch_N(taxi, wall): taxi.y += 1" in experiment.learner.sentences()


@pytest.mark.parametrize(
    ("settings", "source"),
    [
        (LearningSettings(size=7), "--size"),
        (LearningSettings(learner="oracle"), "--learner"),
        (LearningSettings(repetitions=0), "--repetitions"),
    ],
)
def test_unknown_sizes_learners_and_no_repetitions_are_refused(settings: LearningSettings, source: str) -> None:
    with pytest.raises(InputError) as caught:
        LearningExperiment(settings)
    assert caught.value.source == source


def test_all_learners_can_be_compared() -> None:
    assert {"bayes", "doormax", "rmax", "factored-rmax", "q-learning"} <= set(LEARNERS)
    assert all(Job.COMPARISON in entry.jobs for entry in LEARNERS.values())
