"""Terms T: the Boolean facts that conditions are conjunctions of (paper, section 4).

Terms are deictic (Marom and Rosman, NeurIPS 2018). If a class has several objects, a term about it, such as
``on(robot, box)``, is evaluated for each of them: for an attribute of a box it means "on(robot, this box)", for any
other attribute "on(robot, some box)". For a class with one object the two coincide.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from wherry.oomdp.attributes import Value
from wherry.oomdp.objects import Object, State
from wherry.oomdp.relations import Relation

Binding = Mapping[str, Object]
"""The object to which terms about a class refer, by class name; "some object" for classes without an entry."""


@dataclass(frozen=True)
class Term:
    """A term t.

    Attributes:
        name: Its name: ``touch_N(robot, wall)``.
        classes: Names of the classes that it is about.
        holds: Returns whether it holds in a state, given a binding.
    """

    name: str
    classes: tuple[str, ...]
    holds: Callable[[State, Binding], bool]


def related(relation: Relation, first: str, second: str) -> Term:
    """The term that a relation holds between objects of two classes.

    If both are the same class, as in ``on(block, block)``, the relation has to hold between "this" object and another.
    """

    def holds(state: State, binding: Binding) -> bool:
        # `any` would take twice as long, and this runs in every new state.
        for item in candidates(first, state, binding):  # noqa: SIM110
            if _relates(relation, item, second, state, binding):
                return True
        return False

    return Term(f"{relation.name}({first.lower()}, {second.lower()})", (first, second), holds)


def attribute_holds(class_name: str, attribute: str) -> Term:
    """The term that a Boolean attribute of a class is true."""
    return _some_object(class_name, f"{class_name.lower()}.{attribute}", lambda item: bool(getattr(item, attribute)))


def attribute_is(class_name: str, attribute: str, value: Value) -> Term:
    """The term that an attribute of a class has some value: ``agent.facing = north``."""
    name = f"{class_name.lower()}.{attribute} = {value}"
    return _some_object(class_name, name, lambda item: bool(getattr(item, attribute) == value))


def property_holds(class_name: str, name: str, holds: Callable[[Object], bool]) -> Term:
    """The term that a predicate is true of an object: ``warm(room)`` for rooms of 20 degrees or more."""
    return _some_object(class_name, f"{name}({class_name.lower()})", holds)


def _some_object(class_name: str, name: str, holds: Callable[[Object], bool]) -> Term:
    return Term(name, (class_name,), lambda state, binding: any(map(holds, candidates(class_name, state, binding))))


def candidates(class_name: str, state: State, binding: Binding) -> tuple[Object, ...]:
    """The objects to which a term about a class may refer: the bound one, or else all objects that can change."""
    return (binding[class_name],) if class_name in binding else state.of_class(class_name)


def _relates(relation: Relation, item: Object, second: str, state: State, binding: Binding) -> bool:
    """Whether the relation holds between an object and some object of a class, including static ones."""
    if second == item.object_class.name:
        return any(relation.holds(item, other) for other in state.of_class(second) if other is not item)
    for other in candidates(second, state, binding):
        if relation.holds(item, other):
            return True
    if second in binding:
        return False
    if relation.keys is not None:
        first_key, second_key = relation.keys
        return first_key(item) in state.scene.index(second, second_key)
    return any(relation.holds(item, other) for other in state.scene.of_class(second))
