"""``wherry map``: a lidar log becomes a map."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import JsonOption, QuietOption, SeedOption, console_for, print_json, progress_bar, shown
from wherry.commands.recording import RecordOption, recorded_log
from wherry.commands.watching import LOOPBACK, PORT, HostOption, PortOption, ViewOption, watched
from wherry.errors import InputError

if TYPE_CHECKING:
    from wherry.space.pose import Pose

MAPS_SHOWN = 60  # times that the growing map is drawn for those who watch; drawing takes longer than mapping a scan


def map_log(
    log: Annotated[Path, typer.Argument(help="A lidar log: CARMEN or Wean format, plain or gzipped, or a ROS bag.")],
    odometry: Annotated[
        Path | None, typer.Option(help="Denser odometry, t x y θ a line, to interpolate poses with.")
    ] = None,
    relations: Annotated[Path | None, typer.Option(help="True relations between poses, to score by.")] = None,
    backend: Annotated[str, typer.Option(help="The method: graph or particles.")] = "graph",
    out: Annotated[Path | None, typer.Option(help="Where to write map, picture, trajectory and pose graph.")] = None,
    seed: SeedOption = 0,
    resolution: Annotated[float, typer.Option(help="m, a grid cell's side.")] = 0.05,
    lenient: Annotated[bool, typer.Option("--lenient", help="Leave out broken lines, and count them.")] = False,
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
    view: ViewOption = False,
    host: HostOption = LOOPBACK,
    port: PortOption = PORT,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make a map and a trajectory of recorded scans and odometry (SLAM)."""
    from wherry.experiments import slam
    from wherry.experiments.log_trace import LogTrace
    from wherry.mapping.closures import refusals
    from wherry.mapping.graph_slam import GraphSlam
    from wherry.views.terminal import print_table

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
    console = console_for(as_json=as_json, quiet=quiet)
    with watched(f"wherry: {log.name}", out, console, view=view, host=host, port=port) as sink:
        trace = LogTrace("map", log.name, run.log, sink)
        shown_at = {run.scans * part // MAPS_SHOWN for part in range(1, MAPS_SHOWN)} if view else set()
        with recorded_log(record, run.log) as recording, progress_bar(console, "scans") as progress:
            task = progress.add_task("mapping", total=run.scans)
            for done in run.steps():
                progress.update(task, completed=done)
                if done:
                    trace.scan(done - 1, run.pose)
                if done in shown_at:
                    trace.map(run.slam.grid(), done - 1, fraction=done / run.scans)
            if recording is not None:
                run.record(recording)
        if view or out is not None:
            trace.map(run.slam.grid(), run.scans - 1)
        assert run.result is not None  # noqa: S101 - steps() ends by setting it
        figures = asdict(run.result)
        print_table(console, f"Map of {log.name}", {name: shown(value) for name, value in figures.items()})
        refused = refusals(run.slam.closures) if isinstance(run.slam, GraphSlam) else {}
        if refused:
            print_table(console, "Refused for", {gate: str(number) for gate, number in refused.items()})
        if out is not None:
            console.print(f"Map, picture, trajectory, pose graph and every closure with its reason: {out}")
    if as_json:
        print_json(figures)


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
