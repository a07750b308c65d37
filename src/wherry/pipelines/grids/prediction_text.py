"""Predictions and changes of states in words, for players."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.oomdp.attributes import Value
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Prediction
from wherry.oomdp.objects import State

CERTAIN = 0.995  # probability from which on a prediction is shown without one
UNKNOWN_WORD = "UNKNOWN"


@dataclass(frozen=True, slots=True)
class PredictionText:
    """What a learner predicts of an action, in words.

    Attributes:
        action: The action.
        changes: Predicted changes; `UNKNOWN_WORD` where the learner cannot tell.
        reward: Predicted reward and whether the episode ends; empty where that is not known.
        probability: Probability of the prediction; None where it is certain or has none.
    """

    action: Action
    changes: str
    reward: str
    probability: float | None


def describe_prediction(
    state: State, action: Action, prediction: Prediction, *, is_probabilistic: bool
) -> PredictionText:
    """Return a prediction in words.

    Args:
        state: State in which the action would be done.
        action: The action.
        prediction: What the learner predicts.
        is_probabilistic: Whether the learner's probabilities are worth showing.
    """
    outcome = prediction.most_likely
    if outcome.next_state is None:
        return PredictionText(action, UNKNOWN_WORD, "", None)
    probability = outcome.probability / sum(other.probability for other in prediction.outcomes)
    reward = [] if outcome.reward is None else [f"{outcome.reward:+g}"]
    reward += ["the end"] if outcome.terminated else []
    return PredictionText(
        action,
        describe_changes(state, outcome.next_state),
        ", ".join(reward),
        probability if is_probabilistic and probability < CERTAIN else None,
    )


def describe_changes(state: State, after: State) -> str:
    """Return what differs between two states: ``taxi.y += 1``, ``box1.in_bot := True``, ``box1 leaves``."""
    parts = []
    for item in state.objects:
        later = after.get(item.name)
        if later is None:
            parts.append(f"{item.name} leaves")
            continue
        for attribute, old, new in zip(item.object_class.attributes, item.values, later.values, strict=True):
            if old != new:
                parts.append(_describe_change(f"{item.name}.{attribute.name}", old, new))
    return ", ".join(parts) or "nothing changes"


def _describe_change(name: str, old: Value, new: Value) -> str:
    if isinstance(old, bool | str) or isinstance(new, bool | str):
        return f"{name} := {new}"
    return f"{name} {'+' if new > old else '-'}= {abs(new - old)}"
