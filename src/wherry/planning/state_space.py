"""The states that a model can reach, numbered, with transition tables for planners that sweep over arrays.

States are numbered in the order in which they are generated. States with the same key form a group, for which the model
is queried once. A conditional outcome is grounded in a state at most once. So a revision of the model changes few table
entries, and models of one domain can share a space.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

from wherry.oomdp.conditional_models import ConditionalModel, ConditionalOutcome
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State

# Entries of the successor table that are not state numbers:
TERMINAL_SUCCESSOR = -1  # the episode ends
UNKNOWN_SUCCESSOR = -2  # the model does not know the outcome (s_max)
IMPOSSIBLE_SUCCESSOR = -3  # the outcome is impossible in this state, or nothing can be learnt about it
NOT_GROUNDED = -4  # the outcome has not been grounded in this state yet

Integers = NDArray[np.int32]
Floats = NDArray[np.float64]


class StateSpace:
    """Numbered states, with tables of the successor and the reward of each conditional outcome in each state.

    The space has S states, G groups and O conditional outcomes; the arrays have spare rows and columns.

    Attributes:
        states: [S] the states by number.
        groups: [G] one state of every group.
        group_actions: [G] numbers of the ground actions in every group's states.
        actions: The actions by number.
        group: [S] group number of every state.
        successor: [O, S] number of the successor of state s under outcome o, or one of the negative constants.
        reward: [O, S] reward of outcome o in state s.
    """

    def __init__(self) -> None:
        self.states: list[State] = []
        self.groups: list[State] = []
        self.group_actions: list[frozenset[int]] = []
        self.actions: list[Action] = []
        self.group: Integers = np.zeros(64, np.int32)
        self.successor: Integers = np.full((8, 64), NOT_GROUNDED, np.int32)
        self.reward: Floats = np.zeros((8, 64))
        self._outcomes: list[tuple[Action, ConditionalOutcome]] = []
        self._state_numbers: dict[State, int] = {}
        self._group_numbers: dict[Hashable, int] = {}
        self._outcome_numbers: dict[tuple[Action, ConditionalOutcome], int] = {}

    def number(self, state: State, model: ConditionalModel) -> int:
        """The number of a state; a new state is given the next one."""
        existing = self._state_numbers.get(state)
        if existing is not None:
            state.share_conditions(self.states[existing])
            return existing
        number = self._state_numbers[state] = len(self.states)
        self.states.append(state)
        if number == len(self.group):
            self._double_state_capacity()
        self.group[number] = self._group_number(state, model)
        return number

    def _group_number(self, state: State, model: ConditionalModel) -> int:
        key = model.state_key(state)
        number = self._group_numbers.get(key)
        if number is None:
            number = self._group_numbers[key] = len(self.groups)
            self.groups.append(state)
            actions = model.domain.ground_actions(state)
            self.actions.extend(action for action in actions if action not in self.actions)
            self.group_actions.append(frozenset(map(self.actions.index, actions)))
        return number

    def outcome_number(self, action: Action, outcome: ConditionalOutcome) -> int:
        """The number of a conditional outcome, which is its row in the tables."""
        number = self._outcome_numbers.get((action, outcome))
        if number is None:
            number = self._outcome_numbers[action, outcome] = len(self._outcomes)
            self._outcomes.append((action, outcome))
            if number == len(self.successor):
                self.successor = np.vstack([self.successor, np.full_like(self.successor, NOT_GROUNDED)])
                self.reward = np.vstack([self.reward, np.zeros_like(self.reward)])
        return number

    def ground(self, outcome_number: int, state_number: int, model: ConditionalModel) -> None:
        """Ground a conditional outcome in a state and enter it in the tables; a new next state is numbered."""
        action, conditional = self._outcomes[outcome_number]
        outcome = conditional.ground(self.states[state_number], action)
        if outcome.next_state is None or outcome.reward is None or outcome.terminated is None:
            self.successor[outcome_number, state_number] = (
                UNKNOWN_SUCCESSOR if outcome.probability > 0 else IMPOSSIBLE_SUCCESSOR
            )
            return
        successor = TERMINAL_SUCCESSOR if outcome.terminated else self.number(outcome.next_state, model)
        self.successor[outcome_number, state_number] = successor
        self.reward[outcome_number, state_number] = outcome.reward

    def _double_state_capacity(self) -> None:
        self.group = np.concatenate([self.group, np.zeros_like(self.group)])
        self.successor = np.hstack([self.successor, np.full_like(self.successor, NOT_GROUNDED)])
        self.reward = np.hstack([self.reward, np.zeros_like(self.reward)])
