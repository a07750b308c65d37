"""``wherry bench``: wherry's times beside those of external implementations."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import JsonOption, QuietOption, console_for, name_completion, print_json
from wherry.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from wherry.experiments.bench import BenchResult, Timing

NAMES = ("learning", "slam", "localization", "planning")


def bench(
    name: Annotated[str, typer.Argument(help=f"{', '.join(NAMES)}.", autocompletion=name_completion(NAMES))],
    data: Annotated[
        Path,
        typer.Option(envvar="WHERRY_DATA", help="For slam: folder of recorded logs (docs/how-to/logs.md)."),
    ] = Path("../shared/data"),
    efficient_rl: Annotated[
        Path | None,
        typer.Option(
            envvar="WHERRY_EFFICIENT_RL",
            help="For learning: Python interpreter of an environment in which efficient_rl is installed.",
        ),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Measure wherry's times and those of external implementations; published times where these are not installed."""
    if name not in NAMES:
        raise InputError("NAME", name, f"is none of {', '.join(NAMES)}")
    from wherry.experiments.bench import BenchSettings, run_bench

    console = console_for(as_json=as_json, quiet=quiet)
    with console.status("measuring") as status:
        result = run_bench(name, BenchSettings(data, efficient_rl), lambda task: status.update(f"measuring: {task}"))
    console.print(_table(result))
    if as_json:
        times = [_as_json(timing, result) for timing in result.timings]
        print_json({"bench": name, "load": result.load, "times": times})


def _as_json(timing: Timing, result: BenchResult) -> dict[str, object]:
    return {
        "task": timing.task,
        "who": timing.implementation,
        "ms": round(timing.milliseconds, 4),
        "ratio": result.ratio(timing),
        "source": timing.source.value,
    }


def _table(result: BenchResult) -> Table:
    """Return a table with a row for each timing and its ratio to wherry's time."""
    from rich.table import Table

    table = Table(title=f"{result.name}: medians, at a {result.load}", title_justify="left")
    for heading in ("task", "implementation", "ms", "× wherry", "measured"):
        table.add_column(heading, justify="right" if heading in ("ms", "× wherry") else "left")
    previous_task = ""
    for timing in result.timings:
        ratio = result.ratio(timing)
        table.add_row(
            timing.task if timing.task != previous_task else "",
            timing.implementation,
            f"{timing.milliseconds:,.2f}" if timing.milliseconds < 1000 else f"{timing.milliseconds:,.0f}",
            "" if ratio is None else f"{ratio:,.1f}" if ratio < 100 else f"{ratio:,.0f}",
            timing.source.value,
            style="bold" if timing.is_own else "",
        )
        previous_task = timing.task
    return table
