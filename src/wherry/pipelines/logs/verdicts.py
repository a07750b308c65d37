"""One sentence that says whether a log's scans fit the map and whether the robot knows where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

from wherry.localization.fit import MapFit
from wherry.localization.localizer import Localization
from wherry.localization.parameters import LOST_PROBABILITY_THRESHOLD
from wherry.space.pose import Pose

GOOD_FIT = 0.85  # fit from which a map agrees with the scans in all parts
EQUAL_MIN_ODDS = 0.25  # odds of a rival against the estimate from which both are reported as fitting equally
MAX_LISTED = 3  # poses that are listed


@dataclass(frozen=True, slots=True)
class RivalPose:
    """Another pose at the last scan that the run fits.

    Attributes:
        pose: Pose of base_link, x m, y m, θ rad, map frame.
        odds: Odds of this pose against the estimated one.
    """

    pose: tuple[float, float, float]
    odds: float


def rival_poses(localization: Localization) -> tuple[RivalPose, ...]:
    """The poses that the run fits about as well as the estimated one, the most probable first."""
    found = []
    for rival in localization.rivals:
        odds = math.exp(rival.log_odds)
        if odds >= EQUAL_MIN_ODDS:
            x, y, theta = rival.pose.as_array().tolist()
            found.append(RivalPose((x, y, theta), odds))
    return tuple(found)


def localization_verdict(fit: MapFit, last: Localization, *, is_global: bool) -> str:
    """The verdict on a localization run.

    Args:
        fit: How well all scans fit the map.
        last: Localization at the last scan.
        is_global: Whether the whole map was searched for the start.
    """
    hint = "" if is_global else " If it is the right map, the start pose is wrong: --global searches the whole map."
    if not fit.is_fitting:
        return f"These scans do not fit this map: {fit.mismatch}.{hint}"
    fits = f"The scans fit the map (fit {fit.value:.2f})"
    if fit.value < GOOD_FIT:
        fits = f"The scans fit the map only in part (fit {fit.value:.2f}): it may be old, mirrored or at a wrong scale"
    rivals = rival_poses(last)
    if rivals:
        poses = [last.pose, *(Pose(*rival.pose) for rival in rivals)]
        more = f" and {len(poses) - MAX_LISTED} more" if len(poses) > MAX_LISTED else ""
        listed = ", ".join(map(_text, poses[:MAX_LISTED])) + more
        return f"{fits}, but {len(poses)} poses fit equally: {listed}."
    if last.lost_probability > LOST_PROBABILITY_THRESHOLD:
        return f"{fits}, but the robot is probably lost at the end (probability {last.lost_probability:.2f})."
    return f"{fits}, and the robot is localized (probability of being lost {last.lost_probability:.2f})."


def _text(pose: Pose) -> str:
    """A pose in words."""
    return f"x {pose.x:.2f} m, y {pose.y:.2f} m, {math.degrees(pose.theta):.0f}°"
