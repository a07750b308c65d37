"""DOORMAX keeps to its two algorithms as they should read, and to what was added to them."""

from __future__ import annotations

import pytest

from wherry.domains.delivery import BoxState, DeliverySite, all_delivered, delivery_reward, delivery_transition
from wherry.floorplan.plan import Cell, FloorPlan
from wherry.learning.doormax import Doormax
from wherry.learning.predictions import Subject
from wherry.oomdp.attributes import EXISTS
from wherry.oomdp.domain import Action
from wherry.oomdp.effects import EFFECT_TYPES
from wherry.oomdp.mdp import Transition
from wherry_testing.machine import PULL, ask, counter_of, machine_domain, state_of, teach

COUNTER = Subject("PRESS", "Machine", "counter")


def learner(switches: int = 3, **options: object) -> Doormax:
    return Doormax(machine_domain(switches), **options)


def models(doormax: Doormax, effect_type: str, subject: Subject = COUNTER) -> dict[object, str]:
    return {
        effect.argument: str(model)
        for effect, model in doormax.predictions.models[subject].get(effect_type, {}).items()
    }


def test_it_knows_nothing_at_first() -> None:
    assert ask(learner(), "101").most_likely.next_state is None
    assert ask(learner(), "101").most_likely.probability == 1.0


def test_a_failure_is_predicted_for_its_condition_and_no_other() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 3), reward=-1.0)
    prediction = ask(doormax, "101", counter=7)
    assert (counter_of(prediction), prediction.most_likely.reward, prediction.most_likely.terminated) == (
        7,
        -1.0,
        False,
    )
    assert ask(doormax, "111").most_likely.next_state is None
    assert ask(doormax, "101", action=PULL).most_likely.next_state is None


def test_one_success_is_predicted_for_its_condition() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4), reward=-1.0)
    assert models(doormax, "increment") == {1: "101"}
    assert models(doormax, "assignment") == {4: "101"}
    assert counter_of(ask(doormax, "101", counter=3)) == 4
    assert ask(doormax, "001").most_likely.next_state is None


def test_effects_that_disagree_are_no_prediction() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    assert ask(doormax, "101", counter=6).most_likely.next_state is None  # += 1 says 7, := 4 says 4


def test_successes_are_merged() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4), reward=-1.0)
    teach(doormax, "100", (5, 6), reward=-1.0)
    assert models(doormax, "increment") == {1: "10*"}
    assert counter_of(ask(doormax, "100", counter=5)) == 6
    assert ask(doormax, "110", counter=5).most_likely.next_state is None


def test_a_wrong_type_is_refuted_and_stays_away() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    teach(doormax, "101", (4, 5))  # := 4 was predicted
    assert models(doormax, "assignment") == {}
    assert doormax.predictions.removed[COUNTER]["assignment"] == "predicted what was not observed"
    teach(doormax, "101", (8, 9))
    assert "assignment" not in doormax.predictions.models[COUNTER]
    assert counter_of(ask(doormax, "101", counter=20)) == 21


def test_to_the_letter_a_wrong_type_stays_and_blocks_for_ever() -> None:
    doormax = learner(refutation=False, max_effects=2)
    teach(doormax, "101", (3, 4))
    teach(doormax, "010", (7, 8))  # := 4 and := 8 never overlap, so the paper keeps both
    assert models(doormax, "assignment") == {4: "101", 8: "010"}
    teach(doormax, "101", (3, 4))
    assert ask(doormax, "101", counter=20).most_likely.next_state is None


def test_two_effects_with_overlapping_conditions_remove_their_type() -> None:
    doormax = learner(refutation=False, max_effects=5)
    teach(doormax, "101", (3, 4))
    teach(doormax, "101", (3, 5))  # the same condition: neither is general enough to be told apart
    assert doormax.predictions.removed[COUNTER] == {
        "increment": "the conditions of two effects overlap",
        "assignment": "the conditions of two effects overlap",
    }


def test_merging_into_anothers_condition_removes_the_type() -> None:
    doormax = learner(refutation=False, max_effects=5, effect_types={"increment": EFFECT_TYPES["increment"]})
    teach(doormax, "100", (0, 1))
    teach(doormax, "110", (0, 2))
    assert models(doormax, "increment") == {1: "100", 2: "110"}
    teach(doormax, "111", (0, 1))  # 100 ⊕ 111 = 1** covers 110
    assert doormax.predictions.removed[COUNTER] == {"increment": "the conditions of two effects overlap"}


