"""``wherry map``: make a map from a lidar log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import (
    LenientOption,
    LogArgument,
    OutputOptions,
    SeedOption,
    print_json,
    progress_bar,
    say,
)
from wherry.commands.option_groups import with_option_groups
from wherry.commands.recording import RecordOption, recorded_log
from wherry.commands.watching import PageOptions, trace_sink
from wherry.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.pipelines.logs.mapping import MappingRun, MappingSettings
    from wherry.pipelines.logs.trace import LogTrace
    from wherry.space.pose import Pose

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
    out: Annotated[Path | None, typer.Option(help="Folder for map, picture, trajectory and pose graph.")] = None
    seed: SeedOption = 0
    resolution: Annotated[float, typer.Option(help="Side of a grid cell, m.")] = 0.05
    lenient: LenientOption = False
    graph: Annotated[
        Path | None,
        typer.Option("--continue", metavar="GRAPH", help="Continue the map of a graph.npz that --out wrote."),
    ] = None
    start: Annotated[
        str | None,
        typer.Option(metavar="X,Y,θ", help="With --continue: approximate first pose on the map; m, m, degrees."),
    ] = None
    localize: Annotated[
        bool, typer.Option("--localize", help="With --continue: localize the robot without changing the map.")
    ] = False


@with_option_groups
def map_log(
    log: LogArgument, options: MapOptions, record: RecordOption = None, *, page: PageOptions, output: OutputOptions
) -> None:
    """Make a map and a trajectory from recorded scans and odometry (SLAM)."""
    from wherry.pipelines.logs.mapping import prepare
    from wherry.pipelines.logs.trace import LogTrace
    from wherry.trace.records import Phase

    run = prepare(_settings(log, options))
    console = output.console()
    with trace_sink(f"wherry: {log.name}", options.out, console, page) as sink:
        maps = MAPS_SHOWN if page.view else MAPS_RECORDED if options.out is not None else 0
        _map(run, LogTrace(Phase.MAP, log.name, run.log, sink), console, record, maps)
        metrics = asdict(run.result)
        _print_result(console, log, run, metrics)
    if output.as_json:
        print_json(metrics)


def _settings(log: Path, options: MapOptions) -> MappingSettings:
    """The settings of the pipeline."""
    from wherry.pipelines.logs.mapping import MappingSettings

    values = {field.name: getattr(options, field.name) for field in fields(options)}
    return MappingSettings(log, **(values | {"start": None if options.start is None else _pose(options.start)}))


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
    if maps:
        trace.map(run.slam.grid(), run.scans - 1)
        trace.loop_closures(run.scans - 1, run.slam.loop_closures)


def _print_result(console: Console, log: Path, run: MappingRun, metrics: Mapping[str, object]) -> None:
    """Print the metrics, the reasons for rejected loop closures, and the folder of the results."""
    from wherry.mapping.loop_closure import count_rejections
    from wherry.views.metrics_tables import MAPPING_METRICS
    from wherry.views.terminal import print_metrics, print_table

    print_metrics(console, f"Map of {log.name}", metrics, MAPPING_METRICS)
    rejections = count_rejections(run.slam.loop_closures)
    if rejections:
        rows = {reason.value: str(count) for reason, count in rejections.items()}
        print_table(console, "Loop closures rejected because", rows)
    if run.settings.out is None:
        console.print("Nothing was saved; --out DIR saves map, picture, trajectory and pose graph.")
    else:
        say(console, f"Map, picture, trajectory, pose graph and loop closures: {run.settings.out}")


def _map_times(scans: int, maps: int) -> set[int]:
    """Numbers of scans after which the growing map is drawn, without the finished map."""
    return {FIRST_MAP, *(scans * part // maps for part in range(1, maps))} - {0, scans} if maps else set()


def _pose(text: str) -> Pose:
    """A pose from ``x,y,θ`` in metres and degrees."""
    from wherry.space.pose import Pose

    try:
        x, y, degrees = (float(word) for word in text.split(","))
    except ValueError as error:
        raise InputError("--start", text, "must be x,y,θ in metres and degrees") from error
    if not all(math.isfinite(value) for value in (x, y, degrees)):
        raise InputError("--start", text, "must be finite")
    return Pose(x, y, math.radians(degrees))
