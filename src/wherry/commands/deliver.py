"""``wherry deliver``: a simulated delivery from exploration to report."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import (
    BoxesOption,
    LearnerOption,
    MapOption,
    OutputOptions,
    RulesOption,
    SeedOption,
    print_json,
    say,
)
from wherry.commands.option_groups import with_option_groups
from wherry.commands.recording import RecordOption, recorded
from wherry.commands.watching import PageOptions, recording_sink, trace_sink


@with_option_groups
def deliver(
    world: Annotated[str, typer.Option(help="A built-in world's name, or a world file.")] = "rooms",
    boxes: BoxesOption = None,
    seed: SeedOption = 0,
    map_file: MapOption = None,
    rules: RulesOption = None,
    learner: LearnerOption = "bayes",
    out: Annotated[
        Path | None, typer.Option(help="Where to write report, map and rules; without it, runs/WORLD-seedN.")
    ] = None,
    record: RecordOption = None,
    rerun: Annotated[Path | None, typer.Option(help="Record the run for the Rerun viewer: NAME.rrd.")] = None,
    video: Annotated[Path | None, typer.Option(help="Film the simulated world: NAME.mp4.")] = None,
    *,
    page: PageOptions,
    output: OutputOptions,
) -> None:
    """A robot explores a building, maps it, learns what its actions do, and delivers every box."""
    from wherry.kernels import are_kernels_cached
    from wherry.pipelines.delivery.simulated import DeliverySettings, prepare_delivery, warm_up
    from wherry.simulation.model import LASER_HEIGHT
    from wherry.trace.records import combine_sinks
    from wherry.views.terminal import DeliveryProgress, print_rules, print_table

    settings = DeliverySettings(
        world=world, boxes=boxes, seed=seed, map_file=map_file, rules_file=rules, learner=learner, out=out
    )
    has_kernels = are_kernels_cached()  # asked first, since preparing the run compiles some
    run = prepare_delivery(settings)
    console = output.console()
    if not has_kernels:
        console.print("Compiling the kernels: this takes half a minute and is done only once.")
        warm_up()
    for cell in run.unreachable:
        console.print(f"The box in column {cell.x + 1}, row {cell.y + 1} from the bottom cannot be reached.")
    with (
        recorded(record, laser_height=LASER_HEIGHT) as (recording, recorded_robot),
        recording_sink(run.simulation, rerun=rerun, video=video) as film,
        trace_sink(f"wherry: {run.plan.name}", run.out, console, page) as sink,
    ):
        with DeliveryProgress(console, len(run.plan.boxes)) as progress:
            result = run(combine_sinks(progress, sink, recording, film), recorded_robot)
        print_rules(console, run.rules)
        print_table(console, f"Delivery in {result.world}, seed {result.seed}: {result.verdict}", result.metrics)
        say(console, f"Pictures, map and rules: {run.out / 'report.html'}")
    for label, path in {"Bag": record, "Rerun": rerun, "Film": video}.items():
        if path is not None:
            say(console, f"{label}: {path}")
    if output.as_json:
        print_json(result.as_json())
    raise typer.Exit(result.exit_status)
