"""Metrics are printed with labels and units."""

from __future__ import annotations

import pytest
from rich.console import Console

from wherry.views.metrics_tables import LOCALIZATION_METRICS, MAPPING_METRICS, duration, format_metrics
from wherry.views.terminal import print_metrics

MAPPING: dict[str, object] = dict.fromkeys(MAPPING_METRICS) | {
    "backend": "graph",
    "size_m": (28.35, 29.0),
    "free_area_m2": 1412.27,
    "resolution_m": 0.05,
    "distance_m": 505.31,
    "duration_s": 2650.9,
    "scans": 910,
    "skipped": 0,
    "relations": 9998,
    "translational_error_m": 0.0504,
    "translational_sd_m": 0.041,
    "rotational_error_deg": 0.523,
    "ms_per_scan_median": 0.6947,
    "ms_per_scan_p99": 23.36,
    "seconds": 2.061,
}


def test_metrics_are_formatted_with_units() -> None:
    assert format_metrics(MAPPING, MAPPING_METRICS) == [
        ("size of the map", "28.4 × 29.0 m"),
        ("free space", "1,412.3 m²"),
        ("resolution", "0.050 m"),
        ("way driven", "505.3 m"),
        ("duration of the log", "44:11 min"),
        ("scans mapped", "910"),
        ("malformed lines or messages skipped", "0"),
        ("CPU time per scan (median)", "0.69 ms"),
        ("CPU time per scan (99th percentile)", "23.36 ms"),
        ("CPU time in total", "2.1 s"),
        ("method", "graph"),
        ("reference relations", "9,998"),
        ("translational error (mean)", "0.050 m"),
        ("translational error (standard deviation)", "0.041 m"),
        ("rotational error (mean)", "0.52°"),
    ]


def test_a_pose_a_fraction_and_names_are_formatted() -> None:
    metrics: dict[str, object] = dict.fromkeys(LOCALIZATION_METRICS) | {
        "final_pose": (1.24, -0.8441, -2.854),
        "lost_fraction": 0.0125,
        "unknown_parameters": (),
        "alternative_poses": ({"pose": (3.0, 0.5, 0.0), "odds": 0.5},),
        "particles_mean": 1999.96,
    }
    assert dict(format_metrics(metrics, LOCALIZATION_METRICS)) == {
        "final pose": "x 1.24 m, y -0.84 m, heading -164°",
        "scans at which the robot was probably lost": "1.2 %",
        "unknown parameters": "none",
        "other poses that fit as well": "x 3.00 m, y 0.50 m, heading 0° (odds 0.5)",
        "particles (mean)": "2,000.0",
    }


def test_unmeasured_metrics_are_listed_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_metrics(Console(width=100), "Map of a.log", MAPPING | {"rotational_error_deg": None}, MAPPING_METRICS)
    printed = capsys.readouterr().out
    assert "│ translational error (mean) " in printed
    unmeasured = "fit of the scans to their map, loop closures accepted, loop closures rejected"
    line = f"Not measured: {unmeasured}, rotational error, translational error over more than a minute.\n"
    assert line in printed


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0.0 s"), (59.94, "59.9 s"), (60.0, "1:00 min"), (3599.7, "1:00:00 h"), (7384, "2:03:04 h")],
)
def test_durations_are_clock_times_from_a_minute_on(seconds: float, text: str) -> None:
    assert duration(seconds) == text
