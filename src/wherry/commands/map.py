"""``wherry map``: make a map from a lidar log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import OutputOptions, SeedOption, print_json, progress_bar, say
from wherry.commands.option_groups import with_option_groups
from wherry.commands.reading import LogArgument, ReadingGroup, TrajectoryFormatOption, parse_pose, say_notes
from wherry.commands.recording import RecordOption, recorded_log
from wherry.commands.run_folders import run_folder, write_result
from wherry.commands.watching import PageOptions, trace_sink

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.pipelines.logs.mapping import MappingRun, MappingSettings
    from wherry.pipelines.logs.trace import LogTrace

# Maps drawn along a log for the page and for the trace; few, since drawing takes longer than mapping a scan.
MAPS_SHOWN, MAPS_RECORDED = 60, 20
FIRST_MAP = 10  # number of scans after which the first map is drawn


@dataclass(frozen=True, slots=True)
class MapOptions:
    """Options of mapping; see `wherry.pipelines.logs.mapping.MappingSettings`."""

    odometry: Annotated[
        Path | None, typer.Option(help="Denser odometry to interpolate poses with: t x y θ per line.")
    ] = None
    relations: Annotated[Path | None, typer.Option(help="True relations between poses to score the trajectory by.")] = (
        None
    )
    backend: Annotated[str, typer.Option(help="SLAM method: graph or particles.")] = "graph"
    seed: SeedOption = 0
    resolution: Annotated[float, typer.Option(help="Side of a grid cell, m.")] = 0.05
    graph: Annotated[
        Path | None,
        typer.Option("--continue", metavar="GRAPH", help="Continue the map of a graph.npz of an earlier run."),
    ] = None
    start: Annotated[
        str | None,
        typer.Option(metavar="X,Y,θ", help="With --continue: approximate first pose on the map; m, m, degrees."),
    ] = None
    localize: Annotated[
        bool, typer.Option("--localize", help="With --continue: localize the robot without changing the map.")
    ] = False
    trajectory_format: TrajectoryFormatOption = "tum"


@with_option_groups
def map_log(
    log: LogArgument,
    options: MapOptions,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; by default runs/LOG-map.")] = None,
    record: RecordOption = None,
    *,
    reading: ReadingGroup,
    page: PageOptions,
    output: OutputOptions,
) -> None:
    """Make a map and a trajectory from recorded scans and odometry (SLAM)."""
    from wherry.pipelines.logs.mapping import prepare
    from wherry.pipelines.logs.trace import LogTrace
    from wherry.trace.records import Phase

    run = prepare(_settings(log, options, reading))
    console = output.console()
    with run_folder(out, log, "map") as folder, trace_sink(f"wherry: {log.name}", folder, console, page) as sink:
        maps = MAPS_SHOWN if page.view else MAPS_RECORDED
        _map(run, LogTrace(Phase.MAP, log.name, run.log, sink), console, record, maps)
        metrics = asdict(run.result)
        run.save(folder)
        write_result(folder, metrics)
        _print_result(console, log, run, metrics)
        say(console, f"Map, picture, trajectory, pose graph and loop closures: {folder}")
    if output.as_json:
        print_json(metrics)
    raise typer.Exit(1 if run.result.is_doubtful else 0)


def _settings(log: Path, options: MapOptions, reading: ReadingGroup) -> MappingSettings:
    """The settings of the pipeline."""
    from wherry.pipelines.logs.mapping import MappingSettings

    values = {field.name: getattr(options, field.name) for field in fields(options)}
    start = None if options.start is None else parse_pose("--start", options.start)
    return MappingSettings(log, reading=reading.options(), **(values | {"start": start}))


def _map(run: MappingRun, trace: LogTrace, console: Console, record: Path | None, maps: int) -> None:
    """Map the log with a progress bar and a trace with ``maps`` growing maps, and record a bag if one is asked for."""
    shown_at = _map_times(run.scans, maps)
    with recorded_log(record, run.log) as recording, progress_bar(console, "scans") as progress:
        task = progress.add_task("mapping", total=run.scans)
        for done in run.steps():
            progress.update(task, completed=done)
            if done:
                trace.scan(done - 1, run.pose)
            if done in shown_at:
                trace.map(run.slam.grid(), done - 1, fraction=done / run.scans)
                trace.loop_closures(done - 1, run.slam.loop_closures)
        if recording is not None:
            run.record(recording)
    trace.map(run.grid, run.scans - 1)
    trace.loop_closures(run.scans - 1, run.slam.loop_closures)


def _print_result(console: Console, log: Path, run: MappingRun, metrics: Mapping[str, object]) -> None:
    """Print verdict and notes, then the metrics and the reasons for rejected loop closures."""
    from wherry.mapping.loop_closure import count_rejections
    from wherry.views.metrics_tables import MAP_METRICS, MAPPING_METRICS
    from wherry.views.terminal import print_metrics, print_table

    say(console, run.result.verdict)
    say_notes(console, run.result.notes)
    labels = MAP_METRICS if run.settings.relations is None else MAPPING_METRICS
    print_metrics(console, f"Map of {log.name}", metrics, labels)
    rejections = count_rejections(run.slam.loop_closures)
    if rejections:
        rows = {reason.value: str(count) for reason, count in rejections.items()}
        print_table(console, "Loop closures rejected because", rows)


def _map_times(scans: int, maps: int) -> set[int]:
    """Numbers of scans after which the growing map is drawn, without the finished map."""
    return {FIRST_MAP, *(scans * part // maps for part in range(1, maps))} - {0, scans}
