"""Filters side by side: a panel of bars for each figure, as a picture for documents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

COLOUR, INK, FAINT = "#0072b2", "#222222", "#d9d9d9"


def filter_bars(names: Sequence[str], figures: Mapping[str, Sequence[float]]) -> Figure:
    """Draw a row of bars for every filter; axes are logarithmic.

    Args:
        names: The filters.
        figures: For each panel's heading a positive figure for every filter.
    """
    picture = Figure(figsize=(9.0, 0.38 * len(names) + 0.9), layout="constrained", facecolor="white")
    every = picture.subplots(1, len(figures), sharey=True, squeeze=False)[0]
    for axes, (heading, values) in zip(every, figures.items(), strict=True):
        axes.barh(range(len(names)), values, color=COLOUR, height=0.6)
        axes.set_xscale("log")
        axes.set_xlim(min(values) / 3.0, max(values) * 8.0)
        for row, value in enumerate(values):
            axes.annotate(f"{value:,.3g}" if value < 1e3 else f"{value:,.0f}", (value, row), (4, -3),
                          textcoords="offset points", fontsize=8, color=INK)  # fmt: skip
        axes.set_title(heading, loc="left", fontsize=10, color=INK)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.tick_params(colors=INK, length=3)
        axes.grid(visible=True, axis="x", color=FAINT, linewidth=0.6)
        axes.set_axisbelow(True)
        for side in ("top", "right"):
            axes.spines[side].set_visible(False)
    return picture
