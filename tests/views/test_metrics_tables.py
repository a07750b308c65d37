"""Metrics are printed with labels and units."""

from __future__ import annotations

import pytest
from rich.console import Console

from wherry.views.metrics_tables import LOCALIZATION_METRICS, MAPPING_METRICS, format_metrics
from wherry.views.terminal import print_metrics

MAPPING: dict[str, object] = dict.fromkeys(MAPPING_METRICS) | {
    "backend": "graph",
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
        ("method", "graph"),
        ("scans mapped", "910"),
        ("malformed lines skipped", "0"),
        ("reference relations", "9,998"),
        ("translational error (mean)", "0.050 m"),
        ("translational error (standard deviation)", "0.041 m"),
        ("rotational error (mean)", "0.52°"),
        ("CPU time per scan (median)", "0.69 ms"),
        ("CPU time per scan (99th percentile)", "23.36 ms"),
        ("CPU time in total", "2.1 s"),
    ]


def test_a_pose_a_fraction_and_names_are_formatted() -> None:
    metrics: dict[str, object] = dict.fromkeys(LOCALIZATION_METRICS) | {
        "final_pose": (1.24, -0.8441, -2.854),
        "lost_fraction": 0.0125,
        "unknown_parameters": (),
        "particles_mean": 1999.96,
    }
    assert dict(format_metrics(metrics, LOCALIZATION_METRICS)) == {
        "final pose": "x 1.24 m, y -0.84 m, heading -164°",
        "scans at which the robot was probably lost": "1.2 %",
        "unknown parameters": "none",
        "particles (mean)": "2,000.0",
    }


def test_unmeasured_metrics_are_listed_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    print_metrics(Console(width=100), "Map of a.log", MAPPING | {"rotational_error_deg": None}, MAPPING_METRICS)
    printed = capsys.readouterr().out
    assert "│ translational error (mean) " in printed
    unmeasured = "rotational error, translational error over more than a minute, loop closures accepted"
    assert f"Not measured: {unmeasured}, loop closures rejected.\n" in printed
