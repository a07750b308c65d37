"""Makes the compiled baselines for a problem of numbered states; called through `wherry.baselines.registry`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from wherry.baselines.compiled.model_entries import ModelEntries
from wherry.baselines.compiled.q_learning import TabularQLearning
from wherry.baselines.compiled.rmax import TabularRmax
from wherry.errors import InputError


class TabularProblem(Protocol):
    """What compiled learners are made for."""

    @property
    def title(self) -> str:
        """Name of the problem, for people."""
        ...

    @property
    def step_entries(self) -> ModelEntries:
        """Entries of R-max."""
        ...

    @property
    def network_entries(self) -> Mapping[str, ModelEntries]:
        """Entries of Factored R-max, by the name of the network that it is given; empty where none is known."""
        ...


def rmax(problem: TabularProblem) -> TabularRmax:
    """Make R-max."""
    return TabularRmax(problem.step_entries)


def factored_rmax(problem: TabularProblem, *, network: str) -> TabularRmax:
    """Make Factored R-max with one of the problem's networks.

    Raises:
        InputError: The problem has no such network.
    """
    if network not in problem.network_entries:
        raise InputError(
            "--learner", "factored-rmax", f"needs a network of dependencies, and none is known for {problem.title}"
        )
    return TabularRmax(problem.network_entries[network])


def q_learning(_problem: TabularProblem, **options: Any) -> TabularQLearning:
    """Make Q-learning; options are those of `TabularQLearning`."""
    return TabularQLearning(**options)
