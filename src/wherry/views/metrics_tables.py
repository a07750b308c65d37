"""Labels and formats of metrics: how each value in a command's JSON is printed in its table.

Metrics that identify the run, such as the name of the log, are in the table's title instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

Format = Callable[[Any], str]
"""Formats a value with its unit."""

MetricLabels = Mapping[str, tuple[str, Format]]
"""Label and format of each metric by its key in JSON, in the order of display."""

MIN_DURATION_IN_MINUTES = 60.0  # s


def metres(value: float) -> str:
    """Format a length, m."""
    return f"{value:.3f} m"


def long_metres(value: float) -> str:
    """Format a length of many metres, m."""
    return f"{value:,.1f} m"


def size(value: tuple[float, float]) -> str:
    """Format the size of an area, m."""
    width, height = value
    return f"{width:.1f} × {height:.1f} m"


def square_metres(value: float) -> str:
    """Format an area, m²."""
    return f"{value:,.1f} m²"


def duration(value: float) -> str:
    """Format a duration, s, as minutes and seconds, with hours before them if it has any."""
    if value < MIN_DURATION_IN_MINUTES:
        return f"{value:.1f} s"
    minutes, rest = divmod(round(value), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d} h" if hours else f"{minutes}:{rest:02d} min"


def degrees(value: float) -> str:
    """Format an angle, degrees."""
    return f"{value:.2f}°"


def seconds(value: float) -> str:
    """Format a time, s."""
    return f"{value:.1f} s"


def milliseconds(value: float) -> str:
    """Format a time, ms."""
    return f"{value:.2f} ms"


def percent(value: float) -> str:
    """Format a fraction as a percentage."""
    return f"{100 * value:.1f} %"


def fraction(value: float) -> str:
    """Format a value from 0 to 1."""
    return f"{value:.2f}"


def count(value: float) -> str:
    """Format a count; a mean of counts has one decimal."""
    return f"{value:,}" if isinstance(value, int) else f"{value:,.1f}"


def pose(value: tuple[float, float, float]) -> str:
    """Format a pose (m, m, rad)."""
    x, y, theta = value
    return f"x {x:.2f} m, y {y:.2f} m, heading {math.degrees(theta):.0f}°"


def alternatives(value: Sequence[Mapping[str, Any]]) -> str:
    """Format other poses, each with its odds against the estimated one."""
    return "; ".join(f"{pose(alternative['pose'])} (odds {alternative['odds']:.2g})" for alternative in value) or "none"


def names(value: tuple[str, ...]) -> str:
    """Format a list of names."""
    return ", ".join(value) or "none"


MAP_METRICS: MetricLabels = {
    "size_m": ("size of the map", size),
    "free_area_m2": ("free space", square_metres),
    "resolution_m": ("resolution", metres),
    "distance_m": ("way driven", long_metres),
    "duration_s": ("duration of the log", duration),
    "scans": ("scans mapped", count),
    "skipped": ("malformed lines or messages skipped", count),
    "fit": ("fit of the scans to their map (0 to 1)", fraction),
    "closures_accepted": ("loop closures accepted", count),
    "closures_refused": ("loop closures rejected", count),
    "ms_per_scan_median": ("CPU time per scan (median)", milliseconds),
    "ms_per_scan_p99": ("CPU time per scan (99th percentile)", milliseconds),
    "seconds": ("CPU time in total", seconds),
    "backend": ("method", str),
}
"""Metrics of every mapping run (`wherry.pipelines.logs.mapping`)."""

MAPPING_METRICS: MetricLabels = {
    **MAP_METRICS,
    "relations": ("reference relations", count),
    "translational_error_m": ("translational error (mean)", metres),
    "translational_sd_m": ("translational error (standard deviation)", metres),
    "rotational_error_deg": ("rotational error (mean)", degrees),
    "rotational_sd_deg": ("rotational error (standard deviation)", degrees),
    "far_translational_error_m": ("translational error over more than a minute (mean)", metres),
}
"""Metrics of a mapping run that is scored by reference relations."""

LOCALIZATION_METRICS: MetricLabels = {
    "scans": ("scans", count),
    "skipped": ("malformed lines or messages skipped", count),
    "fit": ("fit of the scans to the map (0 to 1)", fraction),
    "map_coverage": ("beams that end where the map is known", percent),
    "map_probability": ("probability that the map is right", percent),
    "consistent_m": ("longest stretch that fits the map without a jump", long_metres),
    "lost_probability": ("probability of being lost at the end", percent),
    "lost_fraction": ("scans at which the robot was probably lost", percent),
    "relocalizations": ("relocalizations", count),
    "final_pose": ("final pose", pose),
    "alternative_poses": ("other poses that fit as well", alternatives),
    "particles_mean": ("particles (mean)", count),
    "ms_per_update_median": ("time per update (median)", milliseconds),
    "unknown_parameters": ("unknown parameters", names),
    "seed": ("seed", str),
}
"""Metrics of every localization run (`wherry.pipelines.logs.localization`)."""

REFERENCE_METRICS: MetricLabels = {
    "rmse_m": ("position error to the reference (rms)", metres),
    "aligned_rmse_m": ("position error to the reference (rms, aligned)", metres),
    "median_m": ("position error to the reference (median)", metres),
    "p99_m": ("position error to the reference (99th percentile)", metres),
    "reference_scans": ("scans with a reference pose", count),
}
"""Metrics of a localization run with a reference trajectory (`wherry.pipelines.logs.reference`)."""

DRIVE_METRICS: MetricLabels = {
    "distance_m": ("way driven", long_metres),
    "duration_s": ("duration of the log", duration),
}
"""Metrics of the drive of a log (`wherry.pipelines.logs.summary`)."""

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
    "unknown_answers_bound": ("bound by the KWIK theorem", count),
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


def format_metrics(metrics: Mapping[str, object], labels: MetricLabels) -> list[tuple[str, str]]:
    """Label and formatted value of each metric that was measured.

    Args:
        metrics: Values by their keys in JSON; None if not measured.
        labels: Labels and formats of the metrics to show.
    """
    return [
        (label, format_value(metrics[name]))
        for name, (label, format_value) in labels.items()
        if metrics[name] is not None
    ]


def unmeasured_metrics(metrics: Mapping[str, object], labels: MetricLabels) -> list[str]:
    """Labels of the quantities of which no statistic was measured, each once."""
    quantities = {name: label.partition(" (")[0] for name, (label, _) in labels.items()}
    measured = {quantity for name, quantity in quantities.items() if metrics[name] is not None}
    return [quantity for quantity in dict.fromkeys(quantities.values()) if quantity not in measured]
