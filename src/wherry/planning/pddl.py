"""A learnt model and a state as PDDL, so that any classical planner can plan with what was learnt.

The states that the model can reach are listed, and what it says in them is turned back into operators: for each action
and each effect the fewest terms that tell where it happens from where it does not. A PDDL object stands for one
combination of an object's values, ``taxi_x2_y3``. Terms, such as ``touch_N(taxi, wall)``, become static predicates of
the values that they turn out to depend on. Steps that the model cannot tell about are left out, so plans are as sure as
the model is, and a plan for the PDDL problem is one for the model, of the same length.

Where terms do not tell which steps reach the goal (no term says that a crate is one step from where it belongs), the
values that objects have after the step do, and operators come twice: with any values, and with those of the goal.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Model, Outcome
from wherry.oomdp.objects import Object, State

MOST_STATES = 100_000
GOAL = "goal_values"


@dataclass(frozen=True)
class Pddl:
    """A planning task.

    Attributes:
        domain: The domain file's text.
        problem: The problem file's text.
        actions: The action that each operator of the domain does.
    """

    domain: str
    problem: str
    actions: Mapping[str, Action]


class Literal(NamedTuple):
    """A term that holds in a state, or that an object is there.

    Attributes:
        term: The term's number; None for being there.
        this: The object that is meant; None for the state as a whole.
    """

    term: int | None
    this: str | None


class Effect(NamedTuple):
    """What a step does, told so that steps that do the same look the same.

    Attributes:
        changes: The names of what happens to the objects that change, by the object's name.
        goal: Whether it reaches the goal.
    """

    changes: tuple[tuple[str, str], ...]
    goal: bool


class _Step(NamedTuple):
    """What is predicted of one action in one state.

    Attributes:
        state: The state's number.
        action: The action.
        bits: Which literals hold.
        effect: What it does, if that counts.
        after: The state after it; None if that is not known.
    """

    state: int
    action: Action
    bits: int
    effect: Effect | None
    after: State | None


class _Goal(NamedTuple):
    """The goal, told by the values that objects have after a step.

    Attributes:
        objects: The names of the objects that matter.
        values: Their values in the goal.
        reaching: The actions, and what they change, that reach it from somewhere.
    """

    objects: tuple[str, ...]
    values: list[tuple[str, ...]]
    reaching: set[tuple[Action, tuple[tuple[str, str], ...]]]

    def asked(self, changed: Mapping[str, str]) -> str:
        """What an operator has to ask for that changes some objects."""
        after = (f"?{_word(name)}_after" if name in changed else f"?{_word(name)}" for name in self.objects)
        return f"({' '.join((GOAL, *after))})"


@dataclass
class _Operators:
    """What one action does where.

    Attributes:
        effects: Under which literals (bits) which effect was predicted; None for no effect that counts.
    """

    effects: dict[int, Effect | None] = field(default_factory=dict)

    def add(self, bits: int, effect: Effect | None) -> None:
        """Take in one prediction; a step out of bounds says nothing of others under the same literals."""
        known = self.effects.get(bits)
        if known is not None and effect not in {None, known}:
            raise ValueError("what is predicted depends on more than the domain's terms")
        self.effects[bits] = known or effect

    def operators(self, size: int) -> Iterable[tuple[Effect, int, int]]:
        """For every effect the conditions under which it happens, each as simple as can be: a mask and a value."""
        for effect in dict.fromkeys(effect for effect in self.effects.values() if effect is not None):
            others = [bits for bits, other in self.effects.items() if other != effect]
            left = [bits for bits, other in self.effects.items() if other == effect]
            while left:
                mask = _simplest_mask(left[0], others, size)
                yield effect, mask, left[0] & mask
                left = [bits for bits in left if (bits ^ left[0]) & mask]


def _simplest_mask(bits: int, others: Sequence[int], size: int) -> int:
    """Literals that are enough to tell one state's from all others; those in front stay rather than those behind."""
    mask = (1 << size) - 1
    for at in reversed(range(size)):
        smaller = mask & ~(1 << at)
        if all((bits ^ other) & smaller for other in others):
            mask = smaller
    return mask


def succeeds(outcome: Outcome) -> bool:
    """Whether a step ends the episode with a positive reward."""
    return bool(outcome.terminated) and outcome.reward is not None and outcome.reward > 0


