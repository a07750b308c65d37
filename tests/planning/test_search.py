"""A* and the search for experiments on a corridor of nine cells."""

from __future__ import annotations

import pytest

from wherry.oomdp.attributes import integer
from wherry.oomdp.conditional_models import ConditionalPrediction, ConstantOutcome
from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import UNKNOWN, Outcome, Prediction
from wherry.oomdp.objects import ObjectClass, State
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import a_star, cheapest_experiment, step_cost

WALKER = ObjectClass("Walker", (integer("x", 0, 8),))
DOMAIN = Domain("corridor", (WALKER,), (), {"left": (), "right": (), "probe": ()})
PROBE = Action("probe")


def state_at(x: int) -> State:
    return State((WALKER("walker", x=x),))


class Corridor:
    """A model of moves to the left and right, and of a probe whose outcome is unknown in some cells.

    Args:
        unknown: Probability of the probe's unknown outcome, by cell.
        disagreements: Disagreement about the probe's outcome, by cell.
    """

    has_disagreement = True

    def __init__(self, unknown: dict[int, float], disagreements: dict[int, float]) -> None:
        self.domain = DOMAIN
        self.unknown, self.disagreements = unknown, disagreements
        self.revisions = {"probe": 0}
        self.queried: list[Action] = []

    def state_key(self, state: State) -> State:
        return state

    def predict(self, state: State, action: Action) -> Prediction:
        x = state["walker"].x
        if action != PROBE:
            step = 1 if action.name == "right" else -1
            return Prediction((Outcome(state_at(min(8, max(0, x + step))), -1.0, False),))
        if x in self.unknown:
            return Prediction((Outcome(None, probability=self.unknown[x]),))
        return Prediction((Outcome(state, -1.0, False),), self.disagreements.get(x, 0.0))

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        self.queried.append(action)
        (outcome,), disagreement = self.predict(state, action)
        return ConditionalPrediction(((ConstantOutcome(outcome), outcome.probability),), disagreement)


def cheapest(corridor: Corridor, start: int, **options: object) -> tuple[int, float] | None:
    """The cell of the cheapest experiment, and the cost of the plan."""
    plan = cheapest_experiment(PredictionCache(corridor), state_at(start), **options)
    if plan is None:
        return None
    assert plan.actions[-1] == PROBE
    assert len(plan.actions) == len(plan.states)
    return plan.states[-1]["walker"].x, plan.cost


@pytest.mark.parametrize("heuristic", [lambda state: 0.0, lambda state: abs(state["walker"].x - 6)])
def test_plan_to_a_goal_is_the_shortest(heuristic: object) -> None:
    cache = PredictionCache(Corridor({}, {}))
    plan, unmet = a_star(cache, state_at(2), lambda state: float(state["walker"].x != 6), heuristic)
    assert (plan.cost, unmet) == (4, 0)
    assert [action.name for action in plan.actions] == ["right"] * 4
    assert [state["walker"].x for state in plan.states] == [2, 3, 4, 5, 6]


def test_plan_reduces_unmet_goals_as_far_as_possible() -> None:
    plan, unmet = a_star(PredictionCache(Corridor({}, {})), state_at(2), lambda state: 20 - state["walker"].x)
    assert (plan.states[-1]["walker"].x, unmet) == (8, 12)


def test_plan_is_empty_in_a_goal_state() -> None:
    plan, unmet = a_star(PredictionCache(Corridor({}, {})), state_at(2), lambda state: 0)
    assert (plan.actions, plan.states, unmet) == ((), (state_at(2),), 0)


def test_nearest_unknown_outcome_is_the_cheapest_experiment() -> None:
    assert cheapest(Corridor({1: 1.0, 7: 1.0}, {}), start=3) == (1, 3.0)
    assert cheapest(Corridor({1: 1.0, 7: 1.0}, {}), start=5) == (7, 3.0)


def test_likelier_unknown_outcome_justifies_a_longer_path() -> None:
    assert cheapest(Corridor({3: 0.1, 7: 0.5}, {}), start=3) == (7, 6.0)
    assert cheapest(Corridor({3: 0.2, 7: 0.5}, {}), start=3) == (3, 5.0)


def test_impossible_outcome_is_no_experiment() -> None:
    assert cheapest(Corridor({3: 0.0}, {}), start=3) is None


def test_disagreements_are_experiments() -> None:
    assert cheapest(Corridor({0: 1.0}, {6: 1.0}), start=5) == (6, 2.0)
    assert cheapest(Corridor({0: 1.0}, {6: 1.0}), start=1) == (0, 2.0)
    assert cheapest(Corridor({}, {1: 0.5, 5: 1.0}), start=2) == (1, 3.0)


def test_unknown_outcomes_can_be_excluded_from_experiments() -> None:
    assert cheapest(Corridor({0: 1.0}, {6: 1.0}), start=1, disagreements_only=True) == (6, 6.0)
    assert cheapest(Corridor({0: 1.0}, {}), start=1, disagreements_only=True) is None


def test_experiment_costs_less_than_the_maximum() -> None:
    assert cheapest(Corridor({8: 1.0}, {}), start=0, max_cost=9.5) == (8, 9.0)
    assert cheapest(Corridor({8: 1.0}, {}), start=0, max_cost=8.5) is None


def test_step_cost_is_the_expected_number_of_attempts() -> None:
    assert step_cost(Outcome(None, probability=0.25)) == 4.0
    assert step_cost(UNKNOWN.most_likely) == 1.0


def test_model_is_queried_again_only_about_revised_actions() -> None:
    corridor = Corridor({}, {})
    cache = PredictionCache(corridor)
    cache.refresh()
    before = cache.predictions(state_at(3))
    assert len(corridor.queried) == 3
    corridor.unknown[3] = 0.5
    corridor.revisions["probe"] += 1
    assert cache.predictions(state_at(3)) is before  # the cache has not been refreshed
    cache.refresh()
    after = dict(cache.predictions(state_at(3)))
    assert corridor.queried[3:] == [PROBE]
    assert after[PROBE].most_likely == Outcome(None, probability=0.5)


def test_excluded_action_is_not_considered() -> None:
    cache = PredictionCache(Corridor({}, {}))
    assert len(cache.predictions(state_at(3))) == 3
    cache.exclude(state_at(3), PROBE)
    assert [action.name for action, _ in cache.predictions(state_at(3))] == ["left", "right"]
    assert len(cache.predictions(state_at(4))) == 3
