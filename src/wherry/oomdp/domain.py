"""Domains: the classes, terms and actions that describe a kind of world (paper, sections 3 and 4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

from wherry.oomdp.conditions import Condition
from wherry.oomdp.objects import Object, ObjectClass, State
from wherry.oomdp.terms import Term


@dataclass(frozen=True, slots=True, order=True)
class Action:
    """A ground action a.

    Attributes:
        name: Its name.
        arguments: Names of the objects that it acts on; empty for an action without parameters.
    """

    name: str
    arguments: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.arguments)})" if self.arguments else self.name


@dataclass(frozen=True)
class Domain:
    """The description of a kind of world.

    Attributes:
        name: Its name.
        classes: The classes of objects.
        terms: T, in the order in which conditions are printed.
        actions: The classes of each action's parameters, by the action's name; () for an action without parameters.

    Raises:
        ValueError: A term or an action refers to an unknown class, or an action has two parameters of one class.
    """

    name: str
    classes: tuple[ObjectClass, ...]
    terms: tuple[Term, ...]
    actions: Mapping[str, tuple[str, ...]]

    def __post_init__(self) -> None:
        known = set(self.classes_by_name)
        for term in self.terms:
            if unknown := set(term.classes) - known:
                raise ValueError(f"term {term.name} refers to unknown classes: {', '.join(sorted(unknown))}")
        for action, parameters in self.actions.items():
            if unknown := set(parameters) - known:
                raise ValueError(f"action {action} has parameters of unknown classes: {', '.join(sorted(unknown))}")
            if len(set(parameters)) < len(parameters):
                raise ValueError(f"action {action} has two parameters of one class, which terms cannot distinguish")

    @cached_property
    def classes_by_name(self) -> Mapping[str, ObjectClass]:
        """The classes by name."""
        return {item.name: item for item in self.classes}

    @cached_property
    def has_parameters(self) -> bool:
        """Whether some action has parameters."""
        return any(self.actions.values())

    @cached_property
    def term_names(self) -> tuple[str, ...]:
        """The names of the terms, one for each symbol of a condition.

        Where actions have parameters, an additional last term holds if "this" object is an argument of the action.
        """
        names = tuple(term.name for term in self.terms)
        return (*names, "this is an argument") if self.has_parameters else names

    @cached_property
    def size(self) -> int:
        """n, the number of terms."""
        return len(self.term_names)

    @cached_property
    def _actions_without_parameters(self) -> tuple[Action, ...]:
        return tuple(Action(name) for name in self.actions)

    @cached_property
    def _terms_by_class(self) -> Mapping[str, tuple[tuple[int, Term], ...]]:
        """The terms about each class, with their indexes."""
        return {
            item.name: tuple((index, term) for index, term in enumerate(self.terms) if item.name in term.classes)
            for item in self.classes
        }

    def ground_actions(self, state: State) -> tuple[Action, ...]:
        """All ground actions in a state: every action with every combination of arguments."""
        if not self.has_parameters:
            return self._actions_without_parameters
        return tuple(
            Action(name, tuple(item.name for item in arguments))
            for name, parameters in self.actions.items()
            for arguments in product(*(state.of_class(parameter) for parameter in parameters))
        )

    def cond(self, state: State, this: Object | None = None, action: Action | None = None) -> Condition:
        """The condition of a state: which terms hold in it (section 4).

        Args:
            state: s.
            this: The object to which terms about its class refer; None for the condition of the state as a whole, in
                which a term holds if it holds for some object of the class.
            action: An action; terms about the classes of its arguments refer to these arguments.
        """
        conditions = self.conditions(state, action)
        return Condition.of(self.size, conditions[0 if this is None else 1 + state.objects.index(this)])

    def conditions(self, state: State, action: Action | None = None) -> tuple[int, ...]:
        """The conditions of the state as a whole and then of each object, as bits (see `cond`).

        They are computed once and cached with the state.
        """
        arguments = () if action is None else action.arguments
        return state.cached_conditions(arguments, lambda: self._conditions(state, arguments))

    def _conditions(self, state: State, arguments: tuple[str, ...]) -> tuple[int, ...]:
        targets = tuple(state[name] for name in arguments)
        binding = {target.object_class.name: target for target in targets}
        common = 0
        for index, term in enumerate(self.terms):
            common |= term.holds(state, binding) << index
        conditions = [common]
        for item in state.objects:
            name = item.object_class.name
            own = common
            if len(state.of_class(name)) > 1:
                for index, term in self._terms_by_class[name]:
                    own = own & ~(1 << index) | term.holds(state, {**binding, name: item}) << index
            conditions.append(own | (item in targets) << len(self.terms))
        return tuple(conditions)