def export_pddl(model: Model, domain: Domain, start: State, reaches_goal: Callable[[Outcome], bool] = succeeds) -> Pddl:
    """Write a model and a state as a PDDL domain and problem.

    Args:
        model: What was learnt, or any other model whose predictions depend on the domain's terms alone.
        domain: What states are described with.
        start: s_0.
        reaches_goal: Which steps the plan is to end with.

    Raises:
        ValueError: The predictions depend on more than the terms, or whether a step reaches the goal does on more than
            the terms and the state after it; or more than 100,000 states can be reached.
    """
    return _Export(model, domain, start, reaches_goal).write()


class _Export:
    """One export: the reachable states, what is predicted in them, and names for it all."""

    def __init__(self, model: Model, domain: Domain, start: State, reaches_goal: Callable[[Outcome], bool]) -> None:
        self.model = model
        self.domain = domain
        self.start = start
        self.reaches_goal = reaches_goal
        self.names = [item.name for item in start.objects]
        self.literals = self._literals()
        self.states: list[State] = []
        self.values: list[dict[str, str]] = []  # of every state: the names of its objects' values
        self.steps: list[_Step] = []
        self.operators: dict[Action, _Operators] = {}
        self.predicates: dict[str, tuple[list[str], list[tuple[str, ...]]]] = {}  # what was found by `_depends_on`
        self.pairs: dict[tuple[str, str], dict[tuple[str, str], None]] = {}  # by object and change: before, after
        self._explore()
        self.goal = None if self._terms_tell_the_goal() else self._goal()
        self._find_operators()

    def _literals(self) -> list[Literal]:
        """What operators may ask for: the terms, those of each object where a class has several, and who is there."""
        literals = [Literal(term, None) for term in range(len(self.domain.terms))]
        for item in self.start.objects:
            if len(self.start.of_class(item.object_class.name)) > 1:
                about = (term for term, of in enumerate(self.domain.terms) if item.object_class.name in of.classes)
                literals += [Literal(term, item.name) for term in about]
            if item.object_class.removable:
                literals.append(Literal(None, item.name))
        return literals

    def _bits(self, state: State, action: Action) -> int:
        """Which literals hold in a state."""
        whole, *own = self.domain.conditions(state, action)
        by_name = dict(zip((item.name for item in state.objects), own, strict=True))
        bits = 0
        for at, (term, this) in enumerate(self.literals):
            conditions = whole if this is None else by_name.get(this)
            holds = conditions is not None if term is None else bool((conditions or 0) >> term & 1)
            bits |= holds << at
        return bits

    def _explore(self) -> None:
        """Ask the model about all that it can reach."""
        seen, queue = {self.start}, deque([self.start])
        while queue:
            state = queue.popleft()
            self.states.append(state)
            self.values.append(self._values(state))
            if len(self.states) > MOST_STATES:
                raise ValueError(f"more than {MOST_STATES:,} states can be reached")
            for action in self.domain.ground_actions(state):
                outcome = self.model.predict(state, action).most_likely
                after = outcome.next_state
                bits, effect = self._bits(state, action), self._effect(state, outcome)
                self.steps.append(_Step(len(self.states) - 1, action, bits, effect, after))
                if after is not None and not outcome.terminated and after not in seen:
                    seen.add(after)
                    queue.append(after)

    def _values(self, state: State) -> dict[str, str]:
        """The names of the values that all objects have in a state."""
        return {name: _value(name, state.get(name)) for name in self.names}

    def _terms_tell_the_goal(self) -> bool:
        """Whether no two steps under the same literals do the same, and only one of them reaches the goal."""
        known: dict[tuple[Action, int, tuple[tuple[str, str], ...]], bool] = {}
        return all(
            known.setdefault((step.action, step.bits, step.effect.changes), step.effect.goal) == step.effect.goal
            for step in self.steps
            if step.effect is not None
        )

    def _goal(self) -> _Goal:
        """The values after a step that tell whether it has reached the goal."""
        facts = [
            (self._values(step.after), int(step.effect.goal))
            for step in self.steps
            if step.effect is not None and step.after is not None
        ]
        if not _tells(self.names, facts):
            raise ValueError("whether the goal is reached depends on more than the terms and the state after the step")
        needed, holding = _fewest(self.names, facts)
        reaching = {
            (step.action, step.effect.changes) for step in self.steps if step.effect is not None and step.effect.goal
        }
        return _Goal(tuple(needed), holding, reaching)

    def _find_operators(self) -> None:
        """Put the steps of every action together."""
        for step in self.steps:
            effect = step.effect
            if effect is not None and self.goal is not None:
                effect = Effect(effect.changes, goal=False) if effect.changes else None
            try:
                self.operators.setdefault(step.action, _Operators()).add(step.bits, effect)
            except ValueError as error:
                raise ValueError(f"{step.action}: {error}") from error

    def _effect(self, state: State, outcome: Outcome) -> Effect | None:
        """What a step does; None where that does not count: nothing, something unknown, or a bad end."""
        goal = self.reaches_goal(outcome)
        if outcome.next_state is None or (outcome.terminated and not goal):
            return None
        changes = []
        for item in state.objects:
            after = outcome.next_state.get(item.name)
            if after != item:
                change = _change(item, after)
                changes.append((item.name, change))
                pair = _value(item.name, item), _value(item.name, after)
                self.pairs.setdefault((item.name, change), {})[pair] = None
        return Effect(tuple(changes), goal) if changes or goal else None

    def _depends_on(self, action: Action, at: int) -> tuple[list[str], list[tuple[str, ...]]]:
        """The fewest objects whose values tell a literal, and the values with which it holds."""
        term, this = self.literals[at]
        if term is None and this is not None:
            spoken_of = {this}
            facts = [(values, int(values[this] != _value(this, None))) for values in self.values]
        else:
            classes = self.domain.terms[term or 0].classes
            spoken_of = {item.name for item in self.start.objects if item.object_class.name in classes}
            facts = [(self.values[step.state], step.bits >> at & 1) for step in self.steps if step.action == action]
        return _fewest(sorted(self.names, key=spoken_of.__contains__), facts)

    def write(self) -> Pddl:
        """Put it all into words."""
        predicates: dict[str, list[str]] = {f"is_{_word(name)}": [_word(name)] for name in self.names}
        facts = [f"(is_{_word(name)} {_value(name, self.start[name])})" for name in self.names]
        for (name, change), pairs in self.pairs.items():
            predicates[_word(f"{name}_{change}")] = [_word(name)] * 2
            facts += [f"({_word(f'{name}_{change}')} {before} {after})" for before, after in pairs]
        if self.goal is not None:
            predicates[GOAL] = [_word(name) for name in self.goal.objects]
            facts += [f"({' '.join((GOAL, *values))})" for values in self.goal.values]
        operators, actions = [], {}
        for action, found in self.operators.items():
            for number, (effect, mask, value) in enumerate(found.operators(len(self.literals)), start=1):
                name = _word(f"{action.name}_{'_'.join((*action.arguments, str(number)))}")
                actions[name] = action
                needs, involved = [], dict.fromkeys(changed for changed, _ in effect.changes)
                for at in (at for at in range(len(self.literals)) if mask >> at & 1):
                    predicate, objects, holding = self._predicate(action, at)
                    if predicate not in predicates:
                        predicates[predicate] = [_word(item) for item in objects]
                        facts += [f"({' '.join((predicate, *values))})" for values in holding]
                    involved |= dict.fromkeys(objects)
                    asked = f"({' '.join((predicate, *(f'?{_word(item)}' for item in objects)))})"
                    needs.append(asked if value >> at & 1 else f"(not {asked})")
                operators.append(_operator(name, list(involved), needs, effect))
                if self.goal is not None and (action, effect.changes) in self.goal.reaching:
                    actions[f"{name}_to_goal"] = action
                    involved |= dict.fromkeys(self.goal.objects)
                    asked = self.goal.asked(dict(effect.changes))
                    reached = Effect(effect.changes, goal=True)
                    operators.append(_operator(f"{name}_to_goal", list(involved), [*needs, asked], reached))
        values = {name: {found[name]: None for found in self.values} for name in self.names}
        for (name, _), pairs in self.pairs.items():
            values[name] |= {after: None for _, after in pairs}
        return Pddl(
            _domain_text(self.domain.name, [_word(name) for name in self.names], predicates, operators),
            _problem_text(self.domain.name, {_word(name): list(found) for name, found in values.items()}, facts),
            actions,
        )

    def _predicate(self, action: Action, at: int) -> tuple[str, list[str], list[tuple[str, ...]]]:
        """A literal's predicate: its name, the objects that it depends on, and the values with which it holds."""
        term, this = self.literals[at]
        about = "there" if term is None else self.domain.terms[term].name
        arguments = "" if term is None else "_".join(action.arguments)
        name = _word("_".join(filter(None, (about, this and f"this_{this}", arguments))))
        if name not in self.predicates:
            self.predicates[name] = self._depends_on(action, at)
        return name, *self.predicates[name]


