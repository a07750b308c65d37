"""A* on deliveries: the shortest plans, and as many boxes as can be delivered."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.domains.delivery import DeliveryHeuristic, boxes_left, delivery_grid
from wherry.floorplan.generation import generate_world
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.learning.bayes import BayesianLearner
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.domain import Action
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import a_star
from wherry_testing.brute_force import steps_to_every_state


@pytest.mark.parametrize("seed", range(4))
def test_plans_are_the_shortest_with_and_without_heuristic(seed: int) -> None:
    environment = delivery_grid(generate_world(6, 5, np.random.default_rng(seed), min_room_size=2), 2)
    start = environment.reset(np.random.default_rng(seed))
    fewest = min(steps for state, steps in steps_to_every_state(environment, start).items() if not boxes_left(state))
    cache = PredictionCache(PerStateModel(environment.domain, environment))
    for heuristic in (lambda state: 0.0, DeliveryHeuristic()):
        plan, unmet = a_star(cache, start, boxes_left, heuristic)
        assert unmet == 0
        assert len(plan.actions) == plan.cost == fewest
        for before, action, after in zip(plan.states, plan.actions, plan.states[1:], strict=False):
            assert environment.transition(before, action).next_state == after


def test_plan_delivers_the_boxes_that_can_be_reached() -> None:
    plan = FloorPlan(
        "plan", 5, 2, obstacles=frozenset({Cell(3, 0), Cell(3, 1)}), warehouse=frozenset({Cell(0, 0)}), start=Cell(0, 0)
    )
    environment = delivery_grid(plan.with_boxes([Cell(2, 0), Cell(4, 0)]))
    start = environment.reset(np.random.default_rng(0))
    found, unmet = a_star(PredictionCache(PerStateModel(environment.domain, environment)), start, boxes_left)
    assert unmet == 1
    assert [box.x for box in found.states[-1].of_class("Box")] == [4]
    assert [action.name for action in found.actions] == ["E", "E", "PICKUP", "W", "W", "DROPOFF"]


def test_learner_is_queried_again_only_about_revised_actions() -> None:
    environment = delivery_grid(find_world("small"))
    start = environment.reset(np.random.default_rng(0))
    learner = BayesianLearner(environment.domain)
    cache = PredictionCache(learner)
    cache.refresh()
    before = cache.predictions(start)
    learner.add_experience(environment.transition(start, Action("PICKUP")))
    cache.refresh()
    after = cache.predictions(start)
    same = [action.name for (action, old), (_, new) in zip(before, after, strict=True) if old is new]
    assert same == ["N", "S", "E", "W", "DROPOFF"]
