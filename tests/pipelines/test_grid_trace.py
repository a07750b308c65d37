"""Trace records of a learner on a grid."""

from __future__ import annotations

import pytest

from wherry.pipelines.grids.learning import LearningExperiment, LearningSettings
from wherry.trace.records import (
    CellLayout,
    LearntModel,
    Narration,
    PerceivedState,
    Record,
    RunStarted,
    StepTaken,
)


@pytest.fixture(scope="module")
def learning() -> list[Record]:
    records: list[Record] = []
    experiment = LearningExperiment(LearningSettings(learner="doormax", repetitions=2, seed=0))
    experiment.sink = records.append
    steps = [repetition.steps for repetition in experiment.repetitions()]
    assert sum(isinstance(record, StepTaken) for record in records) == steps[0]  # the first one alone
    return records


def test_trace_of_a_learner_on_a_grid_starts_without_rules(learning: list[Record]) -> None:
    assert isinstance(learning[0], RunStarted)
    assert learning[0].terms[0] == "touch_N(taxi, wall)"
    assert sum(isinstance(record, CellLayout) for record in learning) == 1
    steps = [record for record in learning if isinstance(record, StepTaken)]
    assert [record.time for record in steps] == [1.0 + at for at in range(len(steps))]
    assert max(record.unknown_pairs for record in steps) > 5
    assert steps[-1].unknown_pairs <= 2
    assert sum(isinstance(record, PerceivedState) for record in learning) == len(steps)


def test_rules_are_emitted_when_they_change_and_end_with_the_true_ones(learning: list[Record]) -> None:
    learnt = [record for record in learning if isinstance(record, LearntModel)]
    assert len({record.rules for record in learnt}) > 5
    rules = {(rule.action, rule.condition, rule.effect) for rule in learnt[-1].rules}
    assert {("N", "0******", "taxi.y += 1"), ("S", "*0*****", "taxi.y -= 1")} <= rules
    assert isinstance(learning[-1], Narration)
    assert learning[-1].phase == "done"
