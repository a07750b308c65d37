"""Counting hypotheses gives what listing them all gives."""

from __future__ import annotations

from itertools import product

from hypothesis import given, settings
from hypothesis import strategies as st

from wherry.learning.concepts import Concept, condition_of, largest, literals_of, union_weight
from wherry.oomdp.conditions import Condition

SIZE, FACTOR = 4, 0.3
EVERYTHING = [Condition.parse("".join(signs)) for signs in product("01*", repeat=SIZE)]
terms = st.integers(0, 2**SIZE - 1)
targets = st.sampled_from(EVERYTHING)


def survivors(positives: list[int], negatives: list[int]) -> list[Condition]:
    return [
        hypothesis
        for hypothesis in EVERYTHING
        if all(hypothesis.covers_terms(example) for example in positives)
        and not any(hypothesis.covers_terms(example) for example in negatives)
    ]


def weight(hypotheses: list[Condition]) -> float:
    return sum(FACTOR**hypothesis.literal_count for hypothesis in hypotheses)


@settings(max_examples=300, deadline=None)
@given(targets, st.lists(terms, max_size=10), terms)
def test_probabilities_are_those_of_all_hypotheses(target: Condition, examples: list[int], asked: int) -> None:
    positives = [example for example in examples if target.covers_terms(example)]
    negatives = [example for example in examples if not target.covers_terms(example)]
    concept = Concept.of(SIZE, FACTOR, positives, negatives)
    alive = survivors(positives, negatives)
    expected = weight([hypothesis for hypothesis in alive if hypothesis.covers_terms(asked)]) / weight(alive)
    assert concept.consistent
    assert abs(concept.probability(asked) - expected) < 1e-9
    assert concept.covers(asked) == (bool(positives) and all(hypothesis.covers_terms(asked) for hypothesis in alive))


@settings(max_examples=200, deadline=None)
@given(targets, st.lists(terms, min_size=1, max_size=10))
def test_the_simplest_hypotheses_are_the_shortest_that_survive(target: Condition, examples: list[int]) -> None:
    positives = [example for example in examples if target.covers_terms(example)]
    negatives = [example for example in examples if not target.covers_terms(example)]
    concept = Concept.of(SIZE, FACTOR, positives, negatives)
    found = {str(condition_of(literals, SIZE)) for literals in concept.simplest}
    alive = survivors(positives, negatives)
    if not positives:
        assert not found
        return
    some = [hypothesis for hypothesis in alive if hypothesis.literal_count] or alive
    fewest = min(hypothesis.literal_count for hypothesis in some)
    assert found == {str(hypothesis) for hypothesis in some if hypothesis.literal_count == fewest}


@given(st.lists(terms, min_size=1, max_size=6), st.lists(terms, min_size=1, max_size=6))
def test_contradictions_are_noticed(positives: list[int], negatives: list[int]) -> None:
    concept = Concept.of(SIZE, FACTOR, positives, negatives)
    assert concept.consistent == bool(survivors(positives, negatives))


@given(st.sets(st.integers(0, 2**8 - 1), max_size=6))
def test_union_weight_counts_every_part_once(parts: set[int]) -> None:
    every = [literals for literals in range(2**8) if any(not literals & ~part for part in parts)]
    assert abs(union_weight(largest(parts), FACTOR) - sum(FACTOR ** literals.bit_count() for literals in every)) < 1e-6


def test_literals() -> None:
    assert literals_of(0b0101, 4) == 0b1010_0101
    assert str(condition_of(0b1000_0001, 4)) == "1**0"


def test_doubt_is_greatest_where_explanations_are_split() -> None:
    concept = Concept.of(3, 0.1, [0b011], [0b000])  # terms 0 and 1 held once, and did not when it failed
    assert {str(condition_of(literals, 3)) for literals in concept.simplest} == {"1**", "*1*"}
    assert concept.disagreement(0b001) == concept.disagreement(0b010) == 1.0
    assert concept.disagreement(0b111) == concept.disagreement(0b000) == 0.0


def test_what_never_failed_is_in_doubt_where_anything_differs() -> None:
    concept = Concept.of(3, 0.1, [0b011], [])
    assert len(concept.simplest) == 3
    assert concept.disagreement(0b011) == 0.0
    assert concept.disagreement(0b010) > 0.0
    assert Concept.of(2, 0.1, [0b00, 0b11], []).simplest == (0,)


def test_forty_terms_are_no_trouble() -> None:
    size, needed = 40, 0b1001
    near = [needed ^ 1 << at for at in range(size)]  # one term differs
    positives = [example for example in near if example & needed == needed]
    negatives = [example for example in near if example & needed != needed]
    concept = Concept.of(size, 0.1, positives[:20], negatives)
    assert [str(condition_of(literals, size)) for literals in concept.simplest] == ["1**1" + "*" * 36]
    assert concept.probability(needed | 0b110) > 0.9
    assert concept.probability(0b0001) == 0.0
    assert Concept.of(size, 0.1, [], near).probability(near[0]) == 0.0
    assert 0.0 < Concept.of(size, 0.1, [], near[:10]).probability(near[-1]) < 1.0
