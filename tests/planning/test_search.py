"""A* finds the shortest plans, experiments are the cheapest, and what was worked out once is not asked again."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from wherry.domains.delivery import BoxState, DeliveryHeuristic, DeliverySite, boxes_left, delivery_grid
from wherry.floorplan.generation import generate_world
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.learning.bayes import BayesianLearner
from wherry.oomdp.conditional_models import ConditionalPrediction, ConstantOutcome, PerStateModel
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import UNKNOWN, DeterministicMdp, Outcome, Prediction
from wherry.oomdp.objects import State
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import a_star, cheapest_experiment, step_cost


def shortest(environment: DeterministicMdp, start: State) -> dict[State, int]:
    """Steps to every state, by plain breadth-first search."""
    steps, queue = {start: 0}, deque([start])
    while queue:
        state = queue.popleft()
        for action in environment.domain.ground_actions(state):
            after = environment.transition(state, action).next_state
            if after not in steps:
                steps[after] = steps[state] + 1
                queue.append(after)
    return steps


def worlds(count: int) -> list[DeterministicMdp]:
    rng = np.random.default_rng(5)
    return [delivery_grid(generate_world(6, 5, rng, min_room_size=2), 2) for _ in range(count)]


@pytest.mark.parametrize("seed", range(4))
def test_plans_are_the_shortest_with_and_without_a_heuristic(seed: int) -> None:
    environment = worlds(4)[seed]
    start = environment.reset(np.random.default_rng(seed))
    best = min(steps for state, steps in shortest(environment, start).items() if not boxes_left(state))
    cache = PredictionCache(PerStateModel(environment.domain, environment))
    for heuristic in (lambda state: 0.0, DeliveryHeuristic()):
        plan, left = a_star(cache, start, boxes_left, heuristic)
        assert left == 0
        assert len(plan.actions) == plan.cost == best
        for before, action, after in zip(plan.states, plan.actions, plan.states[1:], strict=False):
            assert environment.transition(before, action).next_state == after


@pytest.mark.parametrize("seed", range(3))
def test_the_deliverys_heuristic_is_admissible(seed: int) -> None:
    environment = worlds(3)[seed]
    start = environment.reset(np.random.default_rng(seed))
    heuristic = DeliveryHeuristic()
    for state in list(shortest(environment, start))[::40]:
        ends = [steps for after, steps in shortest(environment, state).items() if not boxes_left(after)]
        assert heuristic(state) <= min(ends, default=float("inf"))


def test_the_most_is_done_where_not_all_can_be() -> None:
    plan = FloorPlan(
        "plan", 5, 2, obstacles=frozenset({Cell(3, 0), Cell(3, 1)}), warehouse=frozenset({Cell(0, 0)}), start=Cell(0, 0)
    )
    environment = delivery_grid(plan.with_boxes([Cell(2, 0), Cell(4, 0)]))
    start = environment.reset(np.random.default_rng(0))
    found, left = a_star(PredictionCache(PerStateModel(environment.domain, environment)), start, boxes_left)
    assert left == 1
    assert [box.x for box in found.states[-1].of_class("Box")] == [4]
    assert len(found.actions) == 6  # E E PICKUP W W DROPOFF


def test_nothing_to_do_is_an_empty_plan() -> None:
    site = DeliverySite.of_plan(FloorPlan("plan", 2, 1, warehouse=frozenset({Cell(0, 0)}), start=Cell(0, 0)))
    environment = delivery_grid(
        FloorPlan("plan", 2, 1, warehouse=frozenset({Cell(0, 0)}), start=Cell(1, 0), box_count=0)
    )
    plan, left = a_star(
        PredictionCache(PerStateModel(site.domain, environment)), site.state(Cell(1, 0), []), boxes_left
    )
    assert (plan.actions, left) == ((), 0)


class Corridor:
    """A robot in a row of cells that knows how to go east and west, and not what PICKUP does in some of them."""

    revisions: dict[str, int]
    has_disagreement = True

    def __init__(self, unknown: dict[int, float], disagreements: dict[int, float]) -> None:
        plan = FloorPlan("row", 9, 1, warehouse=frozenset({Cell(0, 0)}), start=Cell(0, 0))
        self.site = DeliverySite.of_plan(plan)
        self.domain = self.site.domain
        self.unknown, self.disagreements = unknown, disagreements
        self.revisions = {"PICKUP": 0}

    def state_key(self, state: State) -> State:
        return state

    def at(self, x: int) -> State:
        return self.site.state(Cell(x, 0), [BoxState("box", Cell(0, 0))])

    def predict(self, state: State, action: Action) -> Prediction:
        x = state["robot"].x
        if action.name in ("E", "W"):
            return Prediction((Outcome(self.at(min(8, max(0, x + (1 if action.name == "E" else -1)))), -1.0, False),))
        if action.name == "PICKUP" and x in self.unknown:
            return Prediction((Outcome(None, probability=self.unknown[x]),))
        disagreement = self.disagreements.get(x, 0.0) if action.name == "PICKUP" else 0.0
        return Prediction((Outcome(state, -1.0, False),), disagreement)

    def conditional_prediction(self, state: State, action: Action) -> ConditionalPrediction:
        (outcome,), disagreement = self.predict(state, action)
        return ConditionalPrediction(((ConstantOutcome(outcome), outcome.probability),), disagreement)


def experiment(corridor: Corridor, start: int, **options: object) -> tuple[int, float] | None:
    """Where the cheapest experiment is made, and what it costs."""
    plan = cheapest_experiment(PredictionCache(corridor), corridor.at(start), **options)
    if plan is None:
        return None
    assert plan.actions[-1] == Action("PICKUP")
    assert len(plan.actions) == len(plan.states)
    return plan.states[-1]["robot"].x, plan.cost


def test_the_nearest_unknown_is_the_cheapest() -> None:
    assert experiment(Corridor({1: 1.0, 7: 1.0}, {}), start=3) == (1, 3.0)
    assert experiment(Corridor({1: 1.0, 7: 1.0}, {}), start=5) == (7, 3.0)


def test_a_likely_one_is_worth_a_longer_way() -> None:
    assert experiment(Corridor({3: 0.1, 7: 0.5}, {}), start=3) == (7, 6.0)
    assert experiment(Corridor({3: 0.2, 7: 0.5}, {}), start=3) == (3, 5.0)


def test_what_is_hopeless_is_no_experiment() -> None:
    assert experiment(Corridor({3: 0.0}, {}), start=3) is None


def test_a_limit_is_kept() -> None:
    assert experiment(Corridor({8: 1.0}, {}), start=0, max_cost=9.5) == (8, 9.0)
    assert experiment(Corridor({8: 1.0}, {}), start=0, max_cost=8.5) is None


def test_uncertain_steps_cost_what_they_take_on_average() -> None:
    assert step_cost(Outcome(None, probability=0.25)) == 4.0
    assert step_cost(UNKNOWN.most_likely) == 1.0


def test_a_model_is_asked_again_only_about_what_it_has_learnt() -> None:
    environment = delivery_grid(find_world("small"))
    start = environment.reset(np.random.default_rng(0))
    learner = BayesianLearner(environment.domain)
    cache = PredictionCache(learner)
    cache.refresh()
    before = cache.predictions(start)
    assert cache.predictions(start) is before
    learner.add_experience(environment.transition(start, Action("PICKUP")))
    assert cache.predictions(start) is before  # until a search notices
    cache.refresh()
    after = cache.predictions(start)
    assert after is not before
    same = [action.name for (action, old), (_, new) in zip(before, after, strict=True) if old is new]
    assert same == ["N", "S", "E", "W", "DROPOFF"]


def test_what_is_barred_is_not_considered() -> None:
    environment = delivery_grid(find_world("small"))
    start = environment.reset(np.random.default_rng(0))
    cache = PredictionCache(PerStateModel(environment.domain, environment))
    assert len(cache.predictions(start)) == 6
    cache.exclude(start, Action("N"))
    assert [action.name for action, _ in cache.predictions(start)] == ["S", "E", "W", "PICKUP", "DROPOFF"]


def test_doubts_are_experiments_too() -> None:
    assert experiment(Corridor({0: 1.0}, {6: 1.0}), start=5) == (6, 2.0)
    assert experiment(Corridor({0: 1.0}, {6: 1.0}), start=1) == (0, 2.0)
    assert experiment(Corridor({0: 1.0}, {6: 1.0}), start=1, disagreements_only=True) == (6, 6.0)
    assert experiment(Corridor({0: 1.0}, {}), start=1, disagreements_only=True) is None
    assert experiment(Corridor({}, {1: 0.5, 5: 1.0}), start=2) == (1, 3.0)
