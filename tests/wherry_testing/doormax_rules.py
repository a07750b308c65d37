"""The rules that DOORMAX has learnt, in a form that tests can compare."""

from __future__ import annotations

from wherry.learning.doormax import Doormax
from wherry.learning.effect_rules import Subject


def conditions_by_argument(doormax: Doormax, subject: Subject, effect_type: str) -> dict[object, str]:
    """Return the condition of every effect of one type, by the effect's argument."""
    models = doormax.effect_rules.models[subject].get(effect_type, {})
    return {effect.argument: str(condition) for effect, condition in models.items()}
