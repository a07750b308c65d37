"""Trace records of states and learnt models, for deliveries and grid worlds."""

from __future__ import annotations

from wherry.learning.rules import RuleLearner
from wherry.oomdp.domain import Domain
from wherry.oomdp.objects import State
from wherry.trace.records import LearntModel, LearntRule, ObjectSnapshot, PerceivedState


def perceived_state(domain: Domain, state: State, time: float) -> PerceivedState:
    """Record a state: its condition and its non-static objects.

    Args:
        domain: The domain of the state.
        state: The state.
        time: Time of the state, s, robot's clock.
    """
    objects = (
        ObjectSnapshot(
            item.object_class.name, item.name, tuple(zip(item.object_class.attribute_indexes, item.values, strict=True))
        )
        for item in state.objects
    )
    return PerceivedState(time, str(domain.cond(state)), tuple(objects))


def learnt_model(learner: RuleLearner, time: float) -> LearntModel:
    """Record the learnt rules and failure conditions.

    Args:
        learner: The learner.
        time: Time of the record, s, robot's clock.
    """
    rules = tuple(LearntRule(rule.action, str(rule.condition), rule.effect) for rule in learner.rules())
    failures = learner.failure_conditions().items()
    return LearntModel(time, rules, tuple((action, tuple(map(str, conditions))) for action, conditions in failures))
