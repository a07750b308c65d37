"""DOORMAX on deliveries and Taxi: several objects of a class, objects that leave, and the bound of the theorem."""

from __future__ import annotations

import numpy as np
import pytest

from wherry.domains.delivery import (
    BoxState,
    DeliverySite,
    all_delivered,
    delivery_grid,
    delivery_reward,
    delivery_transition,
)
from wherry.domains.taxi import taxi_grid
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.floorplan.world_files import find_world
from wherry.learning.bounds import UnknownAnswers
from wherry.learning.doormax import Doormax
from wherry.learning.effect_rules import Subject
from wherry.oomdp.attributes import EXISTS
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import DeterministicMdp, Transition
from wherry_testing.doormax_rules import conditions_by_argument

PLAN = FloorPlan("plan", 4, 1, warehouse=frozenset({Cell(3, 0)}), start=Cell(0, 0))
SITE = DeliverySite.of_plan(PLAN)
PICKUP, DROPOFF = Action("PICKUP"), Action("DROPOFF")


def delivery_learner() -> Doormax:
    return Doormax(SITE.domain, reward=delivery_reward, terminated=all_delivered)


def test_a_pickup_is_learnt_for_the_box_under_the_robot_only() -> None:
    doormax = delivery_learner()
    state = SITE.state(Cell(1, 0), [BoxState("a", Cell(1, 0)), BoxState("b", Cell(3, 0))])
    doormax.add_experience(delivery_transition(state, PICKUP))
    other = SITE.state(Cell(1, 0), [BoxState("c", Cell(3, 0)), BoxState("d", Cell(1, 0))])
    predicted = doormax.predict(other, PICKUP).most_likely.next_state
    assert predicted is not None
    assert [box.in_bot for box in predicted.of_class("Box")] == [False, True]


def test_a_delivered_box_leaves_the_predicted_state() -> None:
    doormax = delivery_learner()
    held, waiting = BoxState("a", Cell(0, 0), in_bot=True), BoxState("b", Cell(0, 0))
    state = SITE.state(Cell(3, 0), [held, waiting])
    doormax.add_experience(delivery_transition(state, DROPOFF))
    assert doormax.predict(state, DROPOFF).most_likely.next_state == state.without("a")
    exists = Subject("DROPOFF", "Box", EXISTS)
    assert conditions_by_argument(doormax, exists, "assignment") == {False: "1110011", True: "1110010"}
    assert conditions_by_argument(doormax, Subject("DROPOFF", "Box", "x"), "increment") == {0: "1110010"}


def test_newly_perceived_walls_do_not_count_as_a_change() -> None:
    doormax = delivery_learner()
    before = SITE.state(Cell(0, 0), [BoxState("a", Cell(2, 0))])
    narrower = DeliverySite(SITE.walls, SITE.warehouse | {Cell(2, 0)}, SITE.x_range, SITE.y_range)
    after = narrower.state(Cell(0, 0), [BoxState("a", Cell(2, 0))])
    doormax.add_experience(Transition(before, PICKUP, after, -10.0, False))
    assert doormax.failures.conditions["PICKUP"] == {SITE.domain.cond(before).value}


@pytest.mark.parametrize("environment", [taxi_grid(5), delivery_grid(find_world("small"))], ids=["taxi", "delivery"])
@pytest.mark.parametrize("options", [{}, {"failure_scope": "attribute"}, {"refutation": False}, {"max_effects": 3}])
def test_unknown_answers_stay_below_the_bound(environment: DeterministicMdp, options: dict) -> None:
    learner = Doormax(environment.domain, **options)
    answers = UnknownAnswers(learner)
    rng = np.random.default_rng(1)
    state = environment.reset(rng)
    for _ in range(2500):
        actions = environment.domain.ground_actions(state)
        transition = environment.step(actions[rng.integers(len(actions))])
        answers.observe(transition)
        learner.add_experience(transition)
        state = environment.reset(rng) if transition.terminated else transition.next_state
    assert 0 < answers.max_count <= answers.bound
