"""The delivery over many seeds, and what was learnt in one world used in the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from wherry.experiments.results import markdown_table
from wherry.pipelines.delivery.score import Result
from wherry.pipelines.delivery.simulated import Settings, prepare
from wherry.trace.records import null_sink

SEEDS = tuple(range(10))
BOXES = 4
TEACHERS = ("rooms", "taxi")
WORLDS = ("small", "rooms", "taxi")


@dataclass(frozen=True, slots=True)
class Delivery:
    """One run of the study.

    Attributes:
        taught_in: The world whose rules the robot began with; empty where it began with none.
        result: What the referee says.
    """

    taught_in: str
    result: Result


def run(folder: Path) -> Iterator[Delivery]:
    """Deliver with every seed in the default world, then with the rules of one world in every other.

    Args:
        folder: Where the runs' files go.
    """
    for seed in SEEDS:
        settings = Settings(boxes=BOXES, seed=seed, out=folder / f"rooms-seed{seed}")
        yield Delivery("", prepare(settings)(null_sink))
    for teacher in TEACHERS:
        learnt = folder / f"{teacher}-taught"
        prepare(Settings(world=teacher, out=learnt))(null_sink)
        for world in WORLDS:
            if world != teacher:
                settings = Settings(
                    world=world, seed=1, rules_file=learnt / "rules.json", out=folder / f"{teacher}-{world}"
                )
                yield Delivery(teacher, prepare(settings)(null_sink))


def runs() -> int:
    """How many runs `run` yields."""
    return len(SEEDS) + len(TEACHERS) * (len(WORLDS) - 1)


def markdown(deliveries: list[Delivery]) -> str:
    """The study as two tables."""
    alone = [delivery.result for delivery in deliveries if not delivery.taught_in]
    taught = [delivery for delivery in deliveries if delivery.taught_in]
    header = ["run", "delivered", "collisions", "learning steps", "actions", "path ratio", "localization rmse"]
    header += ["map error", "real-time factor"]
    rows = [[f"seed {result.seed}", *_cells(result)] for result in alone]
    others = [[f"{item.taught_in} → {item.result.world}", *_cells(item.result)] for item in taught]
    return (
        f"## Delivery\nThe world `rooms` with {BOXES} boxes, from knowing nothing.\n\n"
        f"{markdown_table(header, rows)}\n\n"
        f"With the rules that were learnt in another world.\n\n{markdown_table(header, others)}\n"
    )


def _cells(result: Result) -> list[str]:
    def figure(value: float | None, unit: float, digits: int, name: str) -> str:
        return "–" if value is None else f"{value * unit:.{digits}f}{name}"

    return [
        f"{result.delivered} of {result.boxes}",
        str(result.collisions),
        str(result.learning_steps),
        str(result.actions),
        figure(result.path_ratio, 1.0, 2, ""),
        figure(result.localization_rmse_m, 100.0, 1, " cm"),
        figure(result.map_error_m, 100.0, 1, " cm"),
        figure(result.real_time_factor, 1.0, 0, ""),
    ]


Progress = Callable[[int, int], None]


def reproduce(folder: Path, progress: Progress) -> str:
    """Run the study and return it as Markdown.

    Args:
        folder: Where the runs' files go.
        progress: Told how many runs are done, of how many.
    """
    deliveries = []
    for done, delivery in enumerate(run(folder), start=1):
        deliveries.append(delivery)
        progress(done, runs())
    return markdown(deliveries)
