"""Metrics as people read them: a label for each name in JSON, and values with units.

Each table lists its metrics in the order of display; what the table's title says already is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

Format = Callable[[Any], str]
MetricLabels = Mapping[str, tuple[str, Format]]


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


def percent(value: float) -> str:
    """A fraction as a percentage."""
    return f"{100 * value:.1f} %"


def count(value: float) -> str:
    """A count; a mean of counts has one decimal."""
    return f"{value:,}" if isinstance(value, int) else f"{value:,.1f}"


def pose(value: tuple[float, float, float]) -> str:
    """A pose (x m, y m, θ rad)."""
    x, y, theta = value
    return f"x {x:.2f} m, y {y:.2f} m, heading {math.degrees(theta):.0f}°"


def names(value: tuple[str, ...]) -> str:
    """A list of names."""
    return ", ".join(value) or "none"


MAPPING_METRICS: MetricLabels = {
    "backend": ("method", str),
    "scans": ("scans mapped", count),
    "skipped": ("broken lines skipped", count),
    "relations": ("reference relations", count),
    "translational_error_m": ("translational error (mean)", metres),
    "translational_sd_m": ("translational error (standard deviation)", metres),
    "rotational_error_deg": ("rotational error (mean)", degrees),
    "rotational_sd_deg": ("rotational error (standard deviation)", degrees),
    "far_translational_error_m": ("translational error over more than a minute (mean)", metres),
    "closures_accepted": ("loop closures accepted", count),
    "closures_refused": ("loop closures rejected", count),
    "ms_per_scan_median": ("CPU time per scan (median)", milliseconds),
    "ms_per_scan_p99": ("CPU time per scan (99th percentile)", milliseconds),
    "seconds": ("CPU time in total", seconds),
}
"""Metrics of a mapping run (`wherry.pipelines.logs.mapping`)."""

LOCALIZATION_METRICS: MetricLabels = {
    "scans": ("scans", count),
    "skipped": ("broken lines skipped", count),
    "rmse_m": ("position error to the reference (rms)", metres),
    "median_m": ("position error to the reference (median)", metres),
    "p99_m": ("position error to the reference (99th percentile)", metres),
    "lost_fraction": ("scans at which the robot was probably lost", percent),
    "relocalizations": ("relocalizations", count),
    "final_pose": ("final pose", pose),
    "particles_mean": ("particles (mean)", count),
    "ms_per_update_median": ("CPU time per update (median)", milliseconds),
    "unknown_parameters": ("unknown parameters", names),
    "seed": ("seed", str),
}
"""Metrics of a localization run (`wherry.pipelines.logs.localization`)."""

LEARNING_METRICS: MetricLabels = {
    "learner": ("learner", str),
    "seed": ("seed", str),
    "repetitions": ("repetitions", count),
    "converged": ("repetitions that converged to an optimal policy", count),
    "steps_mean": ("steps to convergence (mean)", count),
    "steps_sd": ("steps to convergence (standard deviation)", count),
    "steps_p95": ("steps to convergence (95th percentile)", count),
    "ms_per_step": ("time per step (median)", milliseconds),
    "unknown_answers": ("predictions “I don't know” (maximum)", count),
    "unknown_answers_bound": ("bound on them by the KWIK theorem", count),
}
"""Metrics of a learning run (`wherry.pipelines.grids.learning`)."""

ROS_TRAFFIC_METRICS: MetricLabels = {
    "scans": ("scans", count),
    "scans missing": ("scans missing", count),
    "odometry": ("odometry messages", count),
    "odometry missing": ("odometry messages missing", count),
    "velocities": ("velocity commands", count),
    "scans answered": ("scans answered by a velocity command", count),
    "scan to velocity, median, ms": ("latency from scan to velocity command (median)", milliseconds),
    "scan to velocity, 99 %, ms": ("latency from scan to velocity command (99th percentile)", milliseconds),
}
"""Metrics of ROS traffic (`wherry.ros.nodes.monitor.Monitor`)."""

REJECTION_LABELS = {
    "response": "the match score is too low",
    "ambiguous": "the second-best score is too close to the best",
    "overlap": "too few beams are inliers",
}
"""Labels of the reasons for which `wherry.mapping.closures` rejects loop closures."""


def format_metrics(metrics: Mapping[str, object], labels: MetricLabels) -> list[tuple[str, str]]:
    """Label and formatted value of each metric that was measured.

    Args:
        metrics: Values by their names in JSON; None where not measured.
        labels: Labels and formats, in the order of display.
    """
    return [(label, show(metrics[name])) for name, (label, show) in labels.items() if metrics[name] is not None]


def unmeasured_metrics(metrics: Mapping[str, object], labels: MetricLabels) -> list[str]:
    """Labels of the metrics that were not measured; statistics of one quantity are listed once."""
    unmeasured = (label for name, (label, _) in labels.items() if metrics[name] is None)
    return list(dict.fromkeys(label.partition(" (")[0] for label in unmeasured))
