"""`effects_between` finds the effects that turn one value into another (paper, section 4)."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wherry.oomdp.attributes import EXISTS, boolean, enumeration, integer, real
from wherry.oomdp.effects import EFFECT_TYPES, Effect, apply_effects, effects_between, observed_values
from wherry.oomdp.objects import ObjectClass, State

PAIRS = st.one_of(
    *(
        st.tuples(st.just(attribute), values, values)
        for attribute, values in [
            (integer("n"), st.integers(-1000, 1000)),
            (real("r"), st.integers(-100_000, 100_000).map(lambda number: number / 100)),
            (boolean("b"), st.booleans()),
            (enumeration("e", "left", "right"), st.sampled_from(["left", "right"])),
        ]
    )
)
BALL = ObjectClass("Ball", (integer("x", 0, 5), boolean("lit")), removable=True)


@given(PAIRS)
def test_every_effect_turns_before_into_after(pair: tuple) -> None:
    attribute, before, after = pair
    effects = effects_between(attribute, before, after, EFFECT_TYPES)
    assert len({effect.type for effect in effects}) == len(effects)
    for effect in effects:
        again = EFFECT_TYPES[effect.type].apply(before, effect.argument)
        assert again == after
        assert type(again) is type(after)


@pytest.mark.parametrize(
    ("before", "after", "found"),
    [
        (2, 6, {"increment": 4, "assignment": 6, "multiplication": 3}),
        (6, 2, {"increment": -4, "assignment": 2, "multiplication": Fraction(1, 3)}),
        (0, 3, {"increment": 3, "assignment": 3}),
        (0, 0, {"increment": 0, "assignment": 0}),
        (3, 0, {"increment": -3, "assignment": 0}),  # ×0 has no inverse
    ],
)
def test_effect_types_of_a_change(before: int, after: int, found: dict[str, object]) -> None:
    effects = effects_between(integer("n"), before, after, EFFECT_TYPES)
    assert {effect.type: effect.argument for effect in effects} == found


@given(st.integers(-10_000, 10_000), st.integers(1, 1000), st.integers(1, 50))
def test_equal_steps_of_a_real_attribute_are_one_increment(start: int, step: int, times: int) -> None:
    """0.3 - 0.2 differs from 0.2 - 0.1 in floating point, but is the same effect."""
    values = [(start + index * step) / 100 for index in range(times + 1)]
    (increment,) = {effects_between(real("r"), one, other, EFFECT_TYPES)[0] for one, other in pairwise(values)}
    assert increment == Effect("increment", step / 100)
    assert EFFECT_TYPES["increment"].apply(values[0], increment.argument) == values[1]


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans(), st.booleans()), min_size=1, max_size=4), st.data())
def test_effects_between_two_states_turn_the_first_into_the_second(
    balls: list[tuple[int, bool, bool]], data: st.DataObject
) -> None:
    before = State(tuple(BALL(f"ball{index}", x=x, lit=lit) for index, (x, lit, _) in enumerate(balls)))
    later = [
        BALL(f"ball{index}", x=data.draw(st.integers(0, 5)), lit=data.draw(st.booleans()))
        for index, (_, _, stays) in enumerate(balls)
        if stays
    ]
    after = State(tuple(later))
    changes = []
    for index, item in enumerate(before.objects):
        for attribute, old, new in observed_values(item, after.get(item.name)):
            effects = effects_between(attribute, old, new, EFFECT_TYPES)
            changes.append((index, attribute.name, data.draw(st.sampled_from(effects))))
    assert apply_effects(before, changes, EFFECT_TYPES) == after


def test_boolean_has_no_increment() -> None:
    assert effects_between(boolean("b"), False, True, EFFECT_TYPES) == (Effect("assignment", True),)


def test_effects_change_and_remove_objects_within_bounds() -> None:
    state = State((BALL("a", x=1, lit=False), BALL("b", x=5, lit=False)))
    step = Effect("increment", 1)
    moved = apply_effects(state, [(0, "x", step), (0, "lit", Effect("assignment", True))], EFFECT_TYPES)
    assert moved == State((BALL("a", x=2, lit=True), BALL("b", x=5, lit=False)))
    removed = apply_effects(state, [(1, EXISTS, Effect("assignment", False)), (1, "x", step)], EFFECT_TYPES)
    assert removed == state.without("b")
    assert apply_effects(state, [(1, "x", step)], EFFECT_TYPES) is None  # 6 is out of the bounds of x
    assert apply_effects(state, [(0, EXISTS, Effect("assignment", True))], EFFECT_TYPES) == state


def test_only_the_existence_of_a_removed_object_is_observed() -> None:
    ball = BALL("a", x=1, lit=False)
    after_removal, after_move = (
        [(attribute.name, before, after) for attribute, before, after in observed_values(ball, later)]
        for later in (None, ball.replace(x=2))
    )
    assert after_removal == [(EXISTS, True, False)]
    assert after_move == [("x", 1, 2), ("lit", False, False), (EXISTS, True, True)]
