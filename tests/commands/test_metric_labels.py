"""Every number in a command's JSON has a label in the table that the command prints; verdicts and notes are lines."""

from __future__ import annotations

from dataclasses import fields
from typing import cast

import pytest

from wherry.pipelines.grids.learning import LearningResult
from wherry.pipelines.logs.localization import LocalizationResult
from wherry.pipelines.logs.mapping import MappingResult
from wherry.pipelines.logs.summary import DriveSummary
from wherry.ros.names import load_names
from wherry.ros.nodes.monitor import Monitor
from wherry.ros.transports.protocol import Transport
from wherry.views.metrics_tables import (
    DRIVE_METRICS,
    LEARNING_METRICS,
    LOCALIZATION_METRICS,
    MAPPING_METRICS,
    REFERENCE_METRICS,
    ROS_TRAFFIC_METRICS,
    MetricLabels,
)


class SilentTransport:
    """A transport that delivers no messages."""

    ros_version = 2

    def subscribe(self, *arguments: object) -> None: ...


def field_names(result: type) -> set[str]:
    return {field.name for field in fields(result)}


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (field_names(MappingResult) - {"log", "notes", "verdict", "is_doubtful"}, MAPPING_METRICS),
        (
            field_names(LocalizationResult) - {"verdict", "fits_map", "reference_verdict", "reference_offset"},
            {**LOCALIZATION_METRICS, **REFERENCE_METRICS},
        ),
        (field_names(DriveSummary) - {"notes"}, DRIVE_METRICS),
        (field_names(LearningResult) - {"settings", "runs"} | {"learner", "seed"}, LEARNING_METRICS),
        (set(Monitor(cast(Transport, SilentTransport()), load_names()).statistics()), ROS_TRAFFIC_METRICS),
    ],
    ids=["mapping", "localization", "drive", "learning", "ROS traffic"],
)
def test_every_metric_has_a_label(names: set[str], labels: MetricLabels) -> None:
    assert names == set(labels)
    assert not any("_" in label for label, _ in labels.values())
