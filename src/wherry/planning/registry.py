"""The registry of planners.

A new planner needs its own file, an entry here, and a row in ``docs/planners.md``. `wherry.planning.search` finds
plans to a goal instead of policies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.planning.lrtdp import Lrtdp
from wherry.planning.planner import Planner
from wherry.planning.policy_iteration import PolicyIteration
from wherry.planning.uct import Uct
from wherry.planning.value_iteration import ValueIteration


class PlannerFactory(Protocol):
    """Makes a planner on a model; planners without random numbers ignore the generator."""

    def __call__(
        self, model: ConditionalModel, rng: np.random.Generator, *, discount: float = 0.95, r_max: float = 20.0
    ) -> Planner:
        """Make a planner with discount γ and highest reward R_max."""
        ...


@dataclass(frozen=True)
class PlannerEntry:
    """A planner that users can choose.

    Attributes:
        make: Makes the planner.
        summary: The algorithm in one line.
        suited_for: The models for which it is a good choice.
    """

    make: PlannerFactory
    summary: str
    suited_for: str


def _ignoring_rng(planner: Callable[..., Planner]) -> PlannerFactory:
    """The factory of a planner that draws no random numbers."""

    def make(
        model: ConditionalModel, rng: np.random.Generator, *, discount: float = 0.95, r_max: float = 20.0
    ) -> Planner:
        return planner(model, discount=discount, r_max=r_max)

    return make


PLANNERS: Mapping[str, PlannerEntry] = {
    "value-iteration": PlannerEntry(
        _ignoring_rng(ValueIteration),
        summary="compiled value sweeps over all reachable states",
        suited_for="learning: it replans fastest after a revision of the model",
    ),
    "policy-iteration": PlannerEntry(
        _ignoring_rng(PolicyIteration),
        summary="exact policy evaluation alternating with greedy improvement",
        suited_for="reference values, exact up to rounding",
    ),
    "lrtdp": PlannerEntry(
        Lrtdp,
        summary="heuristic search along greedy trials, optimal for the queried states",
        suited_for="large state spaces, if an optimal policy visits few of the states",
    ),
    "uct": PlannerEntry(
        Uct,
        summary="Monte Carlo tree search, approximate, anytime",
        suited_for="state spaces too large to enumerate",
    ),
}
"""The planners by the names with which users choose them."""
