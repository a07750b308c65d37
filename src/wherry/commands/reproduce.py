"""``wherry reproduce``: run the experiments behind docs/results.md."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import QuietOption, console_for, name_completion, progress_bar, say
from wherry.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

Progress = Callable[[int, int], None]
"""Called with the number of finished runs and their total."""


def _taxi(data: Path, images: Path, progress: Progress) -> str:
    from wherry.experiments.learning import taxi_table

    return taxi_table.reproduce(images, progress)


def _slam(data: Path, images: Path, progress: Progress) -> str:
    from wherry.experiments.mapping import table as slam_table

    return slam_table.reproduce(data, progress)


def _sites(data: Path, images: Path, progress: Progress) -> str:
    from wherry.experiments.mapping import large_site

    return large_site.reproduce(progress)


def _localization(data: Path, images: Path, progress: Progress) -> str:
    from wherry.experiments.localization import table as localization_table

    return localization_table.reproduce(data, images, progress)


def _maps(data: Path, images: Path, progress: Progress) -> str:
    from wherry.experiments.localization import foreign_maps

    return foreign_maps.reproduce(data, progress)


def _delivery(data: Path, images: Path, progress: Progress) -> str:
    from wherry.experiments.delivery import study as delivery_study

    with tempfile.TemporaryDirectory() as folder:
        return delivery_study.reproduce(Path(folder), progress)


def _figures(data: Path, images: Path, progress: Progress) -> str:
    from wherry.experiments import paper_figures

    return paper_figures.reproduce(images, progress)


REPRODUCTIONS: Mapping[str, Callable[[Path, Path, Progress], str]] = {
    "taxi": _taxi,
    "slam": _slam,
    "sites": _sites,
    "localization": _localization,
    "maps": _maps,
    "delivery": _delivery,
    "figures": _figures,
}
"""The experiments by name; each takes the folder of logs, the folder for pictures, and a progress callback.

An experiment returns its section of the results file as Markdown.
"""

PROJECT_FILE = "pyproject.toml"
RESULTS_FILE = Path("docs/results.md")  # default in a checkout; elsewhere it is results.md in the current folder


def reproduce(
    name: Annotated[
        str,
        typer.Argument(
            help=f"The experiment: {', '.join(REPRODUCTIONS)} or all.", autocompletion=name_completion(REPRODUCTIONS)
        ),
    ],
    data: Annotated[
        Path, typer.Option(envvar="WHERRY_DATA", help="Folder of recorded logs (docs/how-to/logs.md).")
    ] = Path("../shared/data"),
    out: Annotated[
        Path | None,
        typer.Option(
            help="Results file in which the section is written; pictures go to images/ beside it. By default "
            f"{RESULTS_FILE} in a checkout, else {RESULTS_FILE.name}."
        ),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Run an experiment of the documentation, and write its section of the results file."""
    from wherry.experiments.results import write_section

    if name != "all" and name not in REPRODUCTIONS:
        raise InputError("NAME", name, f"is none of {', '.join(REPRODUCTIONS)}, all")
    results = out or (
        RESULTS_FILE if Path(PROJECT_FILE).exists() and RESULTS_FILE.exists() else Path(RESULTS_FILE.name)
    )
    if not results.absolute().parent.is_dir():
        raise InputError("--out", str(results), "is in a folder that does not exist")
    console = console_for(as_json=False, quiet=quiet)
    for experiment in REPRODUCTIONS if name == "all" else [name]:
        markdown = _run(experiment, data, results.parent / "images", console)
        write_section(results, experiment, markdown)
        console.print(markdown, markup=False, highlight=False)
        say(console, f"Written to {results}")


def _run(name: str, data: Path, images: Path, console: Console) -> str:
    """Run one experiment with a progress bar, and return its Markdown."""
    with progress_bar(console, "runs") as bar:
        task = bar.add_task(name)

        def progress(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        return REPRODUCTIONS[name](data, images, progress)
