"""The tables of maps beside the published ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.experiments.mapping.drifting_odometry import Result as Drifting
from wherry.experiments.mapping.drifting_odometry import drifted
from wherry.experiments.mapping.table import PUBLISHED, drifting_table, intel_table, reproduce
from wherry.pipelines.logs.mapping import Result

RESULT = Result(0.05, 0.07, 1.5, 2.9, 2984, 0.05, 0.9, 60.0, 6.0, 180, 214, 910, 0, "graph", "some.log")


def cells(table: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]


def test_every_method_is_a_row_under_the_published_ones() -> None:
    rows = cells(intel_table([RESULT, replace(RESULT, backend="particles", translational_error_m=None)]))
    assert len(rows) == 2 + len(PUBLISHED) + 1
    assert rows[-1] == ["wherry, graph", "0.050 ± 0.070", "0.050", "1.500 ± 2.900", "180", "0.90", "6.0"]
    assert ["RBPF, 50 particles (gmapping)", "0.070 ± 0.083"] in [row[:2] for row in rows]


def test_a_building_s_row_holds_its_worst_run() -> None:
    runs = [
        Drifting("aces", 0, 2.0, 0.10, 40, 0, 0.3),
        Drifting("aces", 1, 4.0, 0.20, 41, 1, 1.3),
        Drifting("fhw", 0, 1.0, 0.10, 9, 0, 0.1),
    ]
    rows = cells(drifting_table(runs))
    assert rows[2] == ["aces", "2.0–4.0", "0.150", "0.200", "81", "1.30", "1"]
    assert rows[3][0] == "fhw"


def test_drift_is_none_where_nothing_moves_and_grows_where_it_does() -> None:
    still = drifted(np.zeros((5, 3)), np.random.default_rng(0))
    np.testing.assert_array_equal(still, np.zeros((5, 3)))
    straight = np.column_stack([np.arange(100.0), np.zeros(100), np.zeros(100)])
    off = np.abs(drifted(straight, np.random.default_rng(0)) - straight)[:, 0]
    assert 0.0 < off[1] < off[99] < 20.0
    again = drifted(straight, np.random.default_rng(0))
    np.testing.assert_array_equal(again, drifted(straight, np.random.default_rng(0)))


def test_missing_logs_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="intel_910"):
        reproduce(tmp_path, lambda done, total: None)
