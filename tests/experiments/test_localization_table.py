"""The localization section of the results: every part runs, and its diagram shows what the table says."""

from __future__ import annotations

import os
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from wherry.experiments.localization import kidnapping
from wherry.experiments.localization import study as localization_study
from wherry.experiments.localization.recorded import most_together
from wherry.experiments.localization.table import FILTERS, RELIABILITY, RELIABILITY_INTEL, Extent, reproduce
from wherry.views.reliability import MARGIN, SIDE, reliability_diagram


def test_poses_that_came_to_one_place() -> None:
    finals = np.array([[0.0, 0.0, 3.0], [0.3, 0.0, -3.0], [0.6, 0.0, 0.0], [9.0, 9.0, 0.0]])
    assert most_together(finals) == 3  # all of them are near the middle one
    assert most_together(finals[[0, 2, 3]]) == 1


def test_a_diagram_has_a_point_for_every_row_with_cases() -> None:
    table = np.array([[0.0, 0.0, 10.0], [np.nan, np.nan, 0.0], [1.0, 0.5, 1.0]])
    picture = ElementTree.fromstring(reliability_diagram(table, "stated", "true"))  # noqa: S314 - our own
    points = [(float(p.get("cx", "")), float(p.get("cy", ""))) for p in picture.iter() if p.tag.endswith("circle")]
    assert points == [(MARGIN, MARGIN + SIDE), (MARGIN + SIDE, MARGIN + SIDE / 2)]


@pytest.mark.slow
def test_every_part_runs(tmp_path: Path) -> None:
    data = Path(os.environ.get("WHERRY_DATA", Path(__file__).parents[2].parent / "shared" / "data"))
    if not data.exists():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{data} is missing; set WHERRY_DATA")
        pytest.skip(f"{data} is missing; set WHERRY_DATA")
    little = Extent(
        localization_study.Settings(seconds=6.0, repetitions=1),
        kidnapping.Settings(seconds=5.0, kidnappings=1, patience=5.0),
        seeds=1,
        every=50,
        updates=5,
        calibrate=False,
    )
    told: list[tuple[int, int]] = []
    markdown = reproduce(data, tmp_path, lambda done, total: told.append((done, total)), little)
    assert told == [(done, 6) for done in range(7)]
    assert markdown.count("\n### ") == 6
    assert "nan" not in markdown
    assert (tmp_path / RELIABILITY).exists()
    assert (tmp_path / RELIABILITY_INTEL).exists()
    assert (tmp_path / FILTERS).exists()
