"""Value iteration over the reachable states, with compiled sweeps (paper, section 6; Puterman 1994, section 6.3).

Unknown outcomes lead to the fictitious state s_max, whose reward is R_max in every step; so an optimal policy explores
wherever the return could be higher (Brafman and Tennenholtz 2002).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from wherry.oomdp.conditional_models import ConditionalModel, ConditionalPrediction
from wherry.oomdp.domain import Action
from wherry.oomdp.objects import State
from wherry.planning.backups import NO_OUTCOME, BackupTables, greedy_action, reachable_states, sweep
from wherry.planning.state_space import Floats, Integers, StateSpace

NEVER_QUERIED = -1  # entry of the table of revisions: the model was not queried yet


class ValueIteration:
    """Optimal policies on a model; plans again by itself when the model has been revised.

    Args:
        model: The model to plan on.
        discount: γ.
        r_max: R_max, the highest reward of any step.
        tolerance: ε, the largest change of a value in the last sweep.
        optimistic: Whether unknown outcomes lead to s_max and all outcomes are weighted by their probabilities. If not,
            unknown outcomes are avoided and every action is assumed to have its most likely outcome.
        curiosity: Bonus for an action of disagreement 1, in units of reward. Above R_max, experiments are preferred to
            the task.
        space: The states and tables to use and extend; models of one domain may share them.
    """

    def __init__(
        self,
        model: ConditionalModel,
        *,
        discount: float = 0.95,
        r_max: float = 20.0,
        tolerance: float = 1e-6,
        optimistic: bool = True,
        curiosity: float = 0.0,
        space: StateSpace | None = None,
    ) -> None:
        self.model = model
        self.discount = discount
        self.tolerance = tolerance
        self.optimistic = optimistic
        self.curiosity = curiosity
        self.unknown_value = r_max / (1 - discount) if optimistic else -np.inf
        self.space = StateSpace() if space is None else space
        self._model_revisions: Mapping[str, int] = {}  # by action name, when last queried
        self._revisions: Integers = np.zeros(0, np.int32)  # [A] revision of every action when last queried
        self._queried_revisions: Integers = np.zeros((0, 0), np.int32)  # [G, A] revision when last queried
        self._predictions: dict[tuple[int, int], ConditionalPrediction] = {}  # by group and action
        self._outcomes: Integers = np.zeros((0, 0, 1), np.int32)  # [G, A, K] numbers of the predicted outcomes
        self._probabilities: Floats = np.zeros((0, 0, 1))  # [G, A, K] probabilities of the predicted outcomes
        self._disagreements: Floats = np.zeros((0, 0))  # [G, A] disagreement of each prediction
        self._values: Floats = np.zeros(0)  # [S] V(s)
        self._solved: NDArray[np.bool_] = np.zeros(0, np.bool_)  # [S] whether a value has converged
        self._reachable: Integers = np.zeros(0, np.int32)  # [R] states of the last sweep

    def policy(self, state: State) -> Action:
        """The best action; of equally good ones the first."""
        number = self.space.number(state, self.model)
        self._solve([number])
        return self.space.actions[greedy_action(number, self._tables())]

    def value(self, state: State) -> float:
        """V(s), the expected discounted return of an optimal policy."""
        return float(self.values([state])[0])

    def values(self, states: Sequence[State]) -> Floats:
        """V [N] of N states, solved together with all states that can be reached from them."""
        numbers = [self.space.number(state, self.model) for state in states]
        self._solve(numbers)
        return self._values[numbers]

    def sweep(self) -> int:
        """Repeat the last sweep: iterate until the values of its states converge; return the number of states.

        `policy` and `values` do so by themselves when the model has been revised.
        """
        sweep(self._reachable, self.tolerance, self._tables())
        self._solved[self._reachable] = True
        return len(self._reachable)

    def _tables(self) -> BackupTables:
        return BackupTables(
            self.space.group,
            self._outcomes,
            self._probabilities,
            self._disagreements,
            self.space.successor,
            self.space.reward,
            self._values,
            self.discount,
            self.unknown_value,
            self.curiosity,
        )

    def _solve(self, numbers: list[int]) -> None:
        """Compute the values of some states and of all states that can be reached from them, unless they are known."""
        revised = self._adopt_revisions()
        if revised or not all(number < len(self._solved) and self._solved[number] for number in numbers):
            self._reach(np.array(numbers, np.int32))
            self.sweep()

    def _adopt_revisions(self) -> bool:
        """Query the model again about the states of the last sweep if it has been revised; return whether it has."""
        if self.model.revisions == self._model_revisions and len(self._revisions) == len(self.space.actions):
            return False
        self._grow_with_space()
        self._model_revisions = dict(self.model.revisions)
        self._revisions = np.array(
            [self._model_revisions.get(action.name, 0) for action in self.space.actions], np.int32
        )
        self._solved[:] = False
        self._query(np.unique(self.space.group[self._reachable]))
        return True

    def _reach(self, starts: Integers) -> None:
        """Find all reachable states; query the model and ground outcomes wherever an entry is missing."""
        while True:
            self._grow_with_space()
            self._reachable, missing = reachable_states(
                starts, len(self.space.states), self._tables(), self._queried_revisions, self._revisions
            )
            if not len(missing):
                break
            is_query_missing = missing[:, 1] == NO_OUTCOME
            self._query(np.unique(self.space.group[missing[is_query_missing, 0]]))
            for state, outcome in missing[~is_query_missing].tolist():
                self.space.ground(outcome, state, self.model)

    def _query(self, groups: Integers) -> None:
        """Query the model about some groups of states, for the actions that were revised since the last query."""
        rows, columns = np.nonzero(self._queried_revisions[groups] != self._revisions)
        self._queried_revisions[groups] = self._revisions
        for group, column in zip(groups[rows].tolist(), columns.tolist(), strict=True):
            if column not in self.space.group_actions[group]:
                continue
            prediction = self.model.conditional_prediction(self.space.groups[group], self.space.actions[column])
            if prediction is not self._predictions.get((group, column)):
                self._predictions[group, column] = prediction
                self._store(group, column, prediction)

    def _store(self, group: int, column: int, prediction: ConditionalPrediction) -> None:
        """Store a prediction in the tables."""
        self._outcomes[group, column] = NO_OUTCOME
        self._probabilities[group, column] = 0.0
        self._disagreements[group, column] = prediction.disagreement
        considered = prediction.outcomes if self.optimistic else prediction.outcomes[:1]
        self._widen_outcomes(len(considered))
        for rank, (outcome, probability) in enumerate(considered):
            self._outcomes[group, column, rank] = self.space.outcome_number(self.space.actions[column], outcome)
            self._probabilities[group, column, rank] = probability if self.optimistic else 1.0

    def _widen_outcomes(self, width: int) -> None:
        """Widen the tables to predictions of that many outcomes."""
        growth = ((0, 0), (0, 0), (0, max(0, width - self._outcomes.shape[2])))
        if any(growth[2]):
            self._outcomes = np.pad(self._outcomes, growth, constant_values=NO_OUTCOME)
            self._probabilities = np.pad(self._probabilities, growth)

    def _grow_with_space(self) -> None:
        """Extend the tables to the states, groups and actions of the space."""
        states, groups, actions = len(self.space.group), len(self.space.groups), len(self.space.actions)
        if states > len(self._values):
            self._values = np.pad(self._values, (0, states - len(self._values)))
            self._solved = np.pad(self._solved, (0, states - len(self._solved)))
        rows, columns = self._queried_revisions.shape
        if groups > rows or actions > columns:
            growth = ((0, max(0, 2 * groups - rows)), (0, actions - columns))
            self._queried_revisions = np.pad(self._queried_revisions, growth, constant_values=NEVER_QUERIED)
            self._outcomes = np.pad(self._outcomes, (*growth, (0, 0)), constant_values=NO_OUTCOME)
            self._probabilities = np.pad(self._probabilities, (*growth, (0, 0)))
            self._disagreements = np.pad(self._disagreements, growth)
            self._revisions = np.pad(self._revisions, (0, actions - columns))
