"""DOORMAX follows the paper's two algorithms, as corrected, and the two steps that were added."""

from __future__ import annotations

import pytest

from wherry.learning.doormax import Doormax
from wherry.learning.effect_rules import Subject
from wherry.oomdp.effects import EFFECT_TYPES
from wherry_testing.doormax_rules import conditions_by_argument
from wherry_testing.machine import PULL, ask, counter_of, machine_domain, state_of, teach

COUNTER = Subject("PRESS", "Machine", "counter")


def learner(switches: int = 3, **options: object) -> Doormax:
    return Doormax(machine_domain(switches), **options)


def models(doormax: Doormax, effect_type: str, subject: Subject = COUNTER) -> dict[object, str]:
    return conditions_by_argument(doormax, subject, effect_type)


def test_everything_is_unknown_at_first() -> None:
    assert ask(learner(), "101").most_likely.next_state is None
    assert ask(learner(), "101").most_likely.probability == 1.0


def test_a_failure_is_predicted_for_its_condition_and_no_other() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 3), reward=-1.0)
    prediction = ask(doormax, "101", counter=7)
    outcome = prediction.most_likely
    assert (counter_of(prediction), outcome.reward, outcome.terminated) == (7, -1.0, False)
    assert ask(doormax, "111").most_likely.next_state is None
    assert ask(doormax, "101", action=PULL).most_likely.next_state is None


def test_one_success_is_predicted_for_its_condition() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4), reward=-1.0)
    assert models(doormax, "increment") == {1: "101"}
    assert models(doormax, "assignment") == {4: "101"}
    assert counter_of(ask(doormax, "101", counter=3)) == 4
    assert ask(doormax, "001").most_likely.next_state is None


def test_contradictory_effects_give_no_prediction() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    assert ask(doormax, "101", counter=6).most_likely.next_state is None  # += 1 says 7, := 4 says 4


def test_conditions_of_successes_are_merged() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4), reward=-1.0)
    teach(doormax, "100", (5, 6), reward=-1.0)
    assert models(doormax, "increment") == {1: "10*"}
    assert counter_of(ask(doormax, "100", counter=5)) == 6
    assert ask(doormax, "110", counter=5).most_likely.next_state is None


def test_a_refuted_effect_type_stays_removed() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    teach(doormax, "101", (4, 5))  # := 4 was predicted
    assert models(doormax, "assignment") == {}
    assert doormax.effect_rules.removed[COUNTER]["assignment"] == "predicted what was not observed"
    teach(doormax, "101", (8, 9))
    assert "assignment" not in doormax.effect_rules.models[COUNTER]
    assert counter_of(ask(doormax, "101", counter=20)) == 21


def test_without_refutation_a_wrong_effect_type_blocks_predictions() -> None:
    doormax = learner(refutation=False, max_effects=2)
    teach(doormax, "101", (3, 4))
    teach(doormax, "010", (7, 8))  # := 4 and := 8 never overlap, so the paper keeps both
    assert models(doormax, "assignment") == {4: "101", 8: "010"}
    teach(doormax, "101", (3, 4))
    assert ask(doormax, "101", counter=20).most_likely.next_state is None


def test_two_effects_with_overlapping_conditions_remove_their_type() -> None:
    doormax = learner(refutation=False, max_effects=5)
    teach(doormax, "101", (3, 4))
    teach(doormax, "101", (3, 5))  # the same condition
    assert doormax.effect_rules.removed[COUNTER] == {
        "increment": "the conditions of two effects overlap",
        "assignment": "the conditions of two effects overlap",
    }


def test_merging_into_the_condition_of_another_effect_removes_the_type() -> None:
    doormax = learner(refutation=False, max_effects=5, effect_types={"increment": EFFECT_TYPES["increment"]})
    teach(doormax, "100", (0, 1))
    teach(doormax, "110", (0, 2))
    assert models(doormax, "increment") == {1: "100", 2: "110"}
    teach(doormax, "111", (0, 1))  # 100 ⊕ 111 = 1** covers 110
    assert doormax.effect_rules.removed[COUNTER] == {"increment": "the conditions of two effects overlap"}


def test_more_than_k_effects_remove_the_type() -> None:
    doormax = learner(max_effects=2)
    for switches, before in [("100", 1), ("010", 5), ("001", 9)]:
        teach(doormax, switches, (before, before + 1))
    assert doormax.effect_rules.removed[COUNTER] == {"assignment": "more than 2 different effects"}
    assert models(doormax, "increment") == {1: "***"}


