"""Reliability diagrams: observed frequency against stated probability, as figures for documents."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from wherry.space.pose import Floats
from wherry.views.plot_style import GRID_COLOUR, MEASURED_COLOUR, TEXT_COLOUR

MIN_MARKER, MAX_MARKER = 4.5, 13.5  # points, diameters of the markers, which grow with the number of cases


def reliability_diagram(bins: Floats, stated_label: str, observed_label: str) -> Figure:
    """Draw a reliability diagram; the dashed diagonal is perfect calibration.

    Args:
        bins: [B, 3] mean stated probability, observed frequency and number of cases of every bin; empty bins are not
            drawn.
        stated_label: Label of the horizontal axis.
        observed_label: Label of the vertical axis.
    """
    figure = Figure(figsize=(4.6, 4.6), layout="constrained", facecolor="white")
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#999999", linestyle="--", linewidth=1.0, label="perfect calibration")
    stated, observed, count = bins[bins[:, 2] > 0].T
    diameters = MIN_MARKER + (MAX_MARKER - MIN_MARKER) * np.sqrt(count / count.max(initial=1.0))
    axes.plot(stated, observed, color=MEASURED_COLOUR, linewidth=1.2)
    axes.scatter(stated, observed, s=diameters**2, color=MEASURED_COLOUR, linewidths=0.0, clip_on=False, zorder=3)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_aspect("equal")
    axes.set_xlabel(stated_label, color=TEXT_COLOUR)
    axes.set_ylabel(observed_label, color=TEXT_COLOUR)
    axes.tick_params(colors=TEXT_COLOUR, length=3, pad=9)
    axes.grid(visible=True, color=GRID_COLOUR, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return figure
