"""The localization section of the results."""

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
from wherry_testing.buildings import shared_data


def test_largest_group_is_around_one_of_its_poses() -> None:
    finals = np.array([[0.0, 0.0, 3.0], [0.3, 0.0, -3.0], [0.6, 0.0, 0.0], [9.0, 9.0, 0.0]])
    assert largest_group(finals) == 3  # the first and the third are near the second
    assert largest_group(finals[[0, 2, 3]]) == 1


@pytest.mark.slow
def test_the_section_has_all_parts_and_pictures(tmp_path: Path) -> None:
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
