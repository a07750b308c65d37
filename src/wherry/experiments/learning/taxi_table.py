"""The Taxi experiment with every learner on both grids, beside published results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from wherry.experiments.machine import machine_load
from wherry.experiments.results import markdown_table, write_picture
from wherry.pipelines.grids.arenas import Arena
from wherry.pipelines.grids.learners import LEARNERS
from wherry.pipelines.grids.learning import (
    MAX_STEPS_WITHOUT_CONVERGENCE,
    LearningExperiment,
    LearningResult,
    LearningSettings,
    probes_solved_by_transfer,
)
from wherry.views.learning_curve import StepsNeeded, as_bytes, learning_curves, steps_needed

SIZES = (5, 10)  # sides of the grids, cells
MIN_MS_SHOWN = 0.001  # ms; shorter times are shown as "< 0.001"


@dataclass(frozen=True, slots=True)
class PublishedResult:
    """A published result of a learner, or of people, on one grid.

    Attributes:
        name: Name of the learner, a key of `LEARNERS`; or a description of the people.
        size: Side of the grid, cells.
        steps: Mean number of steps until all probes are solved.
        ms_per_step: Time of a step, ms, on a machine of that year; None where it was not published.
        source: The publication.
    """

    name: str
    size: int
    steps: float
    ms_per_step: float | None
    source: str


PUBLISHED = (
    PublishedResult("doormax", 5, 529, 13.88, "ICML 2008"),
    PublishedResult("doormax", 10, 821, 293.72, "ICML 2008"),
    PublishedResult("factored-rmax", 5, 1676, 43.59, "ICML 2008"),
    PublishedResult("factored-rmax", 10, 19866, 306.71, "ICML 2008"),
    PublishedResult("rmax", 5, 4151, 74.0, "Diuk 2010"),
    PublishedResult("q-learning", 5, 106859, None, "Diuk 2010"),
    PublishedResult("q-learning-optimistic", 5, 29350, None, "Diuk 2010"),
    PublishedResult("people", 5, 101, None, "Diuk 2010"),
    PublishedResult("people who play games", 5, 48.8, None, "Diuk 2010"),
)


@dataclass(frozen=True, slots=True)
class TaxiRepetitions:
    """The number of repetitions of each learner on each grid; the defaults are those of the results file.

    Attributes:
        default: Number of repetitions.
        fewer: Smaller numbers for some learners and sizes; 0 omits the learner on that size.
    """

    default: int = 100
    fewer: Mapping[tuple[str, int], int] = field(default_factory=dict)

    def of(self, learner: str, size: int) -> int:
        """Return the number of repetitions of a learner on a grid."""
        return min(self.default, self.fewer.get((learner, size), self.default))

    def total(self) -> int:
        """Return the number of all repetitions."""
        return sum(self.of(learner, size) for learner in LEARNERS for size in SIZES)


def reproduce(images: Path, progress: Callable[[int, int], None], repetitions: TaxiRepetitions | None = None) -> str:
    """Run every learner on both grids and return the tables as Markdown.

    Args:
        images: Folder for pictures, beside the results file.
        progress: Called with the number of finished repetitions and their total.
        repetitions: Numbers of repetitions; None for those of the results file.
    """
    counts = repetitions or TaxiRepetitions()
    large, done = Arena.of_size(10), 0
    results: dict[int, dict[str, LearningResult]] = {size: {} for size in SIZES}
    transfers = []
    for learner, entry in LEARNERS.items():
        for size in SIZES:
            if not counts.of(learner, size):
                continue
            settings = LearningSettings(size=size, learner=learner, repetitions=counts.of(learner, size))
            experiment = LearningExperiment(settings)
            transferred = []
            for _ in experiment.repetitions():
                done += 1
                progress(done, counts.total())
                if size == 5 and experiment.learner is not None and entry.converges:
                    transferred.append(probes_solved_by_transfer(experiment.learner, large) == len(large.probes))
            results[size][learner] = experiment.result()
            if transferred:
                transfers.append(f"{learner} in {sum(transferred)} of {len(transferred)}")
    return markdown(results, transfers, _pictures(results, images))


def _pictures(results: Mapping[int, Mapping[str, LearningResult]], images: Path) -> str:
    """Draw the steps needed and the learning curves; return the pictures as Markdown."""
    panels = {
        f"{size}×{size}": [
            *(StepsNeeded(name, [run.steps for run in result.runs]) for name, result in results[size].items()),
            *(StepsNeeded(row.name, [row.steps], is_published=True) for row in PUBLISHED if row.size == size),
        ]
        for size in SIZES
    }
    written = [
        write_picture(
            images,
            "taxi-steps.svg",
            as_bytes(steps_needed(panels, "Taxi: steps to the optimal policy, without prior knowledge"), "svg"),
            "Steps to the optimal policy of every learner, measured and published",
        )
    ]
    for size in SIZES:
        curves = {name: [run.curve for run in result.runs] for name, result in results[size].items()}
        figure = learning_curves(curves, 6, f"Taxi {size}×{size}: probes solved against steps")
        written.append(
            write_picture(
                images, f"taxi-curves-{size}.svg", as_bytes(figure, "svg"), f"Learning curves on {size}×{size}"
            )
        )
    return "\n\n".join(written)


def markdown(results: Mapping[int, Mapping[str, LearningResult]], transfers: list[str], pictures: str) -> str:
    """Return the section of the results file.

    Args:
        results: Results by size of the grid and learner.
        transfers: For some learners, in how many repetitions rules learnt on 5×5 solved 10×10, in words.
        pictures: Markdown of the pictures.
    """
    not_converging = ", ".join(name for name, entry in LEARNERS.items() if not entry.converges)
    parts = [
        "## Taxi\nSteps until the policy is optimal from six probes: mean ± standard deviation, and the 95th "
        "percentile, over the number of repetitions in the last column; rewards and ends of episodes are learnt. Times "
        "are processor times of a whole step (predict, learn, plan) on one core, medians of the repetitions, on a "
        f"machine with a {machine_load()}; published times are from other machines. Q-learning, R-max and Factored "
        "R-max are compiled together with the grid. Factored R-max is given the dependencies between the taxi's cell, "
        "the passenger's location and the destination; in the network of factored-rmax-minimal the passenger's "
        "original mark has no influence once the passenger is in the taxi. A repetition of "
        f"{not_converging} that has not converged after {MAX_STEPS_WITHOUT_CONVERGENCE:,} steps is ended, and is not "
        "included in the mean.",
        pictures,
    ]
    header = ["learner", "published steps", "steps", "95 %", "published ms/step", "ms/step", "converged"]
    for size, learners in results.items():
        rows = [[f"**{name}**", *_row(name, size, learners.get(name))] for name in _names(size, learners)]
        parts.append(f"### {size}×{size}\n\n{markdown_table(header, rows)}")
    if unknown := _unknown_answers(results):
        parts.append(unknown)
    if transfers:
        parts.append(
            "Rules learnt on 5×5 solved 10×10 optimally without a further learning step: "
            f"{', '.join(transfers)} repetitions. In the other repetitions the optimal policy needed a step under a "
            "condition for which the learner had no prediction yet."
        )
    return "\n\n".join(parts) + "\n"


def _unknown_answers(results: Mapping[int, Mapping[str, LearningResult]]) -> str | None:
    """Return the numbers of answers "I don't know" and their bounds in words; None where none were counted."""
    counted = [
        f"{result.unknown_answers} by {name} on {size}×{size} ({result.unknown_answers_bound})"
        for size, learners in results.items()
        for name, result in learners.items()
        if result.unknown_answers is not None
    ]
    if not counted:
        return None
    return (
        'The largest number of answers "I don\'t know" in any repetition for one action, attribute and type of effect, '
        f"failures not counted; in brackets the theorem's bound, nk + k + 1: {', '.join(counted)}."
    )


def _names(size: int, learners: Mapping[str, LearningResult]) -> list[str]:
    """Return the names of all rows for a size: measured learners first, then those only published."""
    return list(dict.fromkeys([*learners, *(row.name for row in PUBLISHED if row.size == size)]))


def _row(name: str, size: int, result: LearningResult | None) -> list[str]:
    """Return the cells of a row after the name: published and measured results, – where there is none."""
    published = next((row for row in PUBLISHED if (row.name, row.size) == (name, size)), None)
    steps = "–" if published is None else f"{published.steps:,g} ({published.source})"
    speed = "–" if published is None or published.ms_per_step is None else f"{published.ms_per_step:g}"
    if result is None:
        return [steps, "–", "–", speed, "–", "–"]
    converged = f"{result.converged}/{result.repetitions}"
    if result.steps_mean is None or result.steps_sd is None or result.steps_p95 is None:
        return [steps, "–", "–", speed, _milliseconds(result.ms_per_step), converged]
    mean = f"{result.steps_mean:,.0f} ± {result.steps_sd:,.0f}"
    return [steps, mean, f"{result.steps_p95:,.0f}", speed, _milliseconds(result.ms_per_step), converged]


def _milliseconds(value: float) -> str:
    """Return a time, ms, as text with two significant digits."""
    return f"{value:.2g}" if value >= MIN_MS_SHOWN else f"< {MIN_MS_SHOWN:g}"
