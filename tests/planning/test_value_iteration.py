"""Value iteration on MDPs whose values are computed by hand; optimism about unknown outcomes."""

from __future__ import annotations

import pytest

from wherry.planning.value_iteration import ValueIteration
from wherry_testing.small_worlds import CORRIDOR, LEFT, RIGHT, TableModel, per_state, state_at


def test_unknown_outcome_is_worth_r_max_in_every_step_to_an_optimist() -> None:
    known = {key: value for key, value in CORRIDOR.items() if key != (0, "left")}
    optimist = ValueIteration(per_state(TableModel(known)), discount=0.5, r_max=100.0)
    assert optimist.policy(state_at(0)) == LEFT
    assert optimist.value(state_at(0)) == pytest.approx(200.0)
    assert optimist.value(state_at(1)) == pytest.approx(-1 + 0.5 * 200.0)


def test_unknown_outcome_is_avoided_by_a_pessimist() -> None:
    known = {key: value for key, value in CORRIDOR.items() if key != (0, "left")}
    pessimist = ValueIteration(per_state(TableModel(known)), discount=0.5, optimistic=False)
    assert pessimist.policy(state_at(0)) == RIGHT
    assert pessimist.value(state_at(0)) == pytest.approx(4.0)
