"""``wherry localize``: localization of a recorded log on a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import (
    LenientOption,
    LogArgument,
    OutputOptions,
    ParamsOption,
    SeedOption,
    print_json,
    progress_bar,
    say,
)
from wherry.commands.option_groups import with_option_groups
from wherry.commands.recording import RecordOption, recorded_log
from wherry.commands.watching import PageOptions, trace_sink

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.pipelines.logs.localization import LocalizationRun
    from wherry.pipelines.logs.trace import LogTrace
    from wherry.space.occupancy import OccupancyGrid
    from wherry.space.pose import Floats


@with_option_groups
def localize(
    log: LogArgument,
    map_file: Annotated[Path, typer.Option("--map", help="A map.yaml, a saved pose graph, or Wean Hall's wean.dat.")],
    params: ParamsOption = None,
    reference: Annotated[Path | None, typer.Option(help="Reference trajectory in TUM format.")] = None,
    everywhere: Annotated[bool, typer.Option("--global", help="Start anywhere on the map.")] = False,
    seed: SeedOption = 0,
    lenient: LenientOption = False,
    record: RecordOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the trajectory and a picture.")] = None,
    *,
    page: PageOptions,
    output: OutputOptions,
) -> None:
    """Estimate the robot's trajectory on a map from recorded scans and odometry (AMCL)."""
    from wherry.logs.options import ReadingOptions
    from wherry.pipelines.logs.localization import LocalizationSettings, prepare
    from wherry.pipelines.logs.trace import LogTrace
    from wherry.trace.records import Phase
    from wherry.views.metrics_tables import LOCALIZATION_METRICS
    from wherry.views.terminal import print_metrics

    run = prepare(
        LocalizationSettings(
            log=log,
            map_file=map_file,
            params=params,
            reference=reference,
            is_global=everywhere,
            seed=seed,
            reading=ReadingOptions(lenient),
        )
    )
    console = output.console()
    if _has_no_free_particle(run.grid, run.localizer.particles):
        say(console, "The map has no free space at the start pose of the log; --global searches the whole map.")
    with trace_sink(f"wherry: {log.name}", out, console, page) as sink:
        _localize_scans(run, LogTrace(Phase.LOCALIZE, log.name, run.log, sink), record, console)
        result = run.result()
        if result.unknown_parameters:
            say(console, f"Unknown parameters were ignored: {', '.join(result.unknown_parameters)}")
        metrics = result.as_dict()
        print_metrics(console, f"{log.name} on {map_file.name}", metrics, LOCALIZATION_METRICS)
        if out is None:
            console.print("Nothing was saved; --out DIR saves the trajectory and a picture.")
        else:
            say(console, "Written: " + ", ".join(str(path) for path in run.save(out)))
    if output.as_json:
        print_json(metrics)


def _localize_scans(run: LocalizationRun, trace: LogTrace, record: Path | None, console: Console) -> None:
    """Localize every scan, with progress, and record it in the trace and in a bag."""
    trace.map(run.grid)
    with recorded_log(record, run.log) as recording, progress_bar(console, "scans") as progress:
        task = progress.add_task("localizing", total=len(run))
        if recording is not None:
            recording.write_map(run.grid, run.log.scans[0].time)
        for scan in run.steps():
            progress.update(task, completed=scan.index + 1)
            trace.scan(scan.index, scan.localization.pose, run.localizer.particles)
            trace.lost_probability(scan.index, scan.localization.lost_probability)
            if recording is not None:
                recording.write_scan(scan.index, scan.localization.pose, run.localizer.particles)


def _has_no_free_particle(grid: OccupancyGrid, particles: Floats) -> bool:
    """Whether no particle [N, 3] m, m, rad, map frame, is in the map's free space."""
    cells = grid.cells_at(particles[:, :2])
    rows, columns = cells[grid.contains(cells)].T
    return not grid.free[rows, columns].any()