def test_an_attribute_that_no_type_explains_is_reported_and_no_longer_explored() -> None:
    doormax = learner(max_effects=1)
    for switches, counter in [("100", (0, 5)), ("010", (0, 9))]:
        teach(doormax, switches, counter)
    (violation,) = doormax.violations
    assert violation.startswith(
        "PRESS, machine.counter: no type of effect explains where it changes and where it stays"
    )
    assert "increment: more than 1 different effects" in violation
    assert counter_of(ask(doormax, "010")) == 9  # learnt again, from its changes alone
    teach(doormax, "001", (0, 2))
    assert doormax.violations[1].startswith("PRESS, machine.counter: no type of effect explains its changes")
    assert ask(doormax, "111").most_likely.probability == 0.0
    before = dict(doormax.revisions)
    teach(doormax, "001", (0, 2))
    assert len(doormax.violations) == 2
    assert doormax.revisions == before  # nothing more can be learnt about it


def test_without_refutation_nothing_is_learnt_again() -> None:
    doormax = learner(max_effects=1, refutation=False)
    for switches, counter in [("100", (0, 5)), ("010", (0, 9)), ("001", (0, 2))]:
        teach(doormax, switches, counter)
    assert doormax.violations
    assert ask(doormax, "001").most_likely.probability == 0.0


def test_different_rewards_under_one_condition_are_reported() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4), reward=1.0)
    assert doormax.violations == ()
    teach(doormax, "101", (5, 6), reward=2.0)
    (violation,) = doormax.violations
    assert violation.startswith("PRESS: the reward, or whether the episode ended, was not the same each time")
    assert "machine.s0 and not machine.s1 and machine.s2" in violation


def test_an_unchanged_attribute_is_explained_by_an_increment_of_zero() -> None:
    doormax = learner()
    for switches, lamp in [("101", False), ("101", True), ("100", True)]:
        teach(doormax, switches, (3, 4), lamp=(lamp, lamp))
    lamp_rules = Subject("PRESS", "Machine", "lamp")
    assert models(doormax, "increment", lamp_rules) == {0: "10*"}
    assert "assignment" in doormax.effect_rules.removed[lamp_rules]
    assert ask(doormax, "100", counter=3, lamp=False).most_likely.next_state == state_of(
        doormax.domain, "100", 4, False
    )


def test_a_type_that_cannot_explain_a_change_is_refuted() -> None:
    doormax = learner()
    lamp = Subject("PRESS", "Machine", "lamp")
    teach(doormax, "101", (0, 0), lamp=(False, True))
    assert doormax.effect_rules.removed[lamp] == {"increment": "cannot explain a change"}
    assert models(doormax, "assignment", lamp) == {True: "101"}


def test_failure_conditions_can_be_kept_for_each_attribute() -> None:
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


def test_an_unexpected_failure_counts_only_when_it_happens_again() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    teach(doormax, "101", (4, 5))
    teach(doormax, "101", (5, 5))
    assert "this counts only if it happens again" in doormax.violations[0]
    assert counter_of(ask(doormax, "101", counter=5)) == 6
    teach(doormax, "101", (5, 5))
    assert counter_of(ask(doormax, "101", counter=5)) == 5
    teach(doormax, "101", (5, 6))  # a success after that is reported, too
    assert counter_of(ask(doormax, "101", counter=5)) == 6
    assert "changed something where it had changed nothing before" in doormax.violations[1]


def test_predictions_do_not_change_the_learner() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    revisions = dict(doormax.revisions)
    assert ask(doormax, "101", counter=3) == ask(doormax, "101", counter=3)
    assert ask(doormax, "000").most_likely.next_state is None
    assert doormax.revisions == revisions


def test_revisions_grow_only_when_something_was_learnt() -> None:
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


def test_keep_simplest_keeps_the_effect_type_with_the_fewest_effects() -> None:
    doormax = learner()
    teach(doormax, "100", (3, 4))
    teach(doormax, "010", (5, 6))
    assert models(doormax, "assignment") == {4: "100", 6: "010"}
    assert ask(doormax, "100", counter=9).most_likely.next_state is None
    revisions = dict(doormax.revisions)
    doormax.keep_simplest()
    assert models(doormax, "increment") == {1: "**0"}
    assert models(doormax, "assignment") == {}
    assert counter_of(ask(doormax, "100", counter=9)) == 10
    assert doormax.revisions["PRESS"] > revisions["PRESS"]


def test_near_misses_of_attributes_are_refused() -> None:
    with pytest.raises(ValueError, match="not of attributes"):
        learner(inference="near-miss", failure_scope="attribute")


def test_sentences_state_rules_and_failures() -> None:
    doormax = learner()
    teach(doormax, "101", (3, 4))
    teach(doormax, "100", (5, 6))
    teach(doormax, "000", (5, 5))
    assert doormax.sentences() == (
        "PRESS: if machine.s0 and not machine.s1: machine.counter += 1",
        "PRESS: nothing happens under 1 other conditions",
    )
