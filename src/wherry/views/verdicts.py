"""One plain sentence that says how a run over a log ended, before its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wherry.views.metrics_tables import count, duration, long_metres, size, square_metres

POSSIBLE_CAUSES = "The pose of the lidar (--lidar X,Y,θ), the odometry or the stamps may be wrong."


def mapping_verdict(metrics: Mapping[str, Any]) -> str:
    """The verdict on a map.

    Args:
        metrics: Metrics of a mapping run by their names in JSON.
    """
    if metrics["is_doubtful"]:
        return f"The map is doubtful: its own scans do not fit it (fit {metrics['fit']:.2f}). {POSSIBLE_CAUSES}"
    closures = metrics["closures_accepted"]
    return (
        f"A map of {size(metrics['size_m'])} ({square_metres(metrics['free_area_m2'])} free) from "
        f"{_counted(metrics['scans'], 'scan')}: the robot drove {long_metres(metrics['distance_m'])} in "
        f"{duration(metrics['duration_s'])}; {_counted(closures, 'loop')} closed."
    )


def _counted(number: int, noun: str) -> str:
    """A number with its noun."""
    return f"{count(number)} {noun}" if number == 1 else f"{count(number)} {noun}s"
