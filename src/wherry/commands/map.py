"""``wherry map``: a lidar log becomes a map."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import JsonOption, QuietOption, SeedOption, console_for, print_json, progress_bar, shown
from wherry.commands.recording import RecordOption, recorded_log


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
    record: RecordOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Make a map and a trajectory of recorded scans and odometry (SLAM)."""
    from wherry.experiments import slam
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
        )
    )
    console = console_for(as_json=as_json, quiet=quiet)
    with recorded_log(record, run.log) as recording, progress_bar(console, "scans") as progress:
        task = progress.add_task("mapping", total=run.scans)
        for done in run.steps():
            progress.update(task, completed=done)
        if recording is not None:
            run.record(recording)
    assert run.result is not None  # noqa: S101 - steps() ends by setting it
    figures = asdict(run.result)
    print_table(console, f"Map of {log.name}", {name: shown(value) for name, value in figures.items()})
    if out is not None:
        console.print(f"Map, picture, trajectory and pose graph: {out}")
    if as_json:
        print_json(figures)
