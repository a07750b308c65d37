"""The states that a model can reach, numbered, with tables for planners that sweep over them.

States get numbers in the order in which they are met. Those with the same conditions form a group, for which the model
is asked once; and what a branch of its answer makes of a state is worked out once, whichever learner says it and
however often. So after more was learnt only a few table entries change, and learners of one domain can share a space.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from numpy.typing import NDArray

from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.oomdp.outcomes import Branch, ConditionalModel

END = -1  # the episode ends
UNKNOWN = -2  # the model cannot tell
HOPELESS = -3  # the model cannot tell, and nothing more can be learnt about it
MISSING = -4  # not worked out yet

Integers = NDArray[np.int32]
Floats = NDArray[np.float64]


class StateSpace:
    """Numbered states, and what the branches of answers make of them.

    Attributes:
        states: The states that were met, by number.
        groups: One state of every group, by the group's number.
        group_actions: The numbers of the actions that are possible in every group.
        actions: All actions that were met, by number.
        group: [S] the group of every state.
        successor: [B, S] the number of the state that branch b makes of state s, or one of the negative constants.
        reward: [B, S] what that step is worth.
    """

    def __init__(self) -> None:
        self.states: list[State] = []
        self.groups: list[State] = []
        self.group_actions: list[frozenset[int]] = []
        self.actions: list[Action] = []
        self.group: Integers = np.zeros(64, np.int32)
        self.successor: Integers = np.full((8, 64), MISSING, np.int32)
        self.reward: Floats = np.zeros((8, 64))
        self._branches: list[tuple[Action, Branch]] = []
        self._state_numbers: dict[State, int] = {}
        self._group_numbers: dict[Hashable, int] = {}
        self._branch_numbers: dict[tuple[Action, Branch], int] = {}

    def number(self, state: State, model: ConditionalModel) -> int:
        """The number of a state, which it gets now if it was not met before."""
        known = self._state_numbers.get(state)
        if known is not None:
            state.share_conditions(self.states[known])
            return known
        number = self._state_numbers[state] = len(self.states)
        self.states.append(state)
        if number == len(self.group):
            self._widen()
        self.group[number] = self._group(state, model)
        return number

    def _group(self, state: State, model: ConditionalModel) -> int:
        key = model.key(state)
        known = self._group_numbers.get(key)
        if known is None:
            known = self._group_numbers[key] = len(self.groups)
            self.groups.append(state)
            possible = model.domain.ground_actions(state)
            self.actions.extend(action for action in possible if action not in self.actions)
            self.group_actions.append(frozenset(map(self.actions.index, possible)))
        return known

    def branch_number(self, action: Action, branch: Branch) -> int:
        """The number of a branch, that is, its row in the tables."""
        known = self._branch_numbers.get((action, branch))
        if known is None:
            known = self._branch_numbers[action, branch] = len(self._branches)
            self._branches.append((action, branch))
            if known == len(self.successor):
                self.successor = np.vstack([self.successor, np.full_like(self.successor, MISSING)])
                self.reward = np.vstack([self.reward, np.zeros_like(self.reward)])
        return known

    def work_out(self, branch_number: int, state_number: int, model: ConditionalModel) -> None:
        """Fill in what a branch makes of a state; a state that is met for the first time gets its number."""
        action, branch = self._branches[branch_number]
        prediction = branch.predict(self.states[state_number], action)
        if prediction.state is None or prediction.reward is None or prediction.terminated is None:
            self.successor[branch_number, state_number] = UNKNOWN if prediction.probability > 0 else HOPELESS
            return
        successor = END if prediction.terminated else self.number(prediction.state, model)
        self.successor[branch_number, state_number] = successor
        self.reward[branch_number, state_number] = prediction.reward

    def _widen(self) -> None:
        self.group = np.concatenate([self.group, np.zeros_like(self.group)])
        self.successor = np.hstack([self.successor, np.full_like(self.successor, MISSING)])
        self.reward = np.hstack([self.reward, np.zeros_like(self.reward)])
