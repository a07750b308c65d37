"""Tables of map errors with the published ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.experiments.mapping.drifting_odometry import BuildingResult, drifting_odometry
from wherry.experiments.mapping.table import PUBLISHED, drifting_table, intel_table, reproduce
from wherry.pipelines.logs.mapping import MappingResult

RESULT = MappingResult(
    verdict="A map.",
    translational_error_m=0.05,
    translational_sd_m=0.07,
    rotational_error_deg=1.5,
    rotational_sd_deg=2.9,
    relations=2984,
    far_translational_error_m=0.05,
    ms_per_scan_median=0.9,
    ms_per_scan_p99=60.0,
    seconds=6.0,
    closures_accepted=180,
    closures_refused=214,
    scans=910,
    skipped=0,
    backend="graph",
    log="some.log",
    size_m=(30.0, 30.0),
    free_area_m2=400.0,
    resolution_m=0.05,
    distance_m=500.0,
    duration_s=2651.0,
    fit=0.95,
    is_doubtful=False,
    notes=(),
)


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]


def test_scored_methods_follow_the_published_ones() -> None:
    rows = cells(intel_table([RESULT, replace(RESULT, backend="particles", translational_error_m=None)]))
    assert len(rows) == 2 + len(PUBLISHED) + 1
    assert rows[-1] == ["wherry, graph", "0.050 ± 0.070", "0.050", "1.500 ± 2.900", "180", "0.90", "6.0"]
    assert ["RBPF, 50 particles (gmapping)", "0.070 ± 0.083"] in [row[:2] for row in rows]


def test_the_row_of_a_building_has_its_worst_run() -> None:
    runs = [
        BuildingResult("aces", 0, 2.0, 0.10, 40, 0, 0.3),
        BuildingResult("aces", 1, 4.0, 0.20, 41, 1, 1.3),
        BuildingResult("fhw", 0, 1.0, 0.10, 9, 0, 0.1),
    ]
    rows = cells(drifting_table(runs))
    assert rows[2] == ["aces", "2.0–4.0", "0.150", "0.200", "81", "1.30", "1"]
    assert rows[3][0] == "fhw"


def test_drift_grows_with_the_distance() -> None:
    still = drifting_odometry(np.zeros((5, 3)), np.random.default_rng(0))
    np.testing.assert_array_equal(still, np.zeros((5, 3)))
    straight = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    off = np.abs(drifting_odometry(straight, np.random.default_rng(0)) - straight)[:, 0]
    assert 0.0 < off[1] < off[99] < 20.0
    again = drifting_odometry(straight, np.random.default_rng(0))
    np.testing.assert_array_equal(again, drifting_odometry(straight, np.random.default_rng(0)))


def test_missing_logs_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="intel_910"):
        reproduce(tmp_path, lambda done, total: None)
