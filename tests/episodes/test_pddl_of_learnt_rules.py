"""Fast Downward's plans for exported rules are optimal and reach the goal in the true environment."""

from __future__ import annotations

import re

import numpy as np
import pytest

from wherry.domains.delivery import (
    BoxState,
    DeliveryHeuristic,
    DeliverySite,
    all_delivered,
    boxes_left,
    delivery_reward,
    delivery_transition,
)
from wherry.domains.taxi import PROBES, TaxiGrid, taxi_grid
from wherry.episodes import GoalAgent, PolicyAgent, run_episode
from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import find_world
from wherry.learning.bayes import BayesianLearner
from wherry.learning.doormax import Doormax
from wherry.learning.registry import RULE_LEARNERS
from wherry.learning.rules import RuleLearner
from wherry.oomdp.conditional_models import PerStateModel
from wherry.oomdp.mdp import DeterministicMdp
from wherry.planning.pddl import export_pddl
from wherry.planning.prediction_cache import PredictionCache
from wherry.planning.search import a_star
from wherry.planning.value_iteration import ValueIteration
from wherry_testing.fast_downward import optimal_plan


def train(name: str, environment: TaxiGrid) -> RuleLearner:
    learner, rng = RULE_LEARNERS[name].factory(environment.domain), np.random.default_rng(0)
    agent = PolicyAgent(learner, ValueIteration(learner))
    for _ in range(40):
        list(run_episode(environment, agent, rng, max_steps=1000))
    return learner


@pytest.fixture(scope="module")
def taxi() -> TaxiGrid:
    return taxi_grid(5)


@pytest.fixture(scope="module")
def learner(taxi: TaxiGrid) -> RuleLearner:
    return train("doormax", taxi)


@pytest.mark.parametrize(("probe", "length"), [(PROBES[0], 10), (PROBES[1], 14), (PROBES[5], 13)])
def test_taxi_plans_have_the_published_optimal_length(
    taxi: TaxiGrid, learner: RuleLearner, probe: tuple, length: int
) -> None:
    state = taxi.state_of(*probe)
    actions = optimal_plan(export_pddl(learner, taxi.domain, state))
    assert len(actions) == length
    for action in actions:
        transition = taxi.transition(state, action)
        assert not transition.failed
        state = transition.next_state
    assert transition.terminated


def test_rules_of_a_small_grid_give_plans_on_a_large_one(taxi: TaxiGrid) -> None:
    learner, large = train("bayes", taxi), taxi_grid(10)
    assert len(optimal_plan(export_pddl(learner, large.domain, large.state_of(*PROBES[0])))) == 17


def test_operators_have_no_superfluous_preconditions(taxi: TaxiGrid, learner: RuleLearner) -> None:
    task = export_pddl(learner, taxi.domain, taxi.state_of(*PROBES[0]))
    conditions = dict(re.findall(r":action (\w+)\n.*?\n    :precondition \(and (.*)\)\n", task.domain))
    assert conditions["n_1"] == "(is_taxi ?taxi) (not (touch_n_taxi_wall ?taxi)) (taxi_y_plus_1 ?taxi ?taxi_after)"
    assert "(on_taxi_destination ?taxi) (passenger_in_taxi ?passenger)" in conditions["dropoff_1"]
    assert set(task.actions.values()) == set(taxi.domain.ground_actions(taxi.state_of(*PROBES[0])))
    assert len(task.actions) == 6
    assert task.problem.count("(touch_n_taxi_wall ") == 5  # the cells along the northern edge


def test_plan_for_two_boxes_is_optimal() -> None:
    site = DeliverySite.of_plan(find_world("small"))
    start = site.state(Cell(0, 5), [BoxState("box1", Cell(1, 0)), BoxState("box2", Cell(4, 2))])
    world = DeterministicMdp(site.domain, delivery_transition, lambda rng: start)
    learner = BayesianLearner(site.domain, reward=delivery_reward, terminated=all_delivered)
    agent = GoalAgent(learner, boxes_left, DeliveryHeuristic())
    steps = list(run_episode(world, agent, np.random.default_rng(0), max_steps=3000))
    assert steps[-1].transition.terminated
    best, unmet = a_star(PredictionCache(PerStateModel(site.domain, world)), start, boxes_left, DeliveryHeuristic())
    assert unmet == 0
    actions = optimal_plan(export_pddl(learner, site.domain, start))
    assert len(actions) == len(best.actions)
    state = start
    for action in actions:
        state = delivery_transition(state, action).next_state
    assert all_delivered(state)


def test_unknown_actions_have_no_operators(taxi: TaxiGrid) -> None:
    untrained = Doormax(taxi.domain)
    task = export_pddl(untrained, taxi.domain, taxi.state_of(*PROBES[0]))
    assert task.actions == {}
    assert optimal_plan(task) is None
