"""``wherry map``: a lidar log becomes a map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
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
    from wherry.mapping.closures import Closure
    from wherry.mapping.slam import Slam
    from wherry.space.pose import Pose

MAPS_SHOWN, MAPS_RECORDED = 60, 20  # times that the growing map is drawn, which takes longer than mapping a scan
FIRST_MAP = 10  # scans after which it is drawn for the first time


@with_option_groups
def map_log(
    log: LogArgument,
    odometry: Annotated[
        Path | None, typer.Option(help="Denser odometry, t x y θ a line, to interpolate poses with.")
    ] = None,
    relations: Annotated[Path | None, typer.Option(help="True relations between poses, to score by.")] = None,
    backend: Annotated[str, typer.Option(help="The method: graph or particles.")] = "graph",
    out: Annotated[Path | None, typer.Option(help="Where to write map, picture, trajectory and pose graph.")] = None,
    seed: SeedOption = 0,
    resolution: Annotated[float, typer.Option(help="m, a grid cell's side.")] = 0.05,
    lenient: LenientOption = False,
    graph: Annotated[
        Path | None, typer.Option("--continue", metavar="GRAPH", help="Go on with the map of a graph.npz of --out.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(metavar="X,Y,θ", help="With --continue: about where the log begins; m, m, degrees.")
    ] = None,
    localize: Annotated[
        bool, typer.Option("--localize", help="With --continue: follow the robot, leave the map as it is.")
    ] = False,
    record: RecordOption = None,
    *,
    page: PageOptions,
    output: OutputOptions,
) -> None:
    """Make a map and a trajectory of recorded scans and odometry (SLAM)."""
    from wherry.mapping.closures import refusals
    from wherry.pipelines.logs import mapping as slam
    from wherry.pipelines.logs.trace import LogTrace
    from wherry.views.metrics_tables import MAPPING_METRICS, REJECTION_LABELS
    from wherry.views.terminal import print_metrics, print_table

    run = slam.prepare(
        slam.Settings(
            log=log,
            odometry=odometry,
            relations=relations,
            backend=backend,
            out=out,
            seed=seed,
            resolution=resolution,
            lenient=lenient,
            graph=graph,
            start=None if start is None else _pose(start),
            localize=localize,
        )
    )
    console = output.console()
    with trace_sink(f"wherry: {log.name}", out, console, page) as sink:
        trace = LogTrace("map", log.name, run.log, sink)
        shown_at = _map_times(run.scans, MAPS_SHOWN if page.view else MAPS_RECORDED if out is not None else 0)
        with recorded_log(record, run.log) as recording, progress_bar(console, "scans") as progress:
            task = progress.add_task("mapping", total=run.scans)
            for done in run.steps():
                progress.update(task, completed=done)
                if done:
                    trace.scan(done - 1, run.pose)
                if done in shown_at:
                    trace.map(run.slam.grid(), done - 1, fraction=done / run.scans)
                    trace.loop_closures(done - 1, _closures(run.slam))
            if recording is not None:
                run.record(recording)
        if page.view or out is not None:
            trace.map(run.slam.grid(), run.scans - 1)
            trace.loop_closures(run.scans - 1, _closures(run.slam))
        assert run.result is not None  # noqa: S101 - steps() ends by setting it
        figures = asdict(run.result)
        print_metrics(console, f"Map of {log.name}", figures, MAPPING_METRICS)
        refused = {
            REJECTION_LABELS.get(gate, gate): str(number) for gate, number in refusals(_closures(run.slam)).items()
        }
        if refused:
            print_table(console, "Loops refused because", refused)
        if out is None:
            console.print("Nothing was saved; --out DIR saves map, picture, trajectory and pose graph.")
        else:
            say(console, f"Map, picture, trajectory, pose graph and every closure with its reason: {out}")
    if output.as_json:
        print_json(figures)


def _map_times(scans: int, maps: int) -> set[int]:
    """After how many scans to draw the growing map, so many times over a log; the finished map comes after them."""
    return {FIRST_MAP, *(scans * part // maps for part in range(1, maps))} - {0, scans} if maps else set()


def _closures(slam: Slam) -> Sequence[Closure]:
    """The loops that were tried; a method without a graph tries none."""
    from wherry.mapping.graph_slam import GraphSlam

    return slam.closures if isinstance(slam, GraphSlam) else ()


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
