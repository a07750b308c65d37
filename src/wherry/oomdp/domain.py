"""A domain: the classes, terms and actions that a kind of world is described with (paper, sections 3 and 4)."""

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
    """An action a, with the objects that it is done to where the domain's action has parameters.

    Attributes:
        name: What it is called.
        arguments: Names of the objects that it is done to.
    """

    name: str
    arguments: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.arguments)})" if self.arguments else self.name


@dataclass(frozen=True)
class Domain:
    """What a kind of world consists of.

    Attributes:
        name: What it is called.
        classes: Its classes of objects.
        terms: T, in the order in which conditions are printed.
        actions: The classes of each action's parameters, by the action's name; () for an action without any.

    Raises:
        ValueError: A term or an action speaks of a class that there is not, or an action of one class twice.
    """

    name: str
    classes: tuple[ObjectClass, ...]
    terms: tuple[Term, ...]
    actions: Mapping[str, tuple[str, ...]]

    def __post_init__(self) -> None:
        known = set(self.classes_by_name)
        for term in self.terms:
            if unknown := set(term.classes) - known:
                raise ValueError(f"term {term.name} speaks of {', '.join(sorted(unknown))}, which is no class")
        for action, parameters in self.actions.items():
            if unknown := set(parameters) - known:
                raise ValueError(f"action {action} takes {', '.join(sorted(unknown))}, which is no class")
            if len(set(parameters)) < len(parameters):
                raise ValueError(f"action {action} takes two of one class, which no term could tell apart")

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
        """The terms as they are printed, one for each sign of a condition.

        Where actions have parameters, a last term tells whether "this" object is one that the action is done to.
        """
        names = tuple(term.name for term in self.terms)
        return (*names, "this is an argument") if self.has_parameters else names

    @cached_property
    def size(self) -> int:
        """n, the number of terms."""
        return len(self.term_names)

    @cached_property
    def _bare_actions(self) -> tuple[Action, ...]:
        return tuple(Action(name) for name in self.actions)

    @cached_property
    def _terms_of(self) -> Mapping[str, tuple[tuple[int, Term], ...]]:
        """The terms that speak of each class, with their positions."""
        return {
            item.name: tuple((index, term) for index, term in enumerate(self.terms) if item.name in term.classes)
            for item in self.classes
        }

    def ground_actions(self, state: State) -> tuple[Action, ...]:
        """All actions that can be tried in a state."""
        if not self.has_parameters:
            return self._bare_actions
        return tuple(
            Action(name, tuple(item.name for item in arguments))
            for name, parameters in self.actions.items()
            for arguments in product(*(state.of_class(parameter) for parameter in parameters))
        )

    def cond(self, state: State, this: Object | None = None, action: Action | None = None) -> Condition:
        """Tell which terms hold in a state (section 4).

        Args:
            state: s.
            this: The object whose attributes are spoken of: terms about its class mean this object. None for the
                condition of the state as a whole, in which they mean some object of the class.
            action: Where it has arguments, terms about their classes mean those.
        """
        conditions = self.conditions(state, action)
        return Condition.of(self.size, conditions[0 if this is None else 1 + state.objects.index(this)])

    def conditions(self, state: State, action: Action | None = None) -> tuple[int, ...]:
        """All conditions that matter in a state, as bits: the whole state's, then each object's (see `cond`).

        They are worked out once and kept with the state.
        """
        arguments = () if action is None else action.arguments
        return state.cached_conditions(arguments, lambda: self._conditions(state, arguments))

    def _conditions(self, state: State, arguments: tuple[str, ...]) -> tuple[int, ...]:
        targets = tuple(state[name] for name in arguments)
        bound = {target.object_class.name: target for target in targets}
        common = 0
        for index, term in enumerate(self.terms):
            common |= term.holds(state, bound) << index
        conditions = [common]
        for item in state.objects:
            name = item.object_class.name
            own = common
            if len(state.of_class(name)) > 1:
                for index, term in self._terms_of[name]:
                    own = own & ~(1 << index) | term.holds(state, {**bound, name: item}) << index
            conditions.append(own | (item in targets) << len(self.terms))
        return tuple(conditions)