def _fewest(
    names: Sequence[str], facts: Sequence[tuple[Mapping[str, str], int]]
) -> tuple[list[str], list[tuple[str, ...]]]:
    """The fewest objects whose values tell whether a literal holds, those in front left out first; and where it does.

    The objects are in the order in which the facts name them.
    """
    needed = list(facts[0][0])
    for name in names:
        fewer = [other for other in needed if other != name]
        if _tells(fewer, facts):
            needed = fewer
    return needed, list({tuple(values[name] for name in needed): None for values, holds in facts if holds})


def _tells(names: Sequence[str], facts: Sequence[tuple[Mapping[str, str], int]]) -> bool:
    """Whether the values of some objects tell whether a literal holds."""
    known: dict[tuple[str, ...], int] = {}
    return all(known.setdefault(tuple(values[name] for name in names), holds) == holds for values, holds in facts)


def _change(item: Object, after: Object | None) -> str:
    """What happens to an object, as part of a name: ``y_plus_1``."""
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


def _value(name: str, item: Object | None) -> str:
    """The name of an object's values: ``taxi_x2_y3``."""
    if item is None:
        return _word(f"{name}_gone")
    parts = [name]
    for attribute, value in zip(item.object_class.attributes, item.values, strict=True):
        if isinstance(value, bool):
            parts.append(attribute.name if value else f"not_{attribute.name}")
        else:
            parts.append(f"{attribute.name}{value}")
    return _word("_".join(parts))


