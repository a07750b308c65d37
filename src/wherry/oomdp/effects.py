"""Effects: operations on attributes (paper, section 4).

`EFFECT_TYPES` lists the operations. A domain that needs another kind of change, such as addition modulo n, adds an
`EffectType` to a copy of it and passes the copy to the learner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from wherry.oomdp.attributes import EXISTS, Attribute, AttributeKind, Value
from wherry.oomdp.objects import Object, State

Argument = Value | Fraction
"""The argument of an effect: the number that it adds or multiplies by, or the value that it assigns."""


@dataclass(frozen=True)
class EffectType:
    """A kind of operation on an attribute's value; invertible, as assumption A3 demands.

    Attributes:
        name: Name of the operation.
        kinds: The kinds of attributes that it applies to.
        between: Returns the argument with which the operation turns the first value into the second; None if there is
            none, or more than one.
        apply: Returns the new value, given a value and an argument.
        describe: Returns the effect as text, given the attribute's name and the argument.
    """

    name: str
    kinds: frozenset[AttributeKind]
    between: Callable[[Any, Any], Argument | None]
    apply: Callable[[Any, Any], Value]
    describe: Callable[[str, Any], str]


class Effect(NamedTuple):
    """One operation: ``x += 1``, ``in_bot := True``.

    Attributes:
        type: Name of the effect type.
        argument: Its argument.
    """

    type: str
    argument: Argument


NUMERIC_KINDS = frozenset({AttributeKind.INTEGER, AttributeKind.REAL})

SIGNIFICANT_DIGITS = 12  # decimal digits kept of real numbers, so that 0.3 − 0.2 and 0.2 − 0.1 are equal increments


def round_significant(value: float, scale: float, digits: int = SIGNIFICANT_DIGITS) -> float:
    """A real number, rounded to the digits that are significant for numbers of some scale; integers stay exact."""
    if isinstance(value, int) or not scale or not math.isfinite(scale):
        return value
    return round(value, digits - 1 - math.floor(math.log10(abs(scale))))


def _difference(before: Value, after: Value) -> Argument | None:
    """After − before; for a value that is not a number 0 if it is unchanged, and otherwise None."""
    if before == after:
        return 0
    if isinstance(before, bool | str) or isinstance(after, bool | str):
        return None
    return round_significant(after - before, max(abs(after), abs(before)))


def _sum(value: Any, step: Any) -> Value:
    """Value + step; step 0 also applies to values that are not numbers."""
    return round_significant(value + step, max(abs(value), abs(step))) if step else value


def _quotient(before: float, after: float) -> Argument | None:
    """After / before; None where it is not unique (0 → 0), does not exist (0 → x) or has no inverse (x → 0)."""
    if before == 0 or after == 0:
        return None
    if isinstance(before, float) or isinstance(after, float):
        # Two more digits make the product exact in all significant digits.
        return round_significant(after / before, after / before, SIGNIFICANT_DIGITS + 2)
    factor = Fraction(after, before)
    return factor.numerator if factor.denominator == 1 else factor


def _product(value: float, factor: float | Fraction) -> Value:
    """Value · factor; the product of an integer stays an integer where that is exact."""
    product = Fraction(value) * Fraction(factor)
    if product.denominator == 1 and isinstance(value, int):
        return product.numerator
    return round_significant(float(product), float(product))


EFFECT_TYPES: Mapping[str, EffectType] = {
    "increment": EffectType(
        "increment",
        frozenset(AttributeKind),
        between=_difference,
        apply=_sum,
        describe=lambda name, step: f"{name} += {step}" if step >= 0 else f"{name} -= {-step}",
    ),
    "assignment": EffectType(
        "assignment",
        frozenset(AttributeKind),
        between=lambda before, after: after,
        apply=lambda value, new: new,
        describe=lambda name, new: f"{name} := {new}",
    ),
    "multiplication": EffectType(
        "multiplication",
        NUMERIC_KINDS,
        between=_quotient,
        apply=_product,
        describe=lambda name, factor: f"{name} *= {factor}",
    ),
}

PAPER_TYPES: Mapping[str, EffectType] = {name: EFFECT_TYPES[name] for name in ("increment", "assignment")}
"""The effect types that the paper's domains need."""


def effects_between(
    attribute: Attribute, before: Value, after: Value, types: Mapping[str, EffectType]
) -> tuple[Effect, ...]:
    """eff_att(s, s'): one effect of each type that turns an attribute's value in s into its value in s' (section 4)."""
    effects = []
    for name, effect_type in types.items():
        if attribute.kind in effect_type.kinds:
            argument = effect_type.between(before, after)
            if argument is not None:
                effects.append(Effect(name, argument))
    return tuple(effects)


def value_of(item: Object, attribute: str) -> Value:
    """An object's value of an attribute; ``exists`` is true of every object."""
    if attribute == EXISTS:
        return True
    value: Value = item.values[item.object_class.attribute_indexes[attribute]]
    return value


def observed_values(item: Object, later: Object | None) -> Iterator[tuple[Attribute, Value, Value]]:
    """Yield the attributes of an object whose change in a step is observed, with their values before and after.

    For a removed object only the change of its existence is observed.

    Args:
        item: The object in s.
        later: The same object in s'; None if it was removed.
    """
    for attribute in item.object_class.changeable:
        if attribute.name == EXISTS:
            yield attribute, True, later is not None
        elif later is not None:
            yield attribute, value_of(item, attribute.name), value_of(later, attribute.name)


def apply_effects(
    state: State, changes: Iterable[tuple[int, str, Effect]], types: Mapping[str, EffectType]
) -> State | None:
    """The next state s' after some effects; None where one of them violates the bounds of its attribute.

    Args:
        state: s.
        changes: The effects, each with its object's index in ``state.objects`` and its attribute's name.
        types: The effect types by name.
    """
    objects: list[Object | None] = list(state.objects)
    for index, attribute, effect in changes:
        item = objects[index]
        if item is None:
            continue  # an earlier effect has removed the object
        before = value_of(item, attribute)
        after = types[effect.type].apply(before, effect.argument)
        if attribute == EXISTS and not after:
            objects[index] = None
        elif after != before:
            if not item.object_class.attribute(attribute).admits(after):
                return None
            objects[index] = item.with_value(attribute, after)
    return state.with_ordered_objects(item for item in objects if item is not None)
