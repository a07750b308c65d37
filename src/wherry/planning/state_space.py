"""The states that a model can reach, numbered, with transition tables for planners that sweep over arrays.

States are numbered in the order in which they are first met. States with the same key form a group, for which the model
is asked once. What a conditional outcome does in a state is computed once, whichever model predicts it and however
often; so a revision of the model changes few table entries, and models of one domain can share a space.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

from wherry.oomdp.conditional_models import ConditionalModel, ConditionalOutcome
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State

# Entries of the successor table that are no state numbers:
TERMINAL = -1  # the episode ends
UNKNOWN = -2  # the model does not know the outcome
IMPOSSIBLE = -3  # the outcome is ruled out, or nothing can be learnt about it
NOT_COMPUTED = -4  # the outcome was not grounded in this state yet

Integers = NDArray[np.int32]
Floats = NDArray[np.float64]


class StateSpace:
    """Numbered states, and tables of where each conditional outcome leads from them.

    S states, G groups and O conditional outcomes are known; the tables have spare rows and columns.

    Attributes:
        states: The states by number.
        groups: One state of every group, by the group's number.
        group_actions: The numbers of the actions that can be tried in every group.
        actions: The actions by number.
        group: [S] group number of every state.
        successor: [O, S] number of the state that outcome o leads to from state s, or one of the negative constants.
        reward: [O, S] reward of that step.
    """

    def __init__(self) -> None:
        self.states: list[State] = []
        self.groups: list[State] = []
        self.group_actions: list[frozenset[int]] = []
        self.actions: list[Action] = []
        self.group: Integers = np.zeros(64, np.int32)
        self.successor: Integers = np.full((8, 64), NOT_COMPUTED, np.int32)
        self.reward: Floats = np.zeros((8, 64))
        self._outcomes: list[tuple[Action, ConditionalOutcome]] = []
        self._state_numbers: dict[State, int] = {}
        self._group_numbers: dict[Hashable, int] = {}
        self._outcome_numbers: dict[tuple[Action, ConditionalOutcome], int] = {}

    def number(self, state: State, model: ConditionalModel) -> int:
        """The number of a state; a new state is given the next one."""
        known = self._state_numbers.get(state)
        if known is not None:
            state.share_conditions(self.states[known])
            return known
        number = self._state_numbers[state] = len(self.states)
        self.states.append(state)
        if number == len(self.group):
            self._double_state_capacity()
        self.group[number] = self._group_number(state, model)
        return number

    def _group_number(self, state: State, model: ConditionalModel) -> int:
        key = model.state_key(state)
        known = self._group_numbers.get(key)
        if known is None:
            known = self._group_numbers[key] = len(self.groups)
            self.groups.append(state)
            possible = model.domain.ground_actions(state)
            self.actions.extend(action for action in possible if action not in self.actions)
            self.group_actions.append(frozenset(map(self.actions.index, possible)))
        return known

    def outcome_number(self, action: Action, outcome: ConditionalOutcome) -> int:
        """The number of a conditional outcome, which is its row in the tables."""
        known = self._outcome_numbers.get((action, outcome))
        if known is None:
            known = self._outcome_numbers[action, outcome] = len(self._outcomes)
            self._outcomes.append((action, outcome))
            if known == len(self.successor):
                self.successor = np.vstack([self.successor, np.full_like(self.successor, NOT_COMPUTED)])
                self.reward = np.vstack([self.reward, np.zeros_like(self.reward)])
        return known

    def compute(self, outcome_number: int, state_number: int, model: ConditionalModel) -> None:
        """Ground a conditional outcome in a state and enter it in the tables; a new next state is numbered."""
        action, conditional = self._outcomes[outcome_number]
        outcome = conditional.ground(self.states[state_number], action)
        if outcome.next_state is None or outcome.reward is None or outcome.terminated is None:
            self.successor[outcome_number, state_number] = UNKNOWN if outcome.probability > 0 else IMPOSSIBLE
            return
        successor = TERMINAL if outcome.terminated else self.number(outcome.next_state, model)
        self.successor[outcome_number, state_number] = successor
        self.reward[outcome_number, state_number] = outcome.reward

    def _double_state_capacity(self) -> None:
        self.group = np.concatenate([self.group, np.zeros_like(self.group)])
        self.successor = np.hstack([self.successor, np.full_like(self.successor, NOT_COMPUTED)])
        self.reward = np.hstack([self.reward, np.zeros_like(self.reward)])
