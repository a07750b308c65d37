"""R-max and Factored R-max on numbered states, compiled.

They are tested step by step against `wherry.baselines.rmax` and `wherry.baselines.factored_rmax` with value iteration.
They are fast because values are kept: after a step only those are recomputed that depended on what was unknown before
(`wherry.baselines.compiled.rmax_kernels`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wherry.baselines.compiled.model_entries import NONE, ModelEntries
from wherry.baselines.compiled.rmax_kernels import RmaxKnowledge, RmaxProblem, count_solved, run_episode
from wherry.baselines.compiled.tabular import EpisodeBatch, Integers, TabularLearner, TabularMdp


@dataclass(frozen=True, slots=True)
class TabularRmax(TabularLearner):
    """R-max (Brafman and Tennenholtz 2002) with m = 1, factored or not, depending on its entries.

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
            raise ValueError(f"R_max is {self.r_max:g}, and a step is worth {mdp.reward.max():g}")
        problem = self._problem(mdp)
        knowledge = _nothing_known(problem)
        while True:
            start = int(rng.integers(mdp.start_count))
            began = time.thread_time()
            steps = run_episode(start, max_episode_steps, problem, knowledge)
            solved = count_solved(probes, problem, knowledge)
            yield [(steps, solved)], time.thread_time() - began

    def _problem(self, mdp: TabularMdp) -> RmaxProblem:
        required = self.entries.required
        leads_on = ~mdp.terminates & (mdp.successor != np.arange(len(mdp.successor))[:, None])
        steps, uses = np.flatnonzero(leads_on), np.flatnonzero(required != NONE)
        first_predecessor, step_order = _group(mdp.successor.ravel()[steps], len(mdp.successor))
        first_user, use_order = _group(required.ravel()[uses], int(required.max()) + 1)
        return RmaxProblem(
            mdp.successor,
            mdp.reward,
            mdp.terminates,
            first_predecessor,
            steps[step_order].astype(np.int32),
            required,
            first_user,
            (uses[use_order] // required.shape[2]).astype(np.int32),
            self.discount,
            self.r_max / (1 - self.discount),  # as value iteration computes it, to the last bit
            min(0.0, float(mdp.reward.min())) / (1 - self.discount),
            self.tolerance,
        )


def _group(keys: Integers, count: int) -> tuple[Integers, NDArray[np.intp]]:
    """Return where the items of each of K keys begin in the list sorted by keys, [K + 1], and the sorting order."""
    order = np.argsort(keys, kind="stable")
    return np.searchsorted(keys[order], np.arange(count + 1)).astype(np.int32), order


def _nothing_known(problem: RmaxProblem) -> RmaxKnowledge:
    states = len(problem.successor)
    return RmaxKnowledge(
        is_filled=np.zeros(len(problem.first_user) - 1, np.bool_),
        missing=np.count_nonzero(problem.required != NONE, axis=2).astype(np.int32),
        values=np.full(states, problem.v_max),
        queue=np.empty(states, np.int32),
        is_queued=np.zeros(states, np.bool_),
    )
