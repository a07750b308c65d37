"""Trace records of the symbolic half, which deliveries and grids share."""

from __future__ import annotations

from wherry.learning.rules import RuleLearner
from wherry.oomdp.domain import Domain
from wherry.oomdp.objects import State
from wherry.trace.records import LearntModel, LearntRule, ObjectSnapshot, PerceivedState


def perceived_state(domain: Domain, state: State, time: float) -> PerceivedState:
    """The record of a state's condition and of its objects that can change, at a time, s, on the robot's clock."""
    objects = (
        ObjectSnapshot(
            item.object_class.name, item.name, tuple(zip(item.object_class.attribute_indexes, item.values, strict=True))
        )
        for item in state.objects
    )
    return PerceivedState(time, str(domain.cond(state)), tuple(objects))


def learnt_model(learner: RuleLearner, time: float) -> LearntModel:
    """The record of everything learnt so far, at a time, s, on the robot's clock."""
    rules = tuple(LearntRule(rule.action, str(rule.condition), rule.effect) for rule in learner.rules())
    failures = learner.failure_conditions().items()
    return LearntModel(time, rules, tuple((action, tuple(map(str, conditions))) for action, conditions in failures))
