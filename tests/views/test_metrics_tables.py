"""Every metric in JSON has a label and a unit."""

from __future__ import annotations

from dataclasses import asdict, fields
from types import SimpleNamespace
from typing import cast

import pytest
from rich.console import Console

from wherry.mapping import closures
from wherry.pipelines.grids import learning as taxi
from wherry.pipelines.logs import localization
from wherry.pipelines.logs import mapping as slam
from wherry.ros.names import load_names
from wherry.ros.nodes.monitor import Monitor
from wherry.ros.transports.protocol import Transport
from wherry.views.metrics_tables import (
    LEARNING_METRICS,
    LOCALIZATION_METRICS,
    MAPPING_METRICS,
    REJECTION_LABELS,
    ROS_TRAFFIC_METRICS,
    MetricLabels,
    format_metrics,
)
from wherry.views.terminal import print_metrics

MAPPED = slam.Result(0.0504, 0.041, 0.523, 0.61, 9998, None, 0.6947, 23.36, 2.061, 196, 158, 910, 0, "graph", "a.log")


class SilentTransport:
    """A transport without messages."""

    ros_version = 2

    def subscribe(self, *of: object) -> None: ...


def field_names(result: type) -> set[str]:
    return {field.name for field in fields(result)}


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (field_names(slam.Result) - {"log"}, MAPPING_METRICS),
        (field_names(localization.LocalizationResult), LOCALIZATION_METRICS),
        (field_names(taxi.Result) - {"settings", "runs"} | {"learner", "seed"}, LEARNING_METRICS),
        (set(Monitor(cast(Transport, SilentTransport()), load_names()).statistics()), ROS_TRAFFIC_METRICS),
    ],
)
def test_every_metric_has_a_label(names: set[str], labels: MetricLabels) -> None:
    assert names == set(labels)
    assert not any("_" in text for text, _ in labels.values())


def test_metrics_are_formatted_with_units() -> None:
    rows = format_metrics(asdict(MAPPED), MAPPING_METRICS)
    assert rows[3:7] == [
        ("reference relations", "9,998"),
        ("translational error (mean)", "0.050 m"),
        ("translational error (standard deviation)", "0.041 m"),
        ("rotational error (mean)", "0.52°"),
    ]
    assert rows[-3:] == [
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
    print_metrics(Console(width=100), "Map of a.log", asdict(MAPPED), MAPPING_METRICS)
    printed = capsys.readouterr().out
    assert "│ translational error (mean) " in printed
    assert "Not measured: translational error over more than a minute.\n" in printed


def test_every_rejection_reason_has_a_label() -> None:
    reasons = ("response 0.31 is below 0.45", "ambiguous: another place has response 0.6", "overlap 0.1 is below 0.6")
    tried = [cast(closures.Closure, SimpleNamespace(refused=reason)) for reason in reasons]
    assert set(closures.refusals(tried)) == set(REJECTION_LABELS)
