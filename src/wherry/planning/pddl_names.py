"""Names and texts of a PDDL task: identifiers for objects' values and changes, operators, and the two files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from wherry.oomdp.objects import Object
from wherry.planning.pddl_operators import StepEffect


def identifier(text: str) -> str:
    """Turn a text into a PDDL identifier."""
    return re.sub(r"\W+", "_", text.lower().replace("-", "m")).strip("_")


def value_name(name: str, item: Object | None) -> str:
    """The PDDL object that stands for an object's values: ``taxi_x2_y3``; None is a removed object."""
    if item is None:
        return identifier(f"{name}_gone")
    parts = [name]
    for attribute, value in zip(item.object_class.attributes, item.values, strict=True):
        if isinstance(value, bool):
            parts.append(attribute.name if value else f"not_{attribute.name}")
        else:
            parts.append(f"{attribute.name}{value}")
    return identifier("_".join(parts))


def change_name(item: Object, after: Object | None) -> str:
    """A name for the change of an object in one step: ``y_plus_1``."""
    if after is None:
        return "leaves"
    changes = []
    for attribute, old, new in zip(item.object_class.attributes, item.values, after.values, strict=True):
        if old == new:
            continue
        if isinstance(old, bool | str) or not isinstance(new, int | float):
            changes.append(f"{attribute.name}_becomes_{new}")
        else:
            changes.append(f"{attribute.name}_{'plus' if new > old else 'minus'}_{abs(new - old)}")
    return "_and_".join(changes)


def operator_text(name: str, objects: Sequence[str], preconditions: Sequence[str], effect: StepEffect) -> str:
    """An operator of the domain file.

    Args:
        name: The operator's name.
        objects: Names of the objects whose values are parameters.
        preconditions: Literals besides the objects' current values.
        effect: What the operator changes.
    """
    words = {item: identifier(item) for item in objects}
    changed = dict(effect.changes)
    parameters = [f"?{words[item]} - {words[item]}" for item in objects]
    parameters += [f"?{words[item]}_after - {words[item]}" for item in changed]
    conditions = [f"(is_{words[item]} ?{words[item]})" for item in objects] + list(preconditions)
    effects = []
    for item, change in changed.items():
        word = words[item]
        conditions.append(f"({identifier(f'{item}_{change}')} ?{word} ?{word}_after)")
        effects += [f"(not (is_{word} ?{word}))", f"(is_{word} ?{word}_after)"]
    effects += ["(done)"] if effect.reaches_goal else []
    return (
        f"  (:action {name}\n    :parameters ({' '.join(parameters)})\n"
        f"    :precondition (and {' '.join(conditions)})\n    :effect (and {' '.join(effects)}))\n"
    )


def domain_text(
    name: str, types: Sequence[str], predicates: Mapping[str, Sequence[str]], operators: Sequence[str]
) -> str:
    """The domain file.

    Args:
        name: Name of the domain.
        types: The PDDL types, one for each object of the OO-MDP.
        predicates: The types of every predicate's parameters.
        operators: The operators' texts.
    """
    declared = [
        f"    ({' '.join([predicate, *(f'?p{index} - {kind}' for index, kind in enumerate(kinds))])})"
        for predicate, kinds in predicates.items()
    ]
    lines = "\n".join(["    (done)", *declared])
    return (
        f"(define (domain {identifier(name)})\n  (:requirements :strips :typing :negative-preconditions)\n"
        f"  (:types {' '.join(types)})\n  (:predicates\n{lines})\n{''.join(operators)})\n"
    )


def problem_text(name: str, values: Mapping[str, Sequence[str]], facts: Sequence[str]) -> str:
    """The problem file.

    Args:
        name: Name of the domain.
        values: The PDDL objects of every type.
        facts: The literals that hold in the initial state.
    """
    objects = "\n".join(f"    {' '.join(found)} - {kind}" for kind, found in values.items())
    initially = "\n".join(f"    {fact}" for fact in facts)
    return (
        f"(define (problem {identifier(name)}_1)\n  (:domain {identifier(name)})\n  (:objects\n{objects})\n"
        f"  (:init\n{initially})\n  (:goal (done)))\n"
    )