def test_more_than_k_effects_remove_the_type() -> None:
    doormax = learner(max_effects=2)
    for switches, before in [("100", 1), ("010", 5), ("001", 9)]:
        teach(doormax, switches, (before, before + 1))
    assert doormax.predictions.removed[COUNTER] == {"assignment": "more than 2 different effects"}
    assert models(doormax, "increment") == {1: "***"}


def test_an_attribute_that_no_type_explains_is_reported_and_not_explored_for_ever() -> None:
    doormax = learner(max_effects=1)
    for switches, counter in [("100", (0, 5)), ("010", (0, 9))]:
        teach(doormax, switches, counter)
    (violation,) = doormax.violations
    assert violation.startswith(
        "PRESS, machine.counter: no type of effect explains where it changes and where it stays"
    )
    assert "increment: more than 1 different effects" in violation
    assert counter_of(ask(doormax, "010")) == 9  # learnt anew, from its changes alone
    teach(doormax, "001", (0, 2))
    assert doormax.violations[1].startswith("PRESS, machine.counter: no type of effect explains its changes")
    assert ask(doormax, "111").most_likely.probability == 0.0
    before = dict(doormax.revisions)
    teach(doormax, "001", (0, 2))
    assert len(doormax.violations) == 2
    assert doormax.revisions == before  # nothing is left to be learnt of it


def test_to_the_letter_nothing_is_learnt_anew() -> None:
    doormax = learner(max_effects=1, refutation=False)
    for switches, counter in [("100", (0, 5)), ("010", (0, 9)), ("001", (0, 2))]:
        teach(doormax, switches, counter)
    assert doormax.violations
    assert ask(doormax, "001").most_likely.probability == 0.0


def test_rewards_that_no_condition_tells_apart_are_reported() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4), reward=1.0)
    assert doormax.violations == ()
    teach(doormax, "101", (5, 6), reward=2.0)
    (violation,) = doormax.violations
    assert violation.startswith("PRESS: the reward, or whether the episode ended, was not the same each time")
    assert "machine.s0 and not machine.s1 and machine.s2" in violation


def test_an_attribute_left_alone_needs_no_condition() -> None:
    doormax = learner()
    for switches, lamp in [("101", False), ("101", True), ("100", True)]:
        teach(doormax, switches, (3, 4), lamp=(lamp, lamp))
    lamp_rules = Subject("PRESS", "Machine", "lamp")
    assert models(doormax, "increment", lamp_rules) == {0: "10*"}
    assert "assignment" in doormax.predictions.removed[lamp_rules]
    assert ask(doormax, "100", counter=3, lamp=False).most_likely.next_state == state_of(
        doormax.domain, "100", 4, False
    )


def test_a_type_that_cannot_explain_a_change_is_refuted() -> None:
    doormax = learner()
    lamp = Subject("PRESS", "Machine", "lamp")
    teach(doormax, "101", (0, 0), lamp=(False, True))
    assert doormax.predictions.removed[lamp] == {"increment": "cannot explain a change"}
    assert models(doormax, "assignment", lamp) == {True: "101"}


def test_failures_of_attributes() -> None:
    doormax = learner(failure_scope="attribute")
    teach(doormax, "100", (0, 1), lamp=(False, False))
    teach(doormax, "110", (0, 0), lamp=(False, True))
    assert ask(doormax, "100").most_likely.next_state == state_of(doormax.domain, "100", 1, False)
    assert ask(doormax, "110").most_likely.next_state == state_of(doormax.domain, "110", 0, True)
    assert ask(doormax, "111").most_likely.next_state is None


def test_a_given_reward_and_end_are_not_learnt() -> None:
    doormax = learner(
        reward=lambda state, action, after: float(after["machine"].counter),
        terminated=lambda state: state["machine"].counter == 4,
    )
    teach(doormax, "101", (3, 4), reward=99.0)
    prediction = ask(doormax, "101", counter=3)
    assert (prediction.most_likely.reward, prediction.most_likely.terminated) == (4.0, True)


def test_a_slip_is_not_believed_the_first_time() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    teach(doormax, "101", (4, 5))
    teach(doormax, "101", (5, 5))
    assert "this is believed if it happens again" in doormax.violations[0]
    assert counter_of(ask(doormax, "101", counter=5)) == 6
    teach(doormax, "101", (5, 5))
    assert counter_of(ask(doormax, "101", counter=5)) == 5
    teach(doormax, "101", (5, 6))  # and a success after that is news, too
    assert counter_of(ask(doormax, "101", counter=5)) == 6
    assert "changed something where it had changed nothing before" in doormax.violations[1]


