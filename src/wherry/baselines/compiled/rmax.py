"""Compiled R-max and Factored R-max on numbered states.

They are tested step by step against `wherry.baselines.rmax` and `wherry.baselines.factored_rmax` with value iteration.
Values are kept between steps: after a step becomes known, only the values that depended on it are recomputed
(`wherry.baselines.compiled.rmax_kernels`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.baselines.compiled.model_entries import PADDING, ModelEntries
from wherry.baselines.compiled.rmax_kernels import RmaxKnowledge, RmaxProblem, count_solved, run_episode
from wherry.baselines.compiled.tabular import EpisodeBatch, Integers, TabularLearner, TabularMdp


@dataclass(frozen=True, slots=True)
class TabularRmax(TabularLearner):
    """R-max (Brafman and Tennenholtz 2002) with m = 1; factored if the entries are those of a network.

    Attributes:
        entries: Entries of the model's tables.
        discount: γ.
        r_max: R_max, an upper bound of the reward of a step.
        tolerance: ε, precision of the values.
    """

    entries: ModelEntries
    discount: float = 0.95
    r_max: float = 20.0
    tolerance: float = 1e-6

    def batches(
        self, mdp: TabularMdp, probes: Integers, rng: np.random.Generator, *, max_episode_steps: int
    ) -> Iterator[EpisodeBatch]:
        """Learn as `TabularLearner.batches` says, in batches of one episode.

        Raises:
            ValueError: A reward is larger than R_max, so that R_max would not be optimistic.
        """
        if mdp.reward.max() > self.r_max:
            raise ValueError(f"R_max is {self.r_max:g}, but a step has the reward {mdp.reward.max():g}")
        problem = self._problem(mdp)
        knowledge = _initial_knowledge(problem)
        while True:
            start = int(rng.integers(mdp.start_count))
            began = time.thread_time()
            steps = run_episode(start, max_episode_steps, problem, knowledge)
            solved = count_solved(probes, problem, knowledge)
            yield [(steps, solved)], time.thread_time() - began

    def _problem(self, mdp: TabularMdp) -> RmaxProblem:
        required = self.entries.required
        changes_state = ~mdp.terminates & (mdp.successor != np.arange(len(mdp.successor))[:, None])
        steps, requirements = np.flatnonzero(changes_state), np.flatnonzero(required != PADDING)
        first_predecessor, predecessor_order = _group(mdp.successor.ravel()[steps], len(mdp.successor))
        first_user, user_order = _group(required.ravel()[requirements], int(required.max()) + 1)
        return RmaxProblem(
            successor=mdp.successor,
            reward=mdp.reward,
            terminates=mdp.terminates,
            first_predecessor=first_predecessor,
            predecessors=steps[predecessor_order].astype(np.int32),
            required=required,
            first_user=first_user,
            users=(requirements[user_order] // required.shape[2]).astype(np.int32),
            discount=self.discount,
            v_max=self.r_max / (1 - self.discount),  # bit for bit as value iteration computes it
            lower_bound=min(0.0, float(mdp.reward.min())) / (1 - self.discount),
            tolerance=self.tolerance,
        )


def _group(keys: Integers, count: int) -> tuple[Integers, NDArray[np.intp]]:
    """Group items by key.

    Args:
        keys: [N] key of every item.
        count: K, number of keys.

    Returns:
        Index of the first item of each key in the sorted order, followed by N, [K + 1]; and the sorted order, [N].
    """
    order = np.argsort(keys, kind="stable")
    return np.searchsorted(keys[order], np.arange(count + 1)).astype(np.int32), order


def _initial_knowledge(problem: RmaxProblem) -> RmaxKnowledge:
    """Return tables without filled entries, and values that are all V(s_max)."""
    states = len(problem.successor)
    return RmaxKnowledge(
        is_filled=np.zeros(len(problem.first_user) - 1, np.bool_),
        missing=np.count_nonzero(problem.required != PADDING, axis=2).astype(np.int32),
        values=np.full(states, problem.v_max),
        queue=np.empty(states, np.int32),
        is_queued=np.zeros(states, np.bool_),
    )
