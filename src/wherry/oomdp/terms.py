"""Terms: the yes-or-no facts that conditions are made of, T (paper, section 4).

Terms are deictic. A term that speaks of a class which has several objects, such as ``on(robot, box)``, is evaluated
once for each of them: for an attribute of a box it means "on(robot, this box)", for an attribute of anything else it
means "on(robot, some box)". With one object of the class the two coincide (Marom and Rosman, NeurIPS 2018).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from wherry.oomdp.attributes import Value
from wherry.oomdp.objects import Object, State
from wherry.oomdp.relations import Relation

Bound = Mapping[str, Object]
"""The object that each class's name stands for at the moment; "some object" for a class that is not in it."""


@dataclass(frozen=True)
class Term:
    """A term t.

    Attributes:
        name: How it is printed: ``touch_N(robot, wall)``.
        classes: The classes that it speaks of.
        holds: Whether it holds in a state for the objects that are bound.
    """

    name: str
    classes: tuple[str, ...]
    holds: Callable[[State, Bound], bool]


def related(relation: Relation, first: str, second: str) -> Term:
    """The term that a relation holds between objects of two classes.

    Of one class, such as ``on(block, block)``, it holds between an object, "this" one, and some other.
    """

    def holds(state: State, bound: Bound) -> bool:
        for item in candidates(first, state, bound):  # noqa: SIM110  `any` takes twice the time, in every new state
            if _relates(relation, item, second, state, bound):
                return True
        return False

    return Term(f"{relation.name}({first.lower()}, {second.lower()})", (first, second), holds)


def attribute_holds(class_name: str, attribute: str) -> Term:
    """The term that a Boolean attribute of a class is true."""
    return _true_of(class_name, f"{class_name.lower()}.{attribute}", lambda item: bool(getattr(item, attribute)))


def attribute_is(class_name: str, attribute: str, value: Value) -> Term:
    """The term that an attribute of a class has a certain value: ``agent.facing = north``."""
    name = f"{class_name.lower()}.{attribute} = {value}"
    return _true_of(class_name, name, lambda item: bool(getattr(item, attribute) == value))


def property_holds(class_name: str, name: str, holds: Callable[[Object], bool]) -> Term:
    """The term that something is true of an object's attributes: ``warm(room)``, where it has 20 degrees or more."""
    return _true_of(class_name, f"{name}({class_name.lower()})", holds)


def _true_of(class_name: str, name: str, holds: Callable[[Object], bool]) -> Term:
    return Term(name, (class_name,), lambda state, bound: any(map(holds, candidates(class_name, state, bound))))


def candidates(class_name: str, state: State, bound: Bound) -> tuple[Object, ...]:
    """The objects that a class's name may stand for: the one that is bound, or all that can change."""
    return (bound[class_name],) if class_name in bound else state.of_class(class_name)


def _relates(relation: Relation, item: Object, second: str, state: State, bound: Bound) -> bool:
    """Whether the relation holds between an object and some candidate of a class, static ones included."""
    if second == item.object_class.name:
        return any(relation.holds(item, other) for other in state.of_class(second) if other is not item)
    for other in candidates(second, state, bound):
        if relation.holds(item, other):
            return True
    if second in bound:
        return False
    if relation.keys is not None:
        first_key, second_key = relation.keys
        return first_key(item) in state.scene.index(second, second_key)
    return any(relation.holds(item, other) for other in state.scene.of_class(second))
