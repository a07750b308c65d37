"""Loop closures: finding that the robot is where it was before, and refusing to be fooled.

Candidates are old submaps that the robot may be in, as uncertain as its pose is. A closure is accepted only through
three gates: the points fit well (response), no other place in the window fits nearly as well (ambiguity), and the
points on surfaces lie on the submap's (overlap). Whatever is tried is kept with its reason.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wherry.mapping.cloud import Cloud
from wherry.mapping.correlative import Correlation, Window, correlate
from wherry.mapping.refinement import refine
from wherry.mapping.submap import Submap
from wherry.space.pose import Floats, Pose

LEAST_RESPONSE = 0.45
MOST_RIVALRY = 0.90  # share of the best response that another peak may have
LEAST_OVERLAP = 0.6
DEVIATIONS = 3.0  # σ that are searched to either side
LEAST_WINDOW = 0.5  # m
MOST_REFINED = 0.3  # m that the exact match may be away from the place that was found
LEAST_WINDOW_ANGLE = math.radians(4.0)
LARGEST_WINDOW = 8.0  # m
LARGEST_WINDOW_ANGLE = math.radians(40.0)
NUMBERS = re.compile(r":| \d")  # where a reason goes on to its figures
POINTS = 300  # of a cloud, for finding its place
WIDE_WINDOW = 2.0  # m; in wider ones fewer points are used, so that the time does not grow with the area


@dataclass(frozen=True)
class Closure:
    """A loop closure that was tried.

    Attributes:
        time: s, when.
        node: The keyscan whose surroundings were matched.
        target: The keyscan whose submap they were matched to.
        measured: Pose of ``node`` in the frame of ``target``.
        information: [3, 3] of that, in the frame of ``target``.
        response: 0 to 1, mean likelihood of the points.
        rival: 0 to 1, response of the best other peak; an underestimate where it is far off.
        window: m, how far to either side was searched.
        refused: Why it was refused; empty if it was accepted.
    """

    time: float
    node: int
    target: int
    measured: Pose
    information: Floats
    response: float
    rival: float
    window: float
    refused: str

    @property
    def accepted(self) -> bool:
        """Whether it became part of the map."""
        return not self.refused


def search_window(expected: Pose, covariance: Floats) -> Window:
    """Where to look, given where the pose is expected and its covariance [3, 3]."""
    distance = DEVIATIONS * math.sqrt(max(covariance[0, 0], covariance[1, 1]))
    angle = DEVIATIONS * math.sqrt(covariance[2, 2])
    return Window(
        expected,
        float(np.clip(distance, LEAST_WINDOW, LARGEST_WINDOW)),
        float(np.clip(angle, LEAST_WINDOW_ANGLE, LARGEST_WINDOW_ANGLE)),
    )


def try_closure(time: float, node: int, target: int, submap: Submap, cloud: Cloud, window: Window) -> Closure:
    """Match the surroundings of a keyscan to an old submap.

    Args:
        time: s.
        node: The keyscan.
        target: The keyscan in whose frame the submap is.
        submap: To match to.
        cloud: What is around the keyscan, in its frame.
        window: Where it may be. Where the best place lies on its edge, one twice as wide is searched.
    """
    found = _best_place(submap, cloud, window)
    while found.response >= LEAST_RESPONSE and window.on_edge(found.pose) and _widened(window) != window:
        window = _widened(window)  # how uncertain a pose is, is an estimate too
        found = _best_place(submap, cloud, window)
    fine = refine(submap, cloud, found.pose)
    if found.response < LEAST_RESPONSE:
        refused = f"response {found.response:.2f} is below {LEAST_RESPONSE}"
    elif found.rival > MOST_RIVALRY * found.response:
        refused = f"ambiguous: another place has response {found.rival:.2f} beside {found.response:.2f}"
    elif window.on_edge(found.pose):
        refused = "on the window's edge: the best place may lie beyond"
    elif fine.matched < LEAST_OVERLAP:
        refused = f"overlap {fine.matched:.2f} is below {LEAST_OVERLAP}"
    elif fine.pose.distance_to(found.pose) > MOST_REFINED:
        refused = "the exact match left the place that was found"
    else:
        refused = ""
    return Closure(
        time, node, target, fine.pose, fine.information, found.response, found.rival, window.distance, refused
    )


def _best_place(submap: Submap, cloud: Cloud, window: Window) -> Correlation:
    """Where a cloud fits a submap best."""
    points = cloud.thinned(round(POINTS * min(WIDE_WINDOW / window.distance, 1.0))).points
    return correlate(submap, points, window, rivalry=MOST_RIVALRY)


def _widened(window: Window) -> Window:
    """A window twice as wide, as far as windows go."""
    distance, angle = 2.0 * window.distance, 2.0 * window.angle
    return Window(window.centre, min(distance, LARGEST_WINDOW), min(angle, LARGEST_WINDOW_ANGLE))


def refusals(closures: Sequence[Closure]) -> Mapping[str, int]:
    """How many closures each gate refused, the strictest gate first."""
    gates = (NUMBERS.split(closure.refused)[0].strip() for closure in closures if closure.refused)
    return dict(Counter(gates).most_common())
