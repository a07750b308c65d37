"""``wherry replay``: mapping and localization of a recorded bag."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import OutputOptions, ParamsOption, SeedOption, print_json, progress_bar, say
from wherry.commands.localize import localization_status, print_localization
from wherry.commands.option_groups import with_option_groups
from wherry.commands.reading import ReadingGroup, TrajectoryFormatOption, say_notes
from wherry.commands.run_folders import run_folder, write_result

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import TaskID

    from wherry.pipelines.logs.replay import ReplayRun


@with_option_groups
def replay(
    bag: Annotated[Path, typer.Argument(help="A ROS 1 .bag, a ROS 2 bag's folder, or an .mcap or .db3 file.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Map to localize on (map.yaml); by default the bag is mapped first.")
    ] = None,
    backend: Annotated[str, typer.Option(help="Method of mapping: graph or particles.")] = "graph",
    params: ParamsOption = None,
    everywhere: Annotated[bool, typer.Option("--global", help="Start localization anywhere on the map.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; by default runs/BAG-replay.")] = None,
    seed: SeedOption = 0,
    trajectory_format: TrajectoryFormatOption = "tum",
    *,
    reading: ReadingGroup,
    output: OutputOptions,
) -> None:
    """Map a bag's scans and odometry, and then localize them on that map.

    The errors of localization are the distances to the trajectory from mapping.
    """
    from wherry.pipelines.logs.replay import ReplaySettings, prepare

    console, options = output.console(), reading.options()
    with run_folder(out, bag, "replay") as folder:
        run = prepare(
            ReplaySettings(
                bag=bag,
                map_file=map_file,
                backend=backend,
                params=params,
                is_global=everywhere,
                out=folder,
                seed=seed,
                reading=options,
                trajectory_format=trajectory_format,
            )
        )
        _run(run, console)
        metrics = _metrics(bag, run)
        write_result(folder, metrics)
    _print_result(console, bag, run)
    say(console, f"Written to {folder}")
    if output.as_json:
        print_json(metrics)
    is_doubtful = run.mapping is not None and run.mapping.is_doubtful
    raise typer.Exit(1 if is_doubtful else localization_status(run.localization))


def _run(run: ReplayRun, console: Console) -> None:
    """Map and localize with a progress bar for each stage."""
    with progress_bar(console, "scans") as progress:
        tasks: dict[str, TaskID] = {}
        for stage, done, total in run.steps():
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            progress.update(tasks[stage], completed=done)


def _metrics(bag: Path, run: ReplayRun) -> dict[str, object]:
    """The metrics of both stages, with the notes on the bag."""
    mapping = None if run.mapping is None else asdict(run.mapping)
    localization = run.localization.as_dict() | asdict(run.drive)
    notes = dict.fromkeys((*(run.mapping.notes if run.mapping else ()), *run.drive.notes))
    return {"bag": str(bag), "notes": [*notes], "mapping": mapping, "localization": localization}


def _print_result(console: Console, bag: Path, run: ReplayRun) -> None:
    """Print verdicts, notes and metrics of both stages."""
    from wherry.views.metrics_tables import MAP_METRICS
    from wherry.views.terminal import print_metrics

    if run.mapping is not None:
        metrics = asdict(run.mapping)
        say(console, run.mapping.verdict)
        say_notes(console, [note for note in run.mapping.notes if note not in run.drive.notes])
        print_metrics(console, f"Map of {bag.name}", metrics, MAP_METRICS)
    print_localization(console, f"{bag.name} on {run.map_file.name}", run.localization, run.drive)