def test_asking_changes_nothing() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    revisions = dict(doormax.revisions)
    assert ask(doormax, "101", counter=3) == ask(doormax, "101", counter=3)
    assert ask(doormax, "000").most_likely.next_state is None
    assert doormax.revisions == revisions


def test_revisions_grow_with_news_only() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 3))
    assert doormax.revisions == {"PRESS": 1, "PULL": 0}
    teach(doormax, "101", (3, 3))
    assert doormax.revisions == {"PRESS": 1, "PULL": 0}


def test_other_effect_types_can_be_given() -> None:
    doormax = learner(effect_types=EFFECT_TYPES)
    for switches, counter in [("100", (2, 4)), ("110", (3, 6)), ("101", (5, 10))]:
        teach(doormax, switches, counter)
    assert models(doormax, "multiplication") == {2: "1**"}
    assert counter_of(ask(doormax, "111", counter=7)) == 14


def test_settling_keeps_the_simplest_type() -> None:
    doormax = learner()
    teach(doormax, "100", (3, 4))
    teach(doormax, "010", (5, 6))
    assert models(doormax, "assignment") == {4: "100", 6: "010"}
    assert ask(doormax, "100", counter=9).most_likely.next_state is None
    revisions = dict(doormax.revisions)
    doormax.settle()
    assert models(doormax, "increment") == {1: "**0"}
    assert models(doormax, "assignment") == {}
    assert counter_of(ask(doormax, "100", counter=9)) == 10
    assert doormax.revisions["PRESS"] > revisions["PRESS"]


def test_unknown_combinations_of_options_are_refused() -> None:
    with pytest.raises(ValueError, match="not of attributes"):
        learner(inference="near-miss", failure_scope="attribute")


def test_sentences() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    teach(doormax, "100", (5, 6))
    teach(doormax, "000", (5, 5))
    assert doormax.sentences() == (
        "PRESS: if machine.s0 and not machine.s1: machine.counter += 1",
        "PRESS: nothing happens under 1 other conditions",
    )


PLAN = FloorPlan("plan", 4, 1, warehouse=frozenset({Cell(3, 0)}), start=Cell(0, 0))
SITE = DeliverySite.of_plan(PLAN)
PICKUP, DROPOFF = Action("PICKUP"), Action("DROPOFF")


def deliverer() -> Doormax:
    return Doormax(SITE.domain, reward=delivery_reward, terminated=all_delivered)


def test_a_pickup_is_learnt_of_this_box_and_not_of_the_others() -> None:
    doormax = deliverer()
    state = SITE.state(Cell(1, 0), [BoxState("a", Cell(1, 0)), BoxState("b", Cell(3, 0))])
    doormax.add_experience(delivery_transition(state, PICKUP))
    other = SITE.state(Cell(1, 0), [BoxState("c", Cell(3, 0)), BoxState("d", Cell(1, 0))])
    predicted = doormax.predict(other, PICKUP).most_likely.next_state
    assert predicted is not None
    assert [box.in_bot for box in predicted.of_class("Box")] == [False, True]


def test_a_delivered_box_leaves_the_prediction() -> None:
    doormax = deliverer()
    held, waiting = BoxState("a", Cell(0, 0), in_bot=True), BoxState("b", Cell(0, 0))
    state = SITE.state(Cell(3, 0), [held, waiting])
    doormax.add_experience(delivery_transition(state, DROPOFF))
    assert doormax.predict(state, DROPOFF).most_likely.next_state == state.without("a")
    exists = Subject("DROPOFF", "Box", EXISTS)
    assert models(doormax, "assignment", exists) == {False: "1110011", True: "1110010"}
    assert models(doormax, "increment", Subject("DROPOFF", "Box", "x")) == {0: "1110010"}


def test_a_new_view_of_the_walls_is_no_change() -> None:
    doormax = deliverer()
    before = SITE.state(Cell(0, 0), [BoxState("a", Cell(2, 0))])
    narrower = DeliverySite(SITE.walls, SITE.warehouse | {Cell(2, 0)}, SITE.x_range, SITE.y_range)
    after = narrower.state(Cell(0, 0), [BoxState("a", Cell(2, 0))])
    doormax.add_experience(Transition(before, PICKUP, after, -10.0, False))
    assert doormax.failures["PICKUP"] == {SITE.domain.cond(before).value}
