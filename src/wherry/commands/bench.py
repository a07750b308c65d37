"""``wherry bench``: how long things take, beside others."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import JsonOption, QuietOption, console_for, one_of, print_json
from wherry.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from wherry.experiments.bench import Bench

NAMES = ("learning", "slam", "localization", "planning")


def bench(
    name: Annotated[str, typer.Argument(help=f"{', '.join(NAMES)}.", autocompletion=one_of(NAMES))],
    data: Annotated[
        Path, typer.Option(envvar="WHERRY_DATA", help="The folder of recorded logs, with intel/ in it, for slam.")
    ] = Path("../shared/data"),
    efficient_rl: Annotated[
        Path | None,
        typer.Option(
            envvar="WHERRY_EFFICIENT_RL",
            help="The Python interpreter of an environment in which efficient_rl is installed, for learning.",
        ),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Measure how long things take, beside others where they are installed, else beside what they have published."""
    if name not in NAMES:
        raise InputError("NAME", name, f"is none of {', '.join(NAMES)}")
    from wherry.experiments.bench import Outside, run

    console = console_for(as_json=as_json, quiet=quiet)
    with console.status("measuring") as status:
        measured = run(name, Outside(data, efficient_rl), lambda doing: status.update(f"measuring: {doing}"))
    console.print(_table(measured))
    if as_json:
        rows = [
            {"task": row.task, "who": row.who, "ms": round(row.milliseconds, 4), "ratio": measured.ratio(row),
             "source": row.source}
            for row in measured.times
        ]  # fmt: skip
        print_json({"bench": name, "load": measured.load, "times": rows})


def _table(measured: Bench) -> Table:
    """One row a time; how many times longer than ours others take."""
    from rich.table import Table

    table = Table(title=f"{measured.name}: medians, at a {measured.load}", title_justify="left")
    for heading in ("task", "who", "ms", "× ours", "measured"):
        table.add_column(heading, justify="right" if heading in ("ms", "× ours") else "left")
    last = ""
    for row in measured.times:
        ratio = measured.ratio(row)
        table.add_row(
            row.task if row.task != last else "",
            row.who,
            f"{row.milliseconds:,.2f}" if row.milliseconds < 1000 else f"{row.milliseconds:,.0f}",
            "" if ratio is None else f"{ratio:,.1f}" if ratio < 100 else f"{ratio:,.0f}",
            row.source,
            style="bold" if row.ours else "",
        )
        last = row.task
    return table
