"""Deliveries with many seeds, and with rules that were learnt in another world."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from wherry.experiments.results import markdown_table
from wherry.pipelines.delivery.score import DeliveryResult
from wherry.pipelines.delivery.simulated import RULES_FILE, DeliverySettings, prepare_delivery
from wherry.trace.records import null_sink

SEEDS = tuple(range(10))
BOXES = 4
TEACHERS = ("rooms", "taxi")  # worlds in which rules are learnt
WORLDS = ("small", "rooms", "taxi")  # worlds in which they are used

Progress = Callable[[int, int], None]
"""Called with the number of runs done and of all runs."""


@dataclass(frozen=True, slots=True)
class DeliveryTrial:
    """One run of the study.

    Attributes:
        taught_in: Name of the world in which the robot's rules were learnt; empty if it started without rules.
        result: The referee's score.
    """

    taught_in: str
    result: DeliveryResult


def reproduce(folder: Path, progress: Progress) -> str:
    """Run the study and return it as Markdown.

    Args:
        folder: Folder for the files of the runs.
        progress: Called after each run.
    """
    trials = []
    for trial in run(folder):
        trials.append(trial)
        progress(len(trials), runs())
    return markdown(trials)


def run(folder: Path) -> Iterator[DeliveryTrial]:
    """Deliver with every seed in the default world, then with the rules of one world in every other.

    Args:
        folder: Folder for the files of the runs.
    """
    for seed in SEEDS:
        settings = DeliverySettings(boxes=BOXES, seed=seed, out=folder / f"rooms-seed{seed}")
        yield DeliveryTrial("", prepare_delivery(settings)(null_sink))
    for teacher in TEACHERS:
        taught = folder / f"{teacher}-taught"
        prepare_delivery(DeliverySettings(world=teacher, out=taught))(null_sink)
        for world in WORLDS:
            if world != teacher:
                settings = DeliverySettings(
                    world=world, seed=1, rules_file=taught / RULES_FILE, out=folder / f"{teacher}-{world}"
                )
                yield DeliveryTrial(teacher, prepare_delivery(settings)(null_sink))


def runs() -> int:
    """Number of runs that `run` yields."""
    return len(SEEDS) + len(TEACHERS) * (len(WORLDS) - 1)


def markdown(trials: list[DeliveryTrial]) -> str:
    """The study as two tables."""
    untaught = [trial.result for trial in trials if not trial.taught_in]
    taught = [trial for trial in trials if trial.taught_in]
    header = ["run", "delivered", "collisions", "learning steps", "actions", "path ratio", "localization rmse"]
    header += ["map error", "real-time factor"]
    rows = [[f"seed {result.seed}", *_cells(result)] for result in untaught]
    taught_rows = [[f"{trial.taught_in} → {trial.result.world}", *_cells(trial.result)] for trial in taught]
    return (
        f"## Delivery\nThe world `rooms` with {BOXES} boxes, starting without rules.\n\n"
        f"{markdown_table(header, rows)}\n\n"
        f"Starting with rules learnt in another world.\n\n{markdown_table(header, taught_rows)}\n"
    )


def _cells(result: DeliveryResult) -> list[str]:
    """The metrics of a run as cells of a table's row."""

    def rounded(value: float | None, digits: int, unit: str = "") -> str:
        return "–" if value is None else f"{value:.{digits}f}{unit}"

    def centimetres(metres: float | None) -> str:
        return rounded(None if metres is None else metres * 100.0, 1, " cm")

    return [
        f"{result.delivered} of {result.boxes}",
        str(result.collisions),
        str(result.learning_steps),
        str(result.actions),
        rounded(result.path_ratio, 2),
        centimetres(result.localization_rmse_m),
        centimetres(result.map_error_m),
        rounded(result.real_time_factor, 0),
    ]
