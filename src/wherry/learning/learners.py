"""The learners that keep what they learn as rules, by the names that users choose them with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from wherry.learning.bayes import BayesianLearner
from wherry.learning.doormax import Doormax
from wherry.learning.sentences import Rule
from wherry.oomdp.conditional_models import ConditionalModel
from wherry.oomdp.conditions import Condition
from wherry.oomdp.mdp import Learner


class RuleLearner(ConditionalModel, Learner, Protocol):
    """A learner whose knowledge is rules: it can be put into words, saved, and used in other worlds."""

    def rules(self) -> tuple[Rule, ...]:
        """What was learnt of what actions do."""
        ...

    def failure_conditions(self) -> dict[str, tuple[Condition, ...]]:
        """For each action, the conditions in which it is known to do nothing."""
        ...

    def sentences(self) -> tuple[str, ...]:
        """What was learnt, in words: ``N: if not touch_N(taxi, wall): taxi.y += 1``."""
        ...


LEARNERS: Mapping[str, Callable[..., RuleLearner]] = {"bayes": BayesianLearner, "doormax": Doormax}
"""Each takes the domain, and ``reward`` and ``terminated`` where these are given."""
