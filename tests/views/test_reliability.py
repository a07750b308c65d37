"""Reliability diagrams."""

from __future__ import annotations

import numpy as np

from wherry.views.learning_curve import as_bytes
from wherry.views.reliability import reliability_diagram


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


def test_reliability_diagram_has_reproducible_bytes() -> None:
    bins = np.array([[0.1, 0.0, 10.0], [0.9, 0.8, 4.0]])
    first, second = (as_bytes(reliability_diagram(bins, "stated", "observed"), "svg") for _ in range(2))
    assert first == second
