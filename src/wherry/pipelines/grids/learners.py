"""All learners for grids: the learners of rules, and the baselines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wherry.baselines.registry import BASELINES
from wherry.learning.registry import RULE_LEARNERS, LearnerEntry

LEARNERS: Mapping[str, LearnerEntry[Any]] = {**RULE_LEARNERS, **BASELINES}
"""The learners of the learning experiment, by name."""
