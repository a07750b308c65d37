"""The Bayesian learner predicts with probabilities after few examples, and corrects its errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wherry.learning.bayes import BayesianLearner
from wherry.oomdp.mdp import Transition
from wherry_testing.machine import PULL, ask, counter_of, machine_domain, state_of, teach


def learner(switches: int = 3, **options: object) -> BayesianLearner:
    return BayesianLearner(machine_domain(switches), **options)


def p_unknown(bayes: BayesianLearner, switches: str) -> float:
    """Return the probability of the unknown outcomes of PRESS."""
    prediction = ask(bayes, switches)
    return sum(outcome.probability for outcome in prediction.outcomes if outcome.next_state is None)


def test_an_untried_action_has_an_unknown_outcome() -> None:
    bayes = learner()
    assert 0.0 < p_unknown(bayes, "101") < 1.0
    prediction = ask(bayes, "101")
    assert sum(outcome.probability for outcome in prediction.outcomes) == 1.0


def test_an_action_that_failed_is_more_likely_to_succeed_where_more_terms_differ() -> None:
    bayes = learner()
    teach(bayes, "000", (0, 0))
    assert p_unknown(bayes, "000") == 0.0
    assert 0.0 < p_unknown(bayes, "100") < p_unknown(bayes, "110") < p_unknown(bayes, "111")
    assert counter_of(ask(bayes, "000", counter=4)) == 4


def test_untried_conditions_may_end_the_episode_until_one_has_ended() -> None:
    bayes = learner()
    teach(bayes, "000", (0, 1))
    teach(bayes, "001", (0, 1))
    assert p_unknown(bayes, "000") == 0.0
    assert bayes.unseen.novelty < p_unknown(bayes, "100") < p_unknown(bayes, "110")
    before = dict(bayes.revisions)
    teach(bayes, "000", (0, 0), action=PULL, terminated=True)
    # The revisions of all actions grow, so that planners update their cached predictions.
    assert all(bayes.revisions[action] > before[action] for action in before)
    assert p_unknown(bayes, "110") == pytest.approx(bayes.unseen.novelty, rel=0.1)


def test_untried_conditions_are_not_expected_to_end_the_episode_where_its_end_is_given() -> None:
    bayes = learner(terminated=lambda state: False)
    teach(bayes, "000", (0, 1))
    assert p_unknown(bayes, "110") == pytest.approx(bayes.unseen.novelty, rel=0.1)


def test_a_success_generalizes_less_where_more_terms_differ() -> None:
    bayes = learner()
    teach(bayes, "101", (3, 4), reward=-1.0)
    predictions = [ask(bayes, switches, counter=8) for switches in ("101", "100", "110", "010")]
    assert [counter_of(prediction) for prediction in predictions] == [9, 9, 9, 9]
    probabilities = [prediction.most_likely.probability for prediction in predictions]
    assert probabilities == sorted(probabilities, reverse=True)
    assert probabilities[0] > 0.99
    assert predictions[0].most_likely.reward == -1.0


def test_the_effect_type_with_the_fewest_effects_is_chosen() -> None:
    bayes = learner()
    teach(bayes, "101", (3, 4))
    teach(bayes, "101", (7, 8))
    assert counter_of(ask(bayes, "101", counter=20)) == 21
    bayes = learner()
    teach(bayes, "101", (3, 50))
    teach(bayes, "101", (7, 50))
    assert counter_of(ask(bayes, "101", counter=20)) == 50


@settings(max_examples=60, deadline=None)
@given(st.text("01*", min_size=4, max_size=4), st.permutations([format(bits, "04b") for bits in range(16)]))
def test_predictions_are_right_once_all_conditions_were_seen(target: str, order: list[str]) -> None:
    bayes = learner(4)

    def holds(switches: str) -> bool:
        return all(sign in ("*", switch) for sign, switch in zip(target, switches, strict=True))

    for switches in order:
        teach(bayes, switches, (0, 1 if holds(switches) else 0))
    for switches in order:
        assert counter_of(ask(bayes, switches, counter=5)) == (6 if holds(switches) else 5)
    assert not bayes.has_disagreement
    assert not bayes.violations


def test_rules_are_the_simplest_that_agree_with_the_examples() -> None:
    bayes = learner(4)
    teach(bayes, "1101", (0, 1))
    teach(bayes, "0101", (0, 0))
    teach(bayes, "1001", (0, 1))
    teach(bayes, "1100", (5, 5))
    assert bayes.sentences() == ("PRESS: if machine.s0 and machine.s3: machine.counter += 1",)


def test_each_of_two_effects_has_a_rule() -> None:
    bayes = learner(2)
    for counter in (0, 5):
        teach(bayes, "10", (counter, counter + 1))
        teach(bayes, "01", (counter, counter - 1))
    assert [counter_of(ask(bayes, switches, counter=9)) for switches in ("10", "01")] == [10, 8]


def test_a_disjunction_is_learnt_as_two_conjunctions() -> None:
    bayes = learner(2)
    for _ in range(2):  # a single failure would count as an outlier
        for switches, change in [("10", 1), ("01", 1), ("00", 0), ("11", 0)]:
            teach(bayes, switches, (0, change))
    assert [counter_of(ask(bayes, switches)) for switches in ("10", "01", "00", "11")] == [1, 1, 0, 0]
    assert len(bayes.sentences()) == 2


def test_the_more_frequent_result_counts_under_one_condition() -> None:
    bayes = learner(2)
    for switches in ("10", "10", "11"):
        teach(bayes, switches, (0, 1))
    teach(bayes, "00", (0, 0))
    teach(bayes, "10", (0, 0))  # an actuator failure
    assert counter_of(ask(bayes, "10")) == 1
    assert "changed at one time and not at another" in bayes.violations[0]


def test_a_failure_that_no_conjunction_explains_counts_the_second_time() -> None:
    bayes = learner(3)
    for switches in ("100", "111"):
        teach(bayes, switches, (0, 1))
    teach(bayes, "000", (0, 0))
    teach(bayes, "101", (0, 0))
    assert counter_of(ask(bayes, "101")) == 1
    assert "counts only if it happens again" in bayes.violations[0]
    teach(bayes, "101", (0, 0))
    assert counter_of(ask(bayes, "101")) == 0
    assert counter_of(ask(bayes, "100")) == 1


def test_attributes_that_change_together_are_predicted_together() -> None:
    bayes = learner(2)
    teach(bayes, "10", (0, 1), lamp=(False, True))
    prediction = ask(bayes, "11")
    likely, other, *_ = prediction.outcomes
    assert likely.next_state == state_of(bayes.domain, "11", 1, True)
    assert other.next_state == state_of(bayes.domain, "11", 0, False)
    total = sum(outcome.probability for outcome in prediction.outcomes)
    assert abs(total - 1) < 1e-9
    assert likely.probability + other.probability > 0.99


def test_an_effect_out_of_bounds_is_ruled_out() -> None:
    bayes = learner(2)
    teach(bayes, "10", (99, 100))
    prediction = ask(bayes, "11", counter=100)
    assert counter_of(prediction) == 100


def test_assigning_the_value_that_an_attribute_has_is_no_example() -> None:
    bayes = learner(2)
    teach(bayes, "10", (0, 0), lamp=(False, True))
    teach(bayes, "11", (0, 0), lamp=(True, True))
    prediction = ask(bayes, "11")
    assert prediction.most_likely.next_state is not None
    assert prediction.most_likely.next_state["machine"].lamp
    assert prediction.disagreement == 0.0  # another example under this condition would teach nothing


def test_an_object_that_leaves_is_an_effect() -> None:
    bayes = BayesianLearner(machine_domain(2, removable=True))
    before = state_of(bayes.domain, "10")
    bayes.add_experience(Transition(before, PULL, before.without("machine"), 5.0, True))
    prediction = bayes.predict(before, PULL)
    assert prediction.most_likely.next_state is not None
    assert not prediction.most_likely.next_state.objects
    assert (prediction.most_likely.reward, prediction.most_likely.terminated) == (5.0, True)
    assert bayes.sentences() == ("PULL: if always: machine.exists := False",)


def test_predictions_do_not_change_the_learner() -> None:
    bayes = learner()
    teach(bayes, "101", (3, 4))
    revisions = dict(bayes.revisions)
    assert ask(bayes, "100") == ask(bayes, "100")
    assert bayes.revisions == revisions


def test_thirty_terms_are_learnt_from_a_few_dozen_examples() -> None:
    rng = np.random.default_rng(2)
    bayes = learner(30)
    base = rng.integers(0, 2, 30)
    base[[3, 17]] = 1, 0

    def holds(switches: str) -> bool:
        return switches[3] == "1" and switches[17] == "0"

    for _ in range(60):
        switches = base.copy()
        switches[rng.integers(0, 30, 3)] ^= 1
        text = "".join(map(str, switches))
        teach(bayes, text, (0, 1 if holds(text) else 0))
    assert bayes.sentences() == ("PRESS: if machine.s3 and not machine.s17: machine.counter += 1",)
    for _ in range(20):
        text = "".join(map(str, rng.integers(0, 2, 30)))
        assert counter_of(ask(bayes, text)) == holds(text)
