"""``wherry localize``: localization of a recorded log on a map."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import OutputOptions, ParamsOption, SeedOption, print_json, progress_bar, say
from wherry.commands.option_groups import with_option_groups
from wherry.commands.reading import LogArgument, ReadingGroup, TrajectoryFormatOption, say_notes
from wherry.commands.recording import RecordOption, recorded_log
from wherry.commands.run_folders import run_folder, write_result
from wherry.commands.watching import PageOptions, trace_sink

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.pipelines.logs.localization import LocalizationResult, LocalizationRun
    from wherry.pipelines.logs.summary import DriveSummary
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
    record: RecordOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; by default runs/LOG-localize.")] = None,
    trajectory_format: TrajectoryFormatOption = "tum",
    *,
    reading: ReadingGroup,
    page: PageOptions,
    output: OutputOptions,
) -> None:
    """Estimate the robot's trajectory on a map from recorded scans and odometry (AMCL)."""
    from wherry.pipelines.logs.localization import LocalizationSettings, prepare
    from wherry.pipelines.logs.summary import DriveSummary
    from wherry.pipelines.logs.trace import LogTrace
    from wherry.trace.records import Phase

    run = prepare(
        LocalizationSettings(
            log=log,
            map_file=map_file,
            params=params,
            reference=reference,
            is_global=everywhere,
            seed=seed,
            reading=reading.options(),
            trajectory_format=trajectory_format,
        )
    )
    console = output.console()
    if _has_no_free_particle(run.grid, run.localizer.particles):
        say(console, "The map has no free space at the start pose of the log; --global searches the whole map.")
    with run_folder(out, log, "localize") as folder, trace_sink(f"wherry: {log.name}", folder, console, page) as sink:
        _localize_scans(run, LogTrace(Phase.LOCALIZE, log.name, run.log, sink), record, console)
        result, drive = run.result(), DriveSummary.of(run.log, run.trajectory.poses)
        if result.unknown_parameters:
            say(console, f"Unknown parameters were ignored: {', '.join(result.unknown_parameters)}")
        metrics = result.as_dict() | asdict(drive)
        written = run.save(folder)
        write_result(folder, metrics)
        print_localization(console, f"{log.name} on {map_file.name}", result, drive)
        say(console, "Written: " + ", ".join(str(path) for path in written))
    if output.as_json:
        print_json(metrics)
    raise typer.Exit(localization_status(result))


def print_localization(console: Console, title: str, result: LocalizationResult, drive: DriveSummary) -> None:
    """Print verdicts, notes and metrics of a localization run and of its drive."""
    from wherry.views.metrics_tables import DRIVE_METRICS, LOCALIZATION_METRICS, REFERENCE_METRICS
    from wherry.views.terminal import print_metrics

    for line in (result.verdict, result.reference_verdict):
        if line is not None:
            say(console, line)
    say_notes(console, drive.notes)
    labels = {**DRIVE_METRICS, **LOCALIZATION_METRICS, **(REFERENCE_METRICS if result.reference_scans else {})}
    print_metrics(console, title, result.as_dict() | asdict(drive), labels)


def localization_status(result: LocalizationResult) -> int:
    """The exit status: 1 if the scans do not fit the map, or fit in part only and the robot is lost at the end."""
    from wherry.localization.parameters import LOST_PROBABILITY_THRESHOLD
    from wherry.pipelines.logs.verdicts import GOOD_FIT

    is_lost_on_other_map = result.fit < GOOD_FIT and result.lost_probability > LOST_PROBABILITY_THRESHOLD
    return 0 if result.fits_map and not is_lost_on_other_map else 1


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
