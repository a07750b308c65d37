"""Learning curves and comparisons of steps as figures for documents, on white and readable without colours."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle, product
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, NullFormatter

from wherry.space.pose import Floats
from wherry.views.plot_style import GRID_COLOUR, MEASURED_COLOUR, TEXT_COLOUR

PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#6a6a6a", "#56b4e9", "#b8860b", "#000000", "#7b3294")
"""Line colours in the order of the learners, distinguishable for most colour-blind people (Okabe and Ito)."""

LINE_STYLES = ("solid", "dashed", "dotted")
"""Line styles; the next one is used when all colours have been used with the one before."""

BAND_PERCENTILES = (10, 90)  # lower and upper edge of a curve's band
CURVE_POINTS = 400  # samples of a curve
MAX_LINEAR_RATIO = 30  # ratio of the longest to the shortest run above which the axis of steps is logarithmic
PUBLISHED_MARKER: Mapping[str, Any] = {
    "marker": "o",
    "linestyle": "none",
    "markerfacecolor": "white",
    "markeredgecolor": "#d55e00",
}

Run = Sequence[tuple[int, int]]
"""The learning curve of one run: number of steps up to the end of each episode, and number of probes solved then."""


@dataclass(frozen=True, slots=True)
class StepsNeeded:
    """The steps until all probes are solved, measured or published.

    Attributes:
        name: Name of the learner.
        steps: [R] number of steps in every repetition; the mean alone, [1], where it is published.
        is_published: Whether the steps are a published mean.
    """

    name: str
    steps: Sequence[float]
    is_published: bool = False


def learning_curves(runs: Mapping[str, Sequence[Run]], probes: int, title: str) -> Figure:
    """Draw probes solved against steps: the median of the repetitions, and the band from 10 to 90 %.

    Args:
        runs: Repetitions of every learner, by its name; at least one each.
        probes: Number of probes.
        title: Title of the figure.

    Returns:
        The figure; its axis of steps is logarithmic where learners differ by more than `MAX_LINEAR_RATIO`.
    """
    figure, axes = _figure(7.2, 4.2)
    ends = [max(run[-1][0] for run in repetitions) for repetitions in runs.values()]
    first, last = min(run[0][0] for repetitions in runs.values() for run in repetitions), max(ends)
    is_logarithmic = last > MAX_LINEAR_RATIO * min(ends)
    steps = (
        np.geomspace(max(1, first / 2), last, CURVE_POINTS) if is_logarithmic else np.linspace(0, last, CURVE_POINTS)
    )
    lines = cycle(product(LINE_STYLES, PALETTE))
    for (name, repetitions), (style, colour) in zip(runs.items(), lines, strict=False):
        solved = np.array([solved_by(run, steps) for run in repetitions])
        _draw_curve(axes, steps, solved, probes, color=colour, linestyle=style, label=name)
    if is_logarithmic:
        _logarithmic(axes)
    axes.set_xlim(steps[0], last)
    axes.set_ylim(-0.15, probes + 0.25)
    axes.set_yticks(range(probes + 1))
    axes.set_xlabel("steps in the environment")
    axes.set_ylabel(f"probes solved optimally, of {probes}")
    axes.set_title(title, loc="left", fontsize=12, color=TEXT_COLOUR)
    figure.legend(
        loc="outside lower center",
        ncols=min(4, len(runs)),
        frameon=False,
        fontsize=9,
        title=_repetitions_note(runs),
        title_fontsize=8.5,
    )
    return figure


def _draw_curve(
    axes: Axes, steps: Floats, solved: Floats, probes: int, *, color: str, linestyle: str, label: str
) -> None:
    """Draw one learner's median and band; the median ends where it reaches all probes.

    Args:
        axes: Axes to draw on.
        steps: [N] numbers of steps, ascending.
        solved: [R, N] number of probes solved in every repetition after these steps.
        probes: Number of probes.
        color: Colour of line and band.
        linestyle: Style of the line.
        label: Name of the learner.
    """
    lower, upper = BAND_PERCENTILES
    low, median, high = np.percentile(solved, [lower, 50, upper], axis=0)
    axes.fill_between(steps, low, high, color=color, alpha=0.16, linewidth=0, step="post")
    until = np.searchsorted(median, probes) + 1  # the curve is constant from then on
    axes.plot(
        steps[:until],
        median[:until],
        color=color,
        linewidth=2,
        linestyle=linestyle,
        drawstyle="steps-post",
        label=label,
    )
    axes.plot(steps[:until][-1:], median[:until][-1:], "o", color=color, clip_on=False)


def _repetitions_note(runs: Mapping[str, Sequence[Run]]) -> str:
    """Return the meaning of curves and bands in words, for the legend."""
    counts = sorted({len(repetitions) for repetitions in runs.values()})
    if counts == [1]:
        return "one repetition"
    count = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    lower, upper = BAND_PERCENTILES
    return f"median of {count} repetitions, and the band from {lower} to {upper} %"


def solved_by(run: Run, steps: Floats) -> Floats:
    """Return the number of probes that a run solved at its latest test, after given numbers of steps.

    Args:
        run: Learning curve of the run; its last value holds for all later steps.
        steps: [N] numbers of steps.

    Returns:
        [N] numbers of probes.
    """
    episode_ends, solved = np.array([(0, 0), *run]).T
    counts: Floats = solved[np.searchsorted(episode_ends, steps, side="right") - 1].astype(float)
    return counts


def steps_needed(panels: Mapping[str, Sequence[StepsNeeded]], title: str) -> Figure:
    """Draw the steps to the optimal policy, a row for each learner.

    A dot is the median of the repetitions, a bar the range between `BAND_PERCENTILES`, a ring a published mean.

    Args:
        panels: Steps of the learners, by the heading of their panel; all panels have the same rows.
        title: Title of the figure.
    """
    names = list(dict.fromkeys(row.name for rows in panels.values() for row in rows))
    figure = Figure(figsize=(9.0, 0.42 * len(names) + 1.5), layout="constrained", facecolor="white")
    all_axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (heading, rows) in zip(all_axes, panels.items(), strict=True):
        _style(axes)
        for row in rows:
            _draw_row(axes, names.index(row.name), row)
        _logarithmic(axes)
        axes.set_title(heading, loc="left", fontsize=11, color=TEXT_COLOUR)
        axes.set_xlabel("steps until all six probes are solved optimally")
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_yticks(range(len(names)), names)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, color=TEXT_COLOUR)
    lower, upper = BAND_PERCENTILES
    measured = Line2D([], [], marker="o", color=MEASURED_COLOUR, label=f"wherry: median, {lower}–{upper} %")
    published = Line2D([], [], **PUBLISHED_MARKER, label="published: mean")
    figure.legend(handles=[measured, published], loc="outside lower center", ncols=2, frameon=False, fontsize=9)
    return figure


def _draw_row(axes: Axes, y: int, row: StepsNeeded) -> None:
    """Draw one learner's steps at a height in the panel: a ring if they are published, else a bar with a dot."""
    if row.is_published:
        axes.plot(row.steps, [y] * len(row.steps), **PUBLISHED_MARKER, zorder=5)
        return
    lower, upper = BAND_PERCENTILES
    low, median, high = np.percentile(row.steps, [lower, 50, upper])
    axes.plot([low, high], [y, y], color=MEASURED_COLOUR, alpha=0.35, linewidth=7, solid_capstyle="butt")
    axes.plot([median], [y], "o", color=MEASURED_COLOUR, zorder=4)
    axes.annotate(f"{median:,.0f}", (median, y), (0, 7), textcoords="offset points", ha="center", fontsize=7.5)


def as_bytes(figure: Figure, kind: Literal["png", "svg"]) -> bytes:
    """Return a figure as the content of a file; equal figures give equal bytes."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "wherry"}):
        figure.savefig(buffer, format=kind, dpi=160, metadata={"Date": None} if kind == "svg" else {"Software": None})
    return buffer.getvalue()


def _figure(width: float, height: float) -> tuple[Figure, Axes]:
    """Return an empty figure of a size in inches, with its axes."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    axes = figure.subplots()
    _style(axes)
    return figure, axes


def _logarithmic(axes: Axes) -> None:
    """Make the axis of steps logarithmic, with abbreviated numbers."""
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda steps, _: _short(steps)))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _short(steps: float) -> str:
    """Return an abbreviated number of steps: 100, 10k, 1M."""
    for unit, suffix in ((1_000_000, "M"), (1_000, "k")):
        if steps >= unit:
            return f"{steps / unit:g}{suffix}"
    return f"{steps:g}"


def _style(axes: Axes) -> None:
    """Give axes a white background and a light grid, and remove their upper and right edges."""
    axes.set_facecolor("white")
    axes.grid(visible=True, color=GRID_COLOUR, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(colors=TEXT_COLOUR, length=3)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
