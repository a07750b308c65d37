"""Predictions and changes of states in words, as shown in games."""

from __future__ import annotations

from dataclasses import dataclass

from wherry.oomdp.attributes import Value
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Prediction
from wherry.oomdp.objects import State

MIN_CERTAIN_PROBABILITY = 0.995  # probability from which a prediction is shown as certain


@dataclass(frozen=True, slots=True)
class PredictionText:
    """A learner's prediction for an action, in words.

    Attributes:
        action: The action.
        changes: Predicted changes; None where the learner does not predict the next state.
        reward: Predicted reward and whether the episode ends; empty where the learner predicts neither.
        probability: Probability of the prediction; None where it is certain or the learner has no probabilities.
    """

    action: Action
    changes: str | None
    reward: str
    probability: float | None


def describe_prediction(
    state: State, action: Action, prediction: Prediction, *, is_probabilistic: bool
) -> PredictionText:
    """Return a prediction in words.

    Args:
        state: State before the action.
        action: The action.
        prediction: The learner's prediction.
        is_probabilistic: Whether the learner's predictions have probabilities.
    """
    outcome = prediction.most_likely
    if outcome.next_state is None:
        return PredictionText(action, None, "", None)
    probability = outcome.probability / sum(other.probability for other in prediction.outcomes)
    reward = [] if outcome.reward is None else [f"{outcome.reward:+g}"]
    reward += ["the end"] if outcome.terminated else []
    return PredictionText(
        action,
        describe_changes(state, outcome.next_state),
        ", ".join(reward),
        probability if is_probabilistic and probability < MIN_CERTAIN_PROBABILITY else None,
    )


def describe_changes(state: State, after: State) -> str:
    """Return the differences between two states: ``taxi.y += 1``, ``box1.in_bot := True``, ``box1 leaves``."""
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
