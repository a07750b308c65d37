"""Export of a learnt model and a state to PDDL, for classical planners.

The reachable states are enumerated, and the predictions in them are turned into operators. The preconditions of an
action's effect are a minimal set of terms that separates the states with this effect from all others. A PDDL object
stands for one combination of an object's values, ``taxi_x2_y3``. A term such as ``touch_N(taxi, wall)`` becomes a
static predicate of the values that determine it. Steps with unknown outcome are left out, so a plan for the PDDL
problem is a plan for the model, of the same length.

If the terms do not determine which steps reach the goal (no term holds exactly where a crate is one step from its
target), the objects' values after the step have to. Operators that can reach the goal are then written twice: for any
values after the step, and for those of the goal.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from wherry.oomdp.domain import Action, Domain
from wherry.oomdp.mdp import Model, Outcome
from wherry.oomdp.objects import State
from wherry.planning.pddl_names import change_name, domain_text, identifier, operator_text, problem_text, value_name
from wherry.planning.pddl_operators import (
    ActionEffects,
    Changes,
    FactTable,
    StateLiteral,
    StepEffect,
    minimal_objects,
    values_determine,
)

MAX_STATES = 100_000  # reachable states; larger models are not exported
GOAL_PREDICATE = "goal_values"

ReachesGoal = Callable[[Outcome], bool]
"""Returns whether a predicted outcome reaches the goal."""


@dataclass(frozen=True)
class PddlTask:
    """A planning task as PDDL texts.

    Attributes:
        domain: Text of the domain file.
        problem: Text of the problem file.
        actions: The action that each operator stands for, by the operator's name.
    """

    domain: str
    problem: str
    actions: Mapping[str, Action]


class _PredictedStep(NamedTuple):
    """The most likely outcome of one action in one state.

    Attributes:
        state: Index of s in the order of exploration.
        action: a.
        literals: The literals that hold in s for this action, as bits.
        effect: The effect; None if nothing changes, the outcome is unknown, or the episode ends without the goal.
        next_state: s'; None if it is unknown.
    """

    state: int
    action: Action
    literals: int
    effect: StepEffect | None
    next_state: State | None


class _GoalValues(NamedTuple):
    """The goal in terms of the values that objects have after a step.

    Attributes:
        objects: Names of the objects whose values matter.
        rows: Combinations of these objects' value names in the goal.
        reached_by: The actions that reach the goal from some state, with the changes that they make there.
    """

    objects: tuple[str, ...]
    rows: list[tuple[str, ...]]
    reached_by: set[tuple[Action, Changes]]

    def precondition(self, changed: Mapping[str, str]) -> str:
        """The literal that an operator needs as a precondition in order to reach the goal.

        Args:
            changed: The objects that the operator changes, with the names of their changes.
        """
        values_after = (
            f"?{identifier(name)}_after" if name in changed else f"?{identifier(name)}" for name in self.objects
        )
        return _literal(GOAL_PREDICATE, *values_after)


def succeeds(outcome: Outcome) -> bool:
    """Whether a step ends the episode with a positive reward."""
    return bool(outcome.terminated) and outcome.reward is not None and outcome.reward > 0


def export_pddl(model: Model, domain: Domain, start: State, reaches_goal: ReachesGoal = succeeds) -> PddlTask:
    """Write a model and a state as a PDDL domain and problem.

    Args:
        model: A model whose predictions depend on the domain's terms alone, such as a learnt one.
        domain: The domain of the states.
        start: Initial state of the problem.
        reaches_goal: Returns whether an outcome reaches the goal.

    Raises:
        ValueError: The predictions depend on more than the terms; whether a step reaches the goal depends on more than
            the terms and the next state; or more than 100,000 states are reachable.
    """
    steps = _ReachableSteps(model, domain, start, reaches_goal)
    return _TaskWriter(steps).write()


class _ReachableSteps:
    """All reachable states and the predicted steps from them.

    Attributes:
        object_names: Names of the objects of the initial state.
        literals: The literals that can be preconditions.
        value_names: For each state the name of each object's values, by object name.
        steps: The predicted steps of all actions in all states.
        value_changes: By object and change, the names of the object's values before and after (an ordered set).
    """

    def __init__(self, model: Model, domain: Domain, start: State, reaches_goal: ReachesGoal) -> None:
        self.model = model
        self.domain = domain
        self.start = start
        self.reaches_goal = reaches_goal
        self.object_names = [item.name for item in start.objects]
        self.literals = self._literals()
        self.value_names: list[dict[str, str]] = []
        self.steps: list[_PredictedStep] = []
        self.value_changes: dict[tuple[str, str], dict[tuple[str, str], None]] = {}
        self._explore()

    def value_names_in(self, state: State) -> dict[str, str]:
        """The name of each object's values in a state."""
        return {name: value_name(name, state.get(name)) for name in self.object_names}

    def _literals(self) -> list[StateLiteral]:
        """All terms; the terms about each object whose class has several objects; the presence of removable objects."""
        literals = [StateLiteral(term, None) for term in range(len(self.domain.terms))]
        for item in self.start.objects:
            if len(self.start.of_class(item.object_class.name)) > 1:
                about = (
                    index for index, term in enumerate(self.domain.terms) if item.object_class.name in term.classes
                )
                literals += [StateLiteral(index, item.name) for index in about]
            if item.object_class.removable:
                literals.append(StateLiteral(None, item.name))
        return literals

    def _literals_in(self, state: State, action: Action) -> int:
        """The literals that hold in a state, as bits."""
        whole, *own = self.domain.conditions(state, action)
        by_name = dict(zip((item.name for item in state.objects), own, strict=True))
        bits = 0
        for index, (term, this) in enumerate(self.literals):
            conditions = whole if this is None else by_name.get(this)
            holds = conditions is not None if term is None else bool((conditions or 0) >> term & 1)
            bits |= holds << index
        return bits

    def _explore(self) -> None:
        """Predict all actions in all reachable states, breadth first."""
        seen, queue = {self.start}, deque([self.start])
        while queue:
            state = queue.popleft()
            self.value_names.append(self.value_names_in(state))
            if len(self.value_names) > MAX_STATES:
                raise ValueError(f"more than {MAX_STATES:,} states are reachable")
            for action in self.domain.ground_actions(state):
                outcome = self.model.predict(state, action).most_likely
                after = outcome.next_state
                literals, effect = self._literals_in(state, action), self._effect(state, outcome)
                self.steps.append(_PredictedStep(len(self.value_names) - 1, action, literals, effect, after))
                if after is not None and not outcome.terminated and after not in seen:
                    seen.add(after)
                    queue.append(after)

    def _effect(self, state: State, outcome: Outcome) -> StepEffect | None:
        """The effect of a step; None if nothing changes, it is unknown, or the episode ends without the goal."""
        reaches_goal = self.reaches_goal(outcome)
        if outcome.next_state is None or (outcome.terminated and not reaches_goal):
            return None
        changes = []
        for item in state.objects:
            after = outcome.next_state.get(item.name)
            if after != item:
                change = change_name(item, after)
                changes.append((item.name, change))
                pair = value_name(item.name, item), value_name(item.name, after)
                self.value_changes.setdefault((item.name, change), {})[pair] = None
        return StepEffect(tuple(changes), reaches_goal) if changes or reaches_goal else None


