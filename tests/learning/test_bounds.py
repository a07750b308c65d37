"""DOORMAX answers "I don't know" no more often than the theorem allows."""

from __future__ import annotations

from wherry.learning.bounds import UnknownAnswers, attribute_bound, unknown_answers_bound
from wherry.learning.doormax import Doormax
from wherry.oomdp.mdp import Transition
from wherry_testing.machine import PRESS, machine_domain, state_of


def test_the_bounds_of_the_theorem() -> None:
    assert unknown_answers_bound(7, 1) == 9
    assert unknown_answers_bound(7, 2) == 17
    assert attribute_bound(7, 1, 2) == 19


def test_the_worst_case_is_below_the_bound() -> None:
    """Every success removes one term, so that n merges follow the first success, each of them unpredicted."""
    size = 6
    learner = Doormax(machine_domain(size))
    answers = UnknownAnswers(learner)
    for flipped in range(size + 1):
        switches = "1" * flipped + "0" * (size - flipped)
        before = state_of(learner.domain, switches)
        transition = Transition(before, PRESS, before.replace("machine", counter=1), 0.0, False)
        answers.observe(transition)
        learner.add_experience(transition)
    assert answers.max_count == size + 1
    assert answers.max_count <= unknown_answers_bound(size, 1)


def test_failures_do_not_count() -> None:
    learner = Doormax(machine_domain(3))
    answers = UnknownAnswers(learner)
    for bits in range(8):
        before = state_of(learner.domain, format(bits, "03b"))
        transition = Transition(before, PRESS, before, 0.0, False)
        answers.observe(transition)
        learner.add_experience(transition)
    assert answers.max_count == 0
