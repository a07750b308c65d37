"""Counting hypotheses gives the same probabilities as listing them."""

from __future__ import annotations

from itertools import product

from hypothesis import given, settings
from hypothesis import strategies as st

from wherry.learning.conjunctions import ConjunctionPosterior, condition_of, literals_of, maximal_sets, union_weight
from wherry.oomdp.conditions import Condition

SIZE, LITERAL_ODDS = 4, 0.3
ALL_HYPOTHESES = [Condition.parse("".join(signs)) for signs in product("01*", repeat=SIZE)]
terms = st.integers(0, 2**SIZE - 1)
targets = st.sampled_from(ALL_HYPOTHESES)


def remaining(positives: list[int], negatives: list[int]) -> list[Condition]:
    return [
        hypothesis
        for hypothesis in ALL_HYPOTHESES
        if all(hypothesis.covers_terms(example) for example in positives)
        and not any(hypothesis.covers_terms(example) for example in negatives)
    ]


def weight(hypotheses: list[Condition]) -> float:
    return sum(LITERAL_ODDS**hypothesis.literal_count for hypothesis in hypotheses)


@settings(max_examples=300, deadline=None)
@given(targets, st.lists(terms, max_size=10), terms)
def test_probabilities_equal_those_of_listed_hypotheses(target: Condition, examples: list[int], asked: int) -> None:
    positives = [example for example in examples if target.covers_terms(example)]
    negatives = [example for example in examples if not target.covers_terms(example)]
    conjunction = ConjunctionPosterior.of(SIZE, LITERAL_ODDS, positives, negatives)
    hypotheses = remaining(positives, negatives)
    expected = weight([h for h in hypotheses if h.covers_terms(asked)]) / weight(hypotheses)
    assert conjunction.is_consistent
    assert abs(conjunction.probability(asked) - expected) < 1e-9
    assert conjunction.covers(asked) == (bool(positives) and all(h.covers_terms(asked) for h in hypotheses))


@settings(max_examples=200, deadline=None)
@given(targets, st.lists(terms, min_size=1, max_size=10))
def test_the_simplest_hypotheses_are_the_shortest_remaining_ones(target: Condition, examples: list[int]) -> None:
    positives = [example for example in examples if target.covers_terms(example)]
    negatives = [example for example in examples if not target.covers_terms(example)]
    conjunction = ConjunctionPosterior.of(SIZE, LITERAL_ODDS, positives, negatives)
    found = {str(condition_of(literals, SIZE)) for literals in conjunction.simplest}
    hypotheses = remaining(positives, negatives)
    if not positives:
        assert not found
        return
    candidates = [hypothesis for hypothesis in hypotheses if hypothesis.literal_count] or hypotheses
    fewest = min(hypothesis.literal_count for hypothesis in candidates)
    assert found == {str(hypothesis) for hypothesis in candidates if hypothesis.literal_count == fewest}


@given(st.lists(terms, min_size=1, max_size=6), st.lists(terms, min_size=1, max_size=6))
def test_contradictory_examples_are_inconsistent(positives: list[int], negatives: list[int]) -> None:
    conjunction = ConjunctionPosterior.of(SIZE, LITERAL_ODDS, positives, negatives)
    assert conjunction.is_consistent == bool(remaining(positives, negatives))


@given(st.sets(st.integers(0, 2**8 - 1), max_size=6))
def test_union_weight_counts_every_subset_once(parts: set[int]) -> None:
    subsets = [literals for literals in range(2**8) if any(not literals & ~part for part in parts)]
    expected = sum(LITERAL_ODDS ** literals.bit_count() for literals in subsets)
    assert abs(union_weight(maximal_sets(parts), LITERAL_ODDS) - expected) < 1e-6


def test_terms_convert_to_literals_and_conditions() -> None:
    assert literals_of(0b0101, 4) == 0b1010_0101
    assert str(condition_of(0b1000_0001, 4)) == "1**0"


def test_disagreement_is_largest_where_half_of_the_simplest_hypotheses_cover_a_condition() -> None:
    conjunction = ConjunctionPosterior.of(3, 0.1, [0b011], [0b000])
    assert {str(condition_of(literals, 3)) for literals in conjunction.simplest} == {"1**", "*1*"}
    assert conjunction.disagreement(0b001) == conjunction.disagreement(0b010) == 1.0
    assert conjunction.disagreement(0b111) == conjunction.disagreement(0b000) == 0.0


def test_simplest_hypotheses_disagree_where_a_term_differs_from_the_only_positive_example() -> None:
    conjunction = ConjunctionPosterior.of(3, 0.1, [0b011], [])
    assert len(conjunction.simplest) == 3
    assert conjunction.disagreement(0b011) == 0.0
    assert conjunction.disagreement(0b010) > 0.0
    assert ConjunctionPosterior.of(2, 0.1, [0b00, 0b11], []).simplest == (0,)


def test_forty_terms_are_counted_exactly() -> None:
    size, needed = 40, 0b1001
    near = [needed ^ 1 << at for at in range(size)]  # one term differs in each
    positives = [example for example in near if example & needed == needed]
    negatives = [example for example in near if example & needed != needed]
    conjunction = ConjunctionPosterior.of(size, 0.1, positives[:20], negatives)
    assert [str(condition_of(literals, size)) for literals in conjunction.simplest] == ["1**1" + "*" * 36]
    assert conjunction.probability(needed | 0b110) > 0.9
    assert conjunction.probability(0b0001) == 0.0
    assert ConjunctionPosterior.of(size, 0.1, [], near).probability(near[0]) == 0.0
    assert 0.0 < ConjunctionPosterior.of(size, 0.1, [], near[:10]).probability(near[-1]) < 1.0
