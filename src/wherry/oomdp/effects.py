"""Effects: one operation on one attribute (paper, section 4).

Which operations there are is a visible dictionary, `EFFECT_TYPES`; a domain that needs another kind of change, say
"modulo", adds an `EffectType` to its own copy and hands that to the learner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from wherry.oomdp.objects import EXISTS, Attribute, Kind, Object, State, Value

Argument = Value | Fraction
"""What an effect adds, assigns or multiplies by."""


@dataclass(frozen=True)
class EffectType:
    """A kind of operation on an attribute's value; invertible, as assumption A3 asks.

    Attributes:
        name: What it is called.
        kinds: The kinds of attributes that it applies to.
        between: The argument with which it turns the first value into the second; None where there is none or more
            than one.
        apply: The value that it makes of a value with an argument.
        words: How it is printed, of the attribute's name and the argument.
    """

    name: str
    kinds: frozenset[Kind]
    between: Callable[[Any, Any], Argument | None]
    apply: Callable[[Any, Any], Value]
    words: Callable[[str, Any], str]


class Effect(NamedTuple):
    """One operation: ``x += 1``, ``in_bot := True``.

    Attributes:
        type: The name of its effect type.
        argument: What it adds, assigns or multiplies by.
    """

    type: str
    argument: Argument


NUMBERS = frozenset({Kind.INTEGER, Kind.REAL})


DIGITS = 12
"""How many digits of real numbers count: 0.3 − 0.2 and 0.2 − 0.1 are the same increment."""


def rounded(value: float, scale: float, digits: int = DIGITS) -> float:
    """A real number, to as many digits as count for numbers of some size; a whole one as it is."""
    if isinstance(value, int) or not scale or not math.isfinite(scale):
        return value
    return round(value, digits - 1 - math.floor(math.log10(abs(scale))))


def _difference(before: Value, after: Value) -> Argument | None:
    """After − before. What is no number has only the increment of nothing: +0 where it stays as it is."""
    if before == after:
        return 0
    if isinstance(before, bool | str) or isinstance(after, bool | str):
        return None
    return rounded(after - before, max(abs(after), abs(before)))


def _sum(value: Any, step: Any) -> Value:
    """Value + step; +0 leaves what is no number as it is."""
    return rounded(value + step, max(abs(value), abs(step))) if step else value


def _factor(before: float, after: float) -> Argument | None:
    """The quotient; 0 → 0 has many answers, 0 → x none, and x → 0 could not be undone."""
    if before == 0 or after == 0:
        return None
    if isinstance(before, float) or isinstance(after, float):
        return rounded(after / before, after / before, DIGITS + 2)  # so that the product is right in all its digits
    factor = Fraction(after, before)
    return factor.numerator if factor.denominator == 1 else factor


def _product(value: float, factor: float | Fraction) -> Value:
    """The product; a whole number stays one where that is exact."""
    product = Fraction(value) * Fraction(factor)
    if product.denominator == 1 and isinstance(value, int):
        return product.numerator
    return rounded(float(product), float(product))


EFFECT_TYPES: Mapping[str, EffectType] = {
    "increment": EffectType(
        "increment",
        frozenset(Kind),
        between=_difference,
        apply=_sum,
        words=lambda name, step: f"{name} += {step}" if step >= 0 else f"{name} -= {-step}",
    ),
    "assignment": EffectType(
        "assignment",
        frozenset(Kind),
        between=lambda before, after: after,
        apply=lambda value, new: new,
        words=lambda name, new: f"{name} := {new}",
    ),
    "multiplication": EffectType(
        "multiplication",
        NUMBERS,
        between=_factor,
        apply=_product,
        words=lambda name, factor: f"{name} *= {factor}",
    ),
}

PAPER_TYPES: Mapping[str, EffectType] = {name: EFFECT_TYPES[name] for name in ("increment", "assignment")}
"""The effect types that the paper's domains need."""


def eff_att(attribute: Attribute, before: Value, after: Value, types: Mapping[str, EffectType]) -> tuple[Effect, ...]:
    """One effect of each type that turns an attribute's value in s into its value in s' (section 4)."""
    effects = []
    for name, effect_type in types.items():
        if attribute.kind in effect_type.kinds:
            argument = effect_type.between(before, after)
            if argument is not None:
                effects.append(Effect(name, argument))
    return tuple(effects)


def value_of(item: Object, attribute: str) -> Value:
    """An object's value of an attribute; an object that is there exists."""
    if attribute == EXISTS:
        return True
    value: Value = item.values[item.object_class.positions[attribute]]
    return value


def observed(item: Object, later: Object | None) -> Iterable[tuple[Attribute, Value, Value]]:
    """What was seen of an object in one step: its attributes with their values before and after.

    Of an object that has left, only that is seen.

    Args:
        item: The object in s.
        later: The same object in s', or None where it has left.
    """
    for attribute in item.object_class.changeable:
        if attribute.name == EXISTS:
            yield attribute, True, later is not None
        elif later is not None:
            yield attribute, value_of(item, attribute.name), value_of(later, attribute.name)


def apply(state: State, changes: Iterable[tuple[int, str, Effect]], types: Mapping[str, EffectType]) -> State | None:
    """The state s' that effects make of s; None where one of them leads outside its attribute's bounds.

    Args:
        state: s.
        changes: The effects, each with its object's position in ``state.objects`` and its attribute's name.
        types: The effect types.
    """
    objects: list[Object | None] = list(state.objects)
    for position, attribute, effect in changes:
        item = objects[position]
        if item is None:
            continue  # it has left; nothing else can be seen of it
        before = value_of(item, attribute)
        after = types[effect.type].apply(before, effect.argument)
        if attribute == EXISTS and not after:
            objects[position] = None
        elif after != before:
            if not item.object_class.attribute(attribute).admits(after):
                return None
            objects[position] = item.changed(attribute, after)
    return state.changed(item for item in objects if item is not None)
