"""The registry of the baselines, with entries of the same type as those of the learners of rules.

Baselines learn no rules. Experiments run them on numbered states, so their entries make the compiled learners.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

from wherry.learning.registry import LearnerEntry

if TYPE_CHECKING:
    from wherry.baselines.compiled.tabular import TabularLearner
    from wherry.baselines.factories import TabularProblem


class BaselineFactory(Protocol):
    """Makes a compiled learner for a problem."""

    def __call__(self, problem: TabularProblem) -> TabularLearner:
        """Make a learner without knowledge."""
        ...


_RMAX = "wherry.baselines.factories:rmax"
_FACTORED_RMAX = "wherry.baselines.factories:factored_rmax"
_Q_LEARNING = "wherry.baselines.factories:q_learning"

BASELINES: Mapping[str, LearnerEntry[BaselineFactory]] = {
    "factored-rmax": LearnerEntry(
        "a table for each variable, given the published network",
        _FACTORED_RMAX,
        options={"network": "published"},
    ),
    "factored-rmax-minimal": LearnerEntry(
        "a table for each variable, given the smallest correct network",
        _FACTORED_RMAX,
        options={"network": "minimal"},
    ),
    "rmax": LearnerEntry("an optimistic model of every state and action", _RMAX),
    "q-learning": LearnerEntry("a value for every state and action, explored ε-greedily", _Q_LEARNING),
    "q-learning-optimistic": LearnerEntry(
        "a value for every state and action, explored by optimistic initial values",
        _Q_LEARNING,
        options={"exploration": 0.0, "initial_value": 20.0},  # 20 is an upper bound of the return in Taxi
    ),
}
"""The baselines, by the names used on the command line."""
