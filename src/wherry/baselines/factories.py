"""Factories of the compiled baselines, used through `wherry.baselines.registry`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from wherry.baselines.compiled.model_entries import ModelEntries
from wherry.baselines.compiled.q_learning import TabularQLearning
from wherry.baselines.compiled.rmax import TabularRmax
from wherry.errors import InputError


class TabularProblem(Protocol):
    """A problem with numbered states, with the table entries that R-max and Factored R-max learn in it."""

    @property
    def title(self) -> str:
        """Name of the problem in messages."""
        ...

    @property
    def step_entries(self) -> ModelEntries:
        """Table entries of R-max."""
        ...

    @property
    def network_entries(self) -> Mapping[str, ModelEntries]:
        """Table entries of Factored R-max, by the name of its network; empty where no network is known."""
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
