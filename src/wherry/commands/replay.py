"""``wherry replay``: mapping and localization of a recorded bag."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import (
    OutputOptions,
    ParamsOption,
    SeedOption,
    print_json,
    progress_bar,
    say,
)
from wherry.commands.option_groups import with_option_groups

if TYPE_CHECKING:
    from rich.progress import TaskID


@with_option_groups
def replay(
    bag: Annotated[Path, typer.Argument(help="A ROS 1 .bag, a ROS 2 bag's folder, or an .mcap or .db3 file.")],
    map_file: Annotated[
        Path | None, typer.Option("--map", help="Map to localize on (map.yaml); by default the bag is mapped first.")
    ] = None,
    backend: Annotated[str, typer.Option(help="Method of mapping: graph or particles.")] = "graph",
    params: ParamsOption = None,
    everywhere: Annotated[bool, typer.Option("--global", help="Start localization anywhere on the map.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; by default runs/NAME-replay.")] = None,
    seed: SeedOption = 0,
    lenient: Annotated[bool, typer.Option("--lenient", help="Skip broken messages, and count them.")] = False,
    *,
    output: OutputOptions,
) -> None:
    """Map a bag's scans and odometry, and then localize them on that map.

    The errors of localization are the distances to the trajectory from mapping.
    """
    from wherry.pipelines.logs.replay import ReplaySettings, prepare
    from wherry.views.metrics_tables import LOCALIZATION_METRICS, MAPPING_METRICS
    from wherry.views.terminal import print_metrics

    run = prepare(
        ReplaySettings(
            bag=bag,
            map_file=map_file,
            backend=backend,
            params=params,
            is_global=everywhere,
            out=out or Path("runs") / f"{bag.stem}-replay",
            seed=seed,
            lenient=lenient,
        )
    )
    console = output.console()
    with progress_bar(console, "scans") as progress:
        tasks: dict[str, TaskID] = {}
        for stage, done, total in run.steps():
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=total)
            progress.update(tasks[stage], completed=done)
    metrics: dict[str, object] = {"bag": str(bag), "mapping": None}
    if run.mapping is not None:
        metrics["mapping"] = asdict(run.mapping)
        print_metrics(console, f"Map of {bag.name}", asdict(run.mapping), MAPPING_METRICS)
    localization = run.localization.as_dict()
    metrics["localization"] = localization
    print_metrics(console, f"{bag.name} on {run.map_file.name}", localization, LOCALIZATION_METRICS)
    say(console, f"Written to {run.out}")
    if output.as_json:
        print_json(metrics)