def _word(text: str) -> str:
    """A name that PDDL admits."""
    return re.sub(r"\W+", "_", text.lower().replace("-", "m")).strip("_")


def _operator(name: str, objects: Sequence[str], needs: Sequence[str], effect: Effect) -> str:
    words = {item: _word(item) for item in objects}
    changed = dict(effect.changes)
    parameters = [f"?{words[item]} - {words[item]}" for item in objects]
    parameters += [f"?{words[item]}_after - {words[item]}" for item in changed]
    conditions = [f"(is_{words[item]} ?{words[item]})" for item in objects] + list(needs)
    effects = []
    for item, change in changed.items():
        word = words[item]
        conditions.append(f"({_word(f'{item}_{change}')} ?{word} ?{word}_after)")
        effects += [f"(not (is_{word} ?{word}))", f"(is_{word} ?{word}_after)"]
    effects += ["(done)"] if effect.goal else []
    return (
        f"  (:action {name}\n    :parameters ({' '.join(parameters)})\n"
        f"    :precondition (and {' '.join(conditions)})\n    :effect (and {' '.join(effects)}))\n"
    )


def _domain_text(
    name: str, types: Sequence[str], predicates: Mapping[str, Sequence[str]], operators: Sequence[str]
) -> str:
    declared = [
        f"    ({' '.join([predicate, *(f'?p{at} - {kind}' for at, kind in enumerate(kinds))])})"
        for predicate, kinds in predicates.items()
    ]
    lines = "\n".join(["    (done)", *declared])
    return (
        f"(define (domain {_word(name)})\n  (:requirements :strips :typing :negative-preconditions)\n"
        f"  (:types {' '.join(types)})\n  (:predicates\n{lines})\n{''.join(operators)})\n"
    )


def _problem_text(name: str, values: Mapping[str, Sequence[str]], facts: Sequence[str]) -> str:
    objects = "\n".join(f"    {' '.join(found)} - {kind}" for kind, found in values.items())
    initially = "\n".join(f"    {fact}" for fact in facts)
    return (
        f"(define (problem {_word(name)}_1)\n  (:domain {_word(name)})\n  (:objects\n{objects})\n"
        f"  (:init\n{initially})\n  (:goal (done)))\n"
    )