class _TaskWriter:
    """Turns the predicted steps into operators, predicates and facts."""

    def __init__(self, reachable: _ReachableSteps) -> None:
        self.reachable = reachable
        self.goal = None if self._terms_determine_the_goal() else self._goal_values()
        self.predicates: dict[str, list[str]] = {}  # parameter types by predicate
        self.facts: list[str] = []
        self.operators: list[str] = []
        self.actions: dict[str, Action] = {}
        self._fact_tables: dict[str, FactTable] = {}  # by predicate

    def write(self) -> PddlTask:
        """Write the task."""
        reachable = self.reachable
        self._declare_values_and_changes()
        for action, effects in self._action_effects().items():
            for number, (effect, mask, value) in enumerate(effects.operators(len(reachable.literals)), start=1):
                name = identifier(f"{action.name}_{'_'.join((*action.arguments, str(number)))}")
                self._add_operators(name, action, effect, mask, value)
        values = {name: {found[name]: None for found in reachable.value_names} for name in reachable.object_names}
        for (name, _), pairs in reachable.value_changes.items():
            values[name] |= {after: None for _, after in pairs}
        name, types = reachable.domain.name, [identifier(item) for item in reachable.object_names]
        return PddlTask(
            domain_text(name, types, self.predicates, self.operators),
            problem_text(name, {identifier(item): list(found) for item, found in values.items()}, self.facts),
            self.actions,
        )

    def _declare_values_and_changes(self) -> None:
        """Add predicates and facts for the objects' current values, for changes of values, and for the goal."""
        reachable = self.reachable
        for name in reachable.object_names:
            self.predicates[f"is_{identifier(name)}"] = [identifier(name)]
            self.facts.append(_literal(f"is_{identifier(name)}", value_name(name, reachable.start[name])))
        for (name, change), pairs in reachable.value_changes.items():
            predicate = identifier(f"{name}_{change}")
            self.predicates[predicate] = [identifier(name)] * 2
            self.facts += [_literal(predicate, before, after) for before, after in pairs]
        if self.goal is not None:
            self.predicates[GOAL_PREDICATE] = [identifier(name) for name in self.goal.objects]
            self.facts += [_literal(GOAL_PREDICATE, *values) for values in self.goal.rows]

    def _add_operators(self, name: str, action: Action, effect: StepEffect, mask: int, value: int) -> None:
        """Add the operator for an effect, and its variant that reaches the goal if terms do not determine it."""
        preconditions, involved = [], dict.fromkeys(changed for changed, _ in effect.changes)
        for index in (index for index in range(len(self.reachable.literals)) if mask >> index & 1):
            predicate, (objects, rows) = self._predicate(action, index)
            if predicate not in self.predicates:
                self.predicates[predicate] = [identifier(item) for item in objects]
                self.facts += [_literal(predicate, *values) for values in rows]
            involved |= dict.fromkeys(objects)
            literal = _literal(predicate, *(f"?{identifier(item)}" for item in objects))
            preconditions.append(literal if value >> index & 1 else f"(not {literal})")
        self.operators.append(operator_text(name, list(involved), preconditions, effect))
        self.actions[name] = action
        if self.goal is not None and (action, effect.changes) in self.goal.reached_by:
            involved |= dict.fromkeys(self.goal.objects)
            preconditions.append(self.goal.precondition(dict(effect.changes)))
            effect = StepEffect(effect.changes, reaches_goal=True)
            self.operators.append(operator_text(f"{name}_to_goal", list(involved), preconditions, effect))
            self.actions[f"{name}_to_goal"] = action

    def _action_effects(self) -> dict[Action, ActionEffects]:
        """The predicted effects of every action."""
        found: dict[Action, ActionEffects] = {}
        for step in self.reachable.steps:
            effect = step.effect
            if effect is not None and self.goal is not None:
                effect = StepEffect(effect.changes, reaches_goal=False) if effect.changes else None
            try:
                found.setdefault(step.action, ActionEffects()).add(step.literals, effect)
            except ValueError as error:
                raise ValueError(f"{step.action}: {error}") from error
        return found

    def _terms_determine_the_goal(self) -> bool:
        """Whether steps with equal literals and changes agree on whether they reach the goal."""
        known: dict[tuple[Action, int, Changes], bool] = {}
        return all(
            known.setdefault((step.action, step.literals, step.effect.changes), step.effect.reaches_goal)
            == step.effect.reaches_goal
            for step in self.reachable.steps
            if step.effect is not None
        )

    def _goal_values(self) -> _GoalValues:
        """The objects' values after a step that determine whether the step has reached the goal."""
        steps = [(step, step.effect) for step in self.reachable.steps if step.effect is not None]
        examples = [
            (self.reachable.value_names_in(step.next_state), effect.reaches_goal)
            for step, effect in steps
            if step.next_state is not None
        ]
        names = self.reachable.object_names
        if not values_determine(names, examples):
            raise ValueError("whether the goal is reached depends on more than the terms and the state after the step")
        objects, rows = minimal_objects(names, examples)
        reached_by = {(step.action, effect.changes) for step, effect in steps if effect.reaches_goal}
        return _GoalValues(tuple(objects), rows, reached_by)

    def _predicate(self, action: Action, index: int) -> tuple[str, FactTable]:
        """The predicate for a literal, and the values of objects with which it holds."""
        term, this = self.reachable.literals[index]
        about = "there" if term is None else self.reachable.domain.terms[term].name
        arguments = "" if term is None else "_".join(action.arguments)
        name = identifier("_".join(filter(None, (about, this and f"this_{this}", arguments))))
        if name not in self._fact_tables:
            self._fact_tables[name] = self._fact_table(action, index)
        return name, self._fact_tables[name]

    def _fact_table(self, action: Action, index: int) -> FactTable:
        """The values with which a literal holds; objects that its term does not mention are dropped first."""
        reachable = self.reachable
        term, this = reachable.literals[index]
        if term is None and this is not None:
            mentioned = {this}
            examples = [(values, values[this] != value_name(this, None)) for values in reachable.value_names]
        else:
            classes = reachable.domain.terms[term or 0].classes
            mentioned = {item.name for item in reachable.start.objects if item.object_class.name in classes}
            examples = [
                (reachable.value_names[step.state], bool(step.literals >> index & 1))
                for step in reachable.steps
                if step.action == action
            ]
        return minimal_objects(sorted(reachable.object_names, key=mentioned.__contains__), examples)


def _literal(predicate: str, *arguments: str) -> str:
    return f"({' '.join((predicate, *arguments))})"
