"""The registry of the baselines: every entry makes a compiled learner, and the documentation names all learners."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from wherry.baselines.compiled.model_entries import ModelEntries
from wherry.baselines.compiled.tabular import TabularLearner
from wherry.baselines.registry import BASELINES
from wherry.errors import InputError
from wherry.learning.registry import RULE_LEARNERS

ENTRIES = ModelEntries(np.zeros((2, 1, 1), np.int32))
LEARNERS_PAGE = Path(__file__).parents[2] / "docs" / "learners.md"


@dataclass(frozen=True)
class Problem:
    """A problem of two states and one action."""

    network_entries: Mapping[str, ModelEntries] = field(default_factory=dict)
    step_entries: ModelEntries = ENTRIES
    title: str = "a test"


@pytest.mark.parametrize("name", BASELINES)
def test_every_baseline_can_be_made(name: str) -> None:
    learner = BASELINES[name].factory(Problem({"published": ENTRIES, "minimal": ENTRIES}))
    assert isinstance(learner, TabularLearner)
    assert not BASELINES[name].has_rules


def test_factored_rmax_is_refused_without_a_network() -> None:
    with pytest.raises(InputError, match="none is known for a test"):
        BASELINES["factored-rmax"].factory(Problem())


def test_the_documentation_names_every_learner() -> None:
    page = LEARNERS_PAGE.read_text("utf-8")
    assert [name for name in (*RULE_LEARNERS, *BASELINES) if f"`{name}`" not in page] == []
