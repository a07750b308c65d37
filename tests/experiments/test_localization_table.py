"""The localization section of the results, and its pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wherry.experiments.localization.filter_comparison import FilterComparisonSettings
from wherry.experiments.localization.kidnapping import KidnappingSettings
from wherry.experiments.localization.recorded import largest_group
from wherry.experiments.localization.table import (
    FILTERS_PICTURE,
    INTEL_RELIABILITY_PICTURE,
    RELIABILITY_PICTURE,
    LocalizationTableSettings,
    reproduce,
)
from wherry.views.filter_bars import filter_bars
from wherry.views.learning_curve import as_bytes
from wherry.views.reliability import reliability_diagram
from wherry_testing.buildings import shared_data


def test_largest_group_of_agreeing_poses() -> None:
    finals = np.array([[0.0, 0.0, 3.0], [0.3, 0.0, -3.0], [0.6, 0.0, 0.0], [9.0, 9.0, 0.0]])
    assert largest_group(finals) == 3  # all of them are near the middle one
    assert largest_group(finals[[0, 2, 3]]) == 1


def test_reliability_diagram_has_a_point_for_every_bin_with_cases() -> None:
    bins = np.array([[0.0, 0.0, 10.0], [np.nan, np.nan, 0.0], [1.0, 0.5, 1.0]])
    axes = reliability_diagram(bins, "stated", "observed").axes[0]
    (points,) = axes.collections
    np.testing.assert_array_equal(points.get_offsets(), [[0.0, 0.0], [1.0, 0.5]])
    larger, smaller = points.get_sizes()
    assert larger > smaller
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("stated", "observed")


def test_reliability_diagram_without_cases_is_empty() -> None:
    axes = reliability_diagram(np.array([[np.nan, np.nan, 0.0]]), "stated", "observed").axes[0]
    assert len(axes.collections[0].get_offsets()) == 0


def test_filter_bars_are_labelled_with_their_values() -> None:
    figure = filter_bars(["first", "second"], {"rmse, m": [0.0153, 0.4], "scans/s": [6336.2, 20.0]})
    assert [text.get_text() for axes in figure.axes for text in axes.texts] == ["0.0153", "0.4", "6,336", "20"]


def test_pictures_are_reproducible() -> None:
    bins = np.array([[0.1, 0.0, 10.0], [0.9, 0.8, 4.0]])
    first, second = (as_bytes(reliability_diagram(bins, "stated", "observed"), "svg") for _ in range(2))
    assert first == second


@pytest.mark.slow
def test_every_part_runs(tmp_path: Path) -> None:
    data = shared_data("intel").parent
    small = LocalizationTableSettings(
        FilterComparisonSettings(seconds=6.0, repetitions=1),
        KidnappingSettings(tracking_seconds=5.0, kidnappings=1, seconds_per_kidnapping=5.0),
        seeds=1,
        every=50,
        updates=5,
        should_calibrate=False,
    )
    progress: list[tuple[int, int]] = []
    markdown = reproduce(data, tmp_path, lambda done, total: progress.append((done, total)), small)
    assert progress == [(done, 6) for done in range(7)]
    assert markdown.count("\n### ") == 6
    assert "nan" not in markdown
    assert (tmp_path / RELIABILITY_PICTURE).exists()
    assert (tmp_path / INTEL_RELIABILITY_PICTURE).exists()
    assert (tmp_path / FILTERS_PICTURE).exists()
