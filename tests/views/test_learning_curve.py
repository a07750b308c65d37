"""Learning curves and step comparisons, checked on the drawn matplotlib axes."""

from __future__ import annotations

import numpy as np

from wherry.views.learning_curve import (
    LINE_STYLES,
    PALETTE,
    StepsNeeded,
    as_bytes,
    learning_curves,
    solved_by,
    steps_needed,
)

RUNS = {"quick": [[(10, 0), (20, 6)], [(12, 3), (30, 6)]], "slow": [[(100, 1), (5000, 6)]]}


def test_solved_probes_are_counted_at_each_step() -> None:
    steps = np.array([0.0, 9.0, 10.0, 19.9, 20.0, 500.0])
    assert solved_by([(10, 2), (20, 6)], steps).tolist() == [0, 0, 2, 2, 6, 6]


def test_a_line_ends_where_all_probes_are_solved() -> None:
    (axes,) = learning_curves(RUNS, 6, "Two learners").axes
    lines = {str(line.get_label()): line.get_xydata() for line in axes.get_lines()}
    quick = np.asarray(lines["quick"])
    assert quick[-1][1] == 6
    assert 20 <= quick[-1][0] <= 33
    assert (np.diff(quick[:, 1]) >= 0).all()
    assert axes.get_xscale() == "log"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("steps in the environment", "probes solved optimally, of 6")


def test_every_learner_has_its_own_combination_of_colour_and_style() -> None:
    names = [f"learner {number}" for number in range(len(PALETTE) * len(LINE_STYLES))]
    runs = dict.fromkeys(names, RUNS["quick"])
    (axes,) = learning_curves(runs, 6, "All").axes
    lines = {
        str(line.get_label()): (line.get_color(), line.get_linestyle())
        for line in axes.get_lines()
        if line.get_marker() == "None"
    }
    assert set(lines) == set(names)
    assert len(set(lines.values())) == len(names)


def test_curves_of_similar_length_share_a_linear_axis() -> None:
    (axes,) = learning_curves({"quick": RUNS["quick"]}, 6, "One").axes
    assert axes.get_xscale() == "linear"


def test_a_row_shows_the_median_and_the_published_mean() -> None:
    rows = [
        StepsNeeded("doormax", [10, 20, 30]),
        StepsNeeded("doormax", [50], is_published=True),
        StepsNeeded("people", [7], is_published=True),
    ]
    (axes,) = steps_needed({"5×5": rows}, "Taxi").axes
    points = [tuple(map(float, line.get_xydata()[0])) for line in axes.get_lines() if line.get_marker() == "o"]  # type: ignore[index, union-attr]
    assert sorted(points) == [(7, 1), (20, 0), (50, 0)]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["doormax", "people"]


def test_equal_figures_are_written_as_equal_bytes() -> None:
    first, second = (as_bytes(learning_curves(RUNS, 6, "Twice"), "svg") for _ in range(2))
    assert first == second
    assert first.startswith(b"<?xml")
    assert as_bytes(learning_curves(RUNS, 6, "Twice"), "png").startswith(b"\x89PNG")
