"""Inferences from near misses are sound while the assumption holds, and revoked once it is contradicted."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from wherry.learning.doormax import Doormax
from wherry.learning.near_miss import NearMisses
from wherry.oomdp.conditions import Condition
from wherry_testing.machine import ask, counter_of, machine_domain, teach


def test_a_near_miss_proves_its_term_necessary() -> None:
    misses = NearMisses(3)
    misses.add("PRESS", 0b011, succeeded=True)
    misses.add("PRESS", 0b010, succeeded=False)  # term 0 was the only difference
    assert misses.fails("PRESS", 0b100)
    assert not misses.fails("PRESS", 0b111)


def test_nothing_is_inferred_before_the_first_success() -> None:
    misses = NearMisses(3)
    misses.add("PRESS", 0b010, succeeded=False)
    assert not misses.fails("PRESS", 0b000)


@settings(max_examples=200)
@given(
    st.text("01*", min_size=5, max_size=5).map(Condition.parse),
    st.lists(st.integers(0, 31), max_size=12),
    st.integers(0, 31),
)
def test_inferences_are_sound_under_the_assumption(target: Condition, tried: list[int], asked: int) -> None:
    misses = NearMisses(5)
    for terms in tried:
        misses.add("PRESS", terms, succeeded=target.covers_terms(terms))
    assert not (misses.fails("PRESS", asked) and target.covers_terms(asked))
    assert not misses.violations


def test_a_contradiction_revokes_all_inferences() -> None:
    doormax = Doormax(machine_domain(2), inference="near-miss")
    teach(doormax, "10", (0, 1))
    teach(doormax, "00", (0, 0))
    assert counter_of(ask(doormax, "01", counter=3)) == 3  # inferred: without s0 it fails
    teach(doormax, "01", (0, 1))  # contradicts the inference
    assert doormax.violations == ("PRESS: no single conjunction tells its successes from its failures",)
    assert counter_of(ask(doormax, "01")) == 1
