"""The delivery study: deliveries with many seeds, and transfer of learnt rules to other worlds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from wherry.experiments.results import markdown_table
from wherry.pipelines.delivery.result import DeliveryResult
from wherry.pipelines.delivery.simulated import RULES_FILE, DeliverySettings, prepare_delivery
from wherry.trace.records import null_sink

SEEDS = tuple(range(10))
BOXES = 4  # boxes in the runs without rules
SOURCE_WORLDS = ("rooms", "taxi")  # worlds in which rules are learnt
TARGET_WORLDS = ("small", "rooms", "taxi")  # worlds in which the learnt rules are used

Progress = Callable[[int, int], None]
"""Called with the number of finished runs and the number of all runs."""


@dataclass(frozen=True, slots=True)
class DeliveryTrial:
    """One run of the study.

    Attributes:
        source_world: Name of the world in which the robot's rules were learnt; None if it started without rules.
        result: The result of the run.
    """

    source_world: str | None
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
        progress(len(trials), trial_count())
    return markdown(trials)


def run(folder: Path) -> Iterator[DeliveryTrial]:
    """Deliver with every seed in the default world, then in each target world with rules from another world.

    Args:
        folder: Folder for the files of the runs.
    """
    for seed in SEEDS:
        settings = DeliverySettings(boxes=BOXES, seed=seed, out=folder / f"rooms-seed{seed}")
        yield DeliveryTrial(None, prepare_delivery(settings)(null_sink))
    for source in SOURCE_WORLDS:
        learnt = folder / f"{source}-learnt"
        prepare_delivery(DeliverySettings(world=source, out=learnt))(null_sink)
        for world in TARGET_WORLDS:
            if world != source:
                settings = DeliverySettings(
                    world=world, seed=1, rules_file=learnt / RULES_FILE, out=folder / f"{source}-{world}"
                )
                yield DeliveryTrial(source, prepare_delivery(settings)(null_sink))


def trial_count() -> int:
    """Number of trials that `run` yields."""
    return len(SEEDS) + sum(source != target for source in SOURCE_WORLDS for target in TARGET_WORLDS)


def markdown(trials: list[DeliveryTrial]) -> str:
    """The study as two Markdown tables."""
    without_rules = [trial.result for trial in trials if trial.source_world is None]
    transferred = [trial for trial in trials if trial.source_world is not None]
    header = ["run", "delivered", "collisions", "learning steps", "actions", "path ratio", "localization rmse"]
    header += ["map error", "real-time factor"]
    rows = [[f"seed {result.seed}", *_table_cells(result)] for result in without_rules]
    transferred_rows = [
        [f"{trial.source_world} → {trial.result.world}", *_table_cells(trial.result)] for trial in transferred
    ]
    return (
        f"## Delivery\nThe world `rooms` with {BOXES} boxes, starting without rules.\n\n"
        f"{markdown_table(header, rows)}\n\n"
        f"Starting with rules learnt in another world.\n\n{markdown_table(header, transferred_rows)}\n"
    )


def _table_cells(result: DeliveryResult) -> list[str]:
    """The metrics of a run as cells of a table row."""

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
