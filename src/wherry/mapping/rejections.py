"""Reasons for rejecting loop closures, and their explanations in graph.npz and closures.txt."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType


class Rejection(Enum):
    """The gate that rejected a loop closure; the value is the reason in plain words."""

    LOW_SCORE = "the match score is too low"
    AMBIGUOUS = "the second-best score is too close to the best"
    ON_WINDOW_EDGE = "the best pose is on the edge of the search window"
    LOW_OVERLAP = "too few points are inliers"
    REFINEMENT_DIVERGED = "the refined pose is too far from the one that was found by search"


# The wording is part of the file formats, in which a score is a response and a pose is a place.
EXPLANATIONS: Mapping[Rejection, str] = MappingProxyType(
    {
        Rejection.LOW_SCORE: "response {score:.2f} is below {min_score}",
        Rejection.AMBIGUOUS: "ambiguous: another place has response {second_best_score:.2f} beside {score:.2f}",
        Rejection.ON_WINDOW_EDGE: "on the window's edge: the best place may lie beyond",
        Rejection.LOW_OVERLAP: "overlap {overlap:.2f} is below {min_overlap}",
        Rejection.REFINEMENT_DIVERGED: "the exact match left the place that was found",
    }
)


def rejection_of(explanation: str) -> Rejection | None:
    """The reason that an explanation gives; None for an empty one.

    Raises:
        ValueError: The explanation gives no reason.
    """
    if not explanation:
        return None
    for reason, text in EXPLANATIONS.items():
        if explanation.startswith(text.partition("{")[0]):
            return reason
    raise ValueError(f"{explanation!r} is no reason for a rejection")
