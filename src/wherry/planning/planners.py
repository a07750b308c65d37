"""The planners that make policies, by the names that users choose them with.

To find a plan to a goal instead, on a deterministic model, see `wherry.planning.search`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from wherry.oomdp.conditional_models import ConditionalModel
from wherry.planning.lrtdp import Lrtdp
from wherry.planning.policy import Planner
from wherry.planning.policy_iteration import PolicyIteration
from wherry.planning.uct import Uct
from wherry.planning.value_iteration import ValueIteration


class PlannerMaker(Protocol):
    """Makes a planner on a model; only those that draw at random use the generator."""

    def __call__(
        self, model: ConditionalModel, rng: np.random.Generator, *, discount: float = 0.95, r_max: float = 20.0
    ) -> Planner:
        """Make one."""
        ...


def _value_iteration(
    model: ConditionalModel, rng: np.random.Generator, *, discount: float = 0.95, r_max: float = 20.0
) -> Planner:
    return ValueIteration(model, discount=discount, r_max=r_max)


def _policy_iteration(
    model: ConditionalModel, rng: np.random.Generator, *, discount: float = 0.95, r_max: float = 20.0
) -> Planner:
    return PolicyIteration(model, discount=discount, r_max=r_max)


PLANNERS: Mapping[str, PlannerMaker] = {
    "value-iteration": _value_iteration,
    "policy-iteration": _policy_iteration,
    "lrtdp": Lrtdp,
    "uct": Uct,
}
"""Each takes the model and a random generator, and ``discount`` (γ) and ``r_max`` (R_max) by name."""
