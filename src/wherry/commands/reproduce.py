"""``wherry reproduce``: the tables of the docs, made again."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import console_for, progress_bar
from wherry.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

Progress = Callable[[int, int], None]


def _taxi(data: Path, folder: Path, progress: Progress) -> str:
    from wherry.experiments import taxi_table

    return taxi_table.reproduce(progress)


def _slam(data: Path, folder: Path, progress: Progress) -> str:
    from wherry.experiments import slam_table

    progress(0, 1)
    return f"## SLAM\n```\n{slam_table.table(slam_table.reproduce(data))}\n```\n"


def _localization(data: Path, folder: Path, progress: Progress) -> str:
    from wherry.experiments import localization_table

    return localization_table.reproduce(data, folder, progress)


def _delivery(data: Path, folder: Path, progress: Progress) -> str:
    from wherry.experiments import delivery_study

    return delivery_study.reproduce(folder, progress)


REPRODUCTIONS: Mapping[str, Callable[[Path, Path, Progress], str]] = {
    "taxi": _taxi,
    "slam": _slam,
    "localization": _localization,
    "delivery": _delivery,
}
"""Each takes the folder of recorded logs, a folder for its files and a progress, and returns Markdown."""


def reproduce(
    name: Annotated[str, typer.Argument(help=f"What: {', '.join(REPRODUCTIONS)} or all.")],
    data: Annotated[
        Path, typer.Option(envvar="WHERRY_DATA", help="The folder of recorded logs, with intel/ in it.")
    ] = Path("../shared/data"),
    out: Annotated[Path, typer.Option(help="The results file in which to write the section.")] = Path("results.md"),
) -> None:
    """Run an experiment of the docs again, and write its section of the results file."""
    from wherry.experiments.results import write_section

    if name != "all" and name not in REPRODUCTIONS:
        raise InputError("NAME", name, f"is none of {', '.join(REPRODUCTIONS)}, all")
    console = console_for(as_json=False)
    for chosen in REPRODUCTIONS if name == "all" else [name]:
        markdown = _run(chosen, data, console)
        write_section(out, chosen, markdown)
        console.print(markdown, markup=False, highlight=False)
        console.print(f"Written to {out}", highlight=False)


def _run(name: str, data: Path, console: Console) -> str:
    """One experiment's Markdown, with a bar while it is made."""
    with progress_bar(console, "runs") as bar, tempfile.TemporaryDirectory() as folder:
        task = bar.add_task(name)

        def progress(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        return REPRODUCTIONS[name](data, Path(folder), progress)
