"""Bar charts that compare filters, with a panel for each metric, as figures for documents."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from wherry.views.plot_style import GRID_COLOUR, MEASURED_COLOUR, TEXT_COLOUR


def filter_bars(names: Sequence[str], metrics: Mapping[str, Sequence[float]]) -> Figure:
    """Draw a bar for every filter in every panel, on logarithmic axes.

    Args:
        names: [N] names of the filters.
        metrics: [N] positive values of the filters for every metric, by the heading of its panel.
    """
    figure = Figure(figsize=(9.0, 0.38 * len(names) + 0.9), layout="constrained", facecolor="white")
    panels = figure.subplots(1, len(metrics), sharey=True, squeeze=False)[0]
    for axes, (heading, values) in zip(panels, metrics.items(), strict=True):
        _draw_bars(axes, heading, values)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
    return figure


def _draw_bars(axes: Axes, heading: str, values: Sequence[float]) -> None:
    """Draw one panel, with the value beside each bar."""
    axes.barh(range(len(values)), values, color=MEASURED_COLOUR, height=0.6)
    axes.set_xscale("log")
    axes.set_xlim(min(values) / 3.0, max(values) * 8.0)
    for row, value in enumerate(values):
        text = f"{value:,.3g}" if value < 1e3 else f"{value:,.0f}"
        axes.annotate(text, (value, row), (4, -3), textcoords="offset points", fontsize=8, color=TEXT_COLOUR)
    axes.set_title(heading, loc="left", fontsize=10, color=TEXT_COLOUR)
    axes.tick_params(colors=TEXT_COLOUR, length=3)
    axes.grid(visible=True, axis="x", color=GRID_COLOUR, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
