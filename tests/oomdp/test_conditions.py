"""The algebra of conditions: ⊕ is the join of a semilattice, whose order is `covers` (paper, section 4)."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.oomdp.conditions import Condition

SIZE = 6
conditions = st.text("01*", min_size=SIZE, max_size=SIZE).map(Condition.parse)


@pytest.mark.parametrize(
    ("first", "second", "merged"),
    [
        ("0", "0", "0"),
        ("1", "1", "1"),
        ("0", "1", "*"),
        ("1", "0", "*"),
        ("0", "*", "*"),
        ("1", "*", "*"),
        ("*", "*", "*"),
    ],
)
def test_merging_symbols_follows_the_papers_table(first: str, second: str, merged: str) -> None:
    assert str(Condition.parse(first).merge(Condition.parse(second))) == merged


@pytest.mark.parametrize("first", "01*")
@pytest.mark.parametrize("second", "01*")
def test_symbol_covers_itself_and_a_star_covers_every_symbol(first: str, second: str) -> None:
    assert Condition.parse(first).covers(Condition.parse(second)) == (first in ("*", second))


@given(conditions, conditions, conditions)
def test_merging_is_commutative_associative_and_idempotent(a: Condition, b: Condition, c: Condition) -> None:
    assert a.merge(b) == b.merge(a)
    assert a.merge(b).merge(c) == a.merge(b.merge(c))
    assert a.merge(a) == a


@given(conditions, conditions, conditions)
def test_covers_is_a_partial_order(a: Condition, b: Condition, c: Condition) -> None:
    assert a.covers(a)
    assert not (a.covers(b) and b.covers(a)) or a == b
    assert not (a.covers(b) and b.covers(c)) or a.covers(c)


@given(conditions, conditions, conditions)
def test_merged_condition_is_the_most_specific_that_covers_both(a: Condition, b: Condition, c: Condition) -> None:
    merged = a.merge(b)
    assert merged.covers(a)
    assert merged.covers(b)
    assert not (c.covers(a) and c.covers(b)) or c.covers(merged)


@given(conditions)
def test_parsing_inverts_printing(condition: Condition) -> None:
    assert Condition.parse(str(condition)) == condition
    assert condition.literal_count == SIZE - str(condition).count("*")


@given(conditions, st.integers(0, 2**SIZE - 1))
def test_covering_terms_equals_covering_their_condition(condition: Condition, terms: int) -> None:
    assert condition.covers_terms(terms) == condition.covers(Condition.of(SIZE, terms))


def test_description_lists_literals() -> None:
    names = ["dark", "cold", "wet"]
    assert Condition.parse("1*0").describe(names) == "dark and not wet"
    assert Condition.parse("***").describe(names) == "always"


def test_unknown_symbol_is_refused() -> None:
    with pytest.raises(ValueError, match="0, 1 and"):
        Condition.parse("1?0")
