"""Figures as people read them: words for the names that JSON has, and values with their units.

Each table lists the figures in the order in which people are shown them; what is in the table's title anyway is left
out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

Show = Callable[[Any], str]
Words = Mapping[str, tuple[str, Show]]


def metres(value: float) -> str:
    """A length in m."""
    return f"{value:.3f} m"


def degrees(value: float) -> str:
    """An angle in degrees."""
    return f"{value:.2f}°"


def seconds(value: float) -> str:
    """A time in s."""
    return f"{value:.1f} s"


def milliseconds(value: float) -> str:
    """A time in ms."""
    return f"{value:.2f} ms"


def share(value: float) -> str:
    """A part of 1."""
    return f"{100 * value:.1f} %"


def count(value: float) -> str:
    """A number of things; means of them have a decimal."""
    return f"{value:,}" if isinstance(value, int) else f"{value:,.1f}"


def pose(value: tuple[float, float, float]) -> str:
    """A place: x m, y m, θ rad."""
    x, y, theta = value
    return f"x {x:.2f} m, y {y:.2f} m, heading {math.degrees(theta):.0f}°"


def listed(value: tuple[str, ...]) -> str:
    """Names."""
    return ", ".join(value) or "none"


MAPPING: Words = {
    "backend": ("method", str),
    "scans": ("scans mapped", count),
    "skipped": ("broken lines left out", count),
    "relations": ("true relations to score by", count),
    "translational_error_m": ("translational error (mean)", metres),
    "translational_sd_m": ("translational error (standard deviation)", metres),
    "rotational_error_deg": ("rotational error (mean)", degrees),
    "rotational_sd_deg": ("rotational error (standard deviation)", degrees),
    "far_translational_error_m": ("translational error over more than a minute (mean)", metres),
    "closures_accepted": ("loops closed", count),
    "closures_refused": ("loops tried and refused", count),
    "ms_per_scan_median": ("processor time a scan (median)", milliseconds),
    "ms_per_scan_p99": ("processor time a scan (99th percentile)", milliseconds),
    "seconds": ("processor time in all", seconds),
}
"""Of `wherry.pipelines.logs.mapping.Result`."""

LOCALIZATION: Words = {
    "scans": ("scans", count),
    "skipped": ("broken lines left out", count),
    "rmse_m": ("distance to the reference (rms)", metres),
    "median_m": ("distance to the reference (median)", metres),
    "p99_m": ("distance to the reference (99th percentile)", metres),
    "lost_fraction": ("scans at which it was probably lost", share),
    "relocalizations": ("times that it looked for itself anew", count),
    "final_pose": ("where it ended", pose),
    "particles_mean": ("particles (mean)", count),
    "ms_per_update_median": ("time an update (median)", milliseconds),
    "unknown_parameters": ("unknown parameters", listed),
    "seed": ("seed", str),
}
"""Of `wherry.pipelines.logs.localization.LocalizationResult`."""

LEARNING: Words = {
    "learner": ("learner", str),
    "seed": ("seed", str),
    "repetitions": ("repetitions", count),
    "converged": ("repetitions that became optimal", count),
    "steps_mean": ("steps until then (mean)", count),
    "steps_sd": ("steps until then (standard deviation)", count),
    "steps_p95": ("steps until then (95th percentile)", count),
    "ms_per_step": ("time a step (median)", milliseconds),
    "unknown_answers": ("answers “I do not know” (most)", count),
    "unknown_answers_bound": ("how many the theorem allows", count),
}
"""Of `wherry.pipelines.grids.learning.Result`."""

HEARD: Words = {
    "scans": ("scans", count),
    "scans missing": ("scans missing", count),
    "odometry": ("odometry", count),
    "odometry missing": ("odometry missing", count),
    "velocities": ("velocities", count),
    "scans answered": ("scans that a velocity answered", count),
    "scan to velocity, median, ms": ("from a scan to its velocity (median)", milliseconds),
    "scan to velocity, 99 %, ms": ("from a scan to its velocity (99th percentile)", milliseconds),
}
"""Of `wherry.ros.nodes.monitor.Monitor`."""

REFUSALS = {
    "response": "the points fit too badly",
    "ambiguous": "another place fits nearly as well",
    "overlap": "too few points lie on surfaces that were there",
}
"""The gates at which `wherry.mapping.closures` refuses loops; its other reasons are words already."""


def in_words(figures: Mapping[str, object], words: Words) -> list[tuple[str, str]]:
    """What was measured, in words and with units.

    Args:
        figures: By their names in JSON; None for what was not measured.
        words: What to call them, and how to show them.

    Returns:
        Words and value, in the order of ``words``.
    """
    return [(text, show(figures[name])) for name, (text, show) in words.items() if figures[name] is not None]


def not_measured(figures: Mapping[str, object], words: Words) -> list[str]:
    """Words for what could not be measured, each once, however many figures would tell of it."""
    lacking = (text for name, (text, _) in words.items() if figures[name] is None)
    return list(dict.fromkeys(text.partition(" (")[0] for text in lacking))
