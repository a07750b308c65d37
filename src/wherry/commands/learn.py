"""``wherry learn``: the published learning experiment, in several domains and with every learner."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import (
    OutputOptions,
    SeedOption,
    one_of,
    print_json,
    progress_bar,
    say,
)
from wherry.commands.option_groups import with_option_groups
from wherry.commands.watching import PageOptions, trace_sink
from wherry.errors import InputError

DOMAINS = ("taxi", "delivery", "gymnasium-taxi")
LEARNERS = (
    "bayes",
    "doormax",
    "doormax-letter",
    "factored-rmax",
    "factored-rmax-minimal",
    "rmax",
    "q-learning",
    "q-learning-optimistic",
)
INFERENCES = ("memorise", "near-miss")


@with_option_groups
def learn(
    domain: Annotated[str, typer.Argument(help=f"{', '.join(DOMAINS)}.", autocompletion=one_of(DOMAINS))],
    size: Annotated[int, typer.Option(help="The Taxi grid's side: 5 or 10.")] = 5,
    world: Annotated[str, typer.Option(help="Where to deliver: a built-in world's name, or a world file.")] = "small",
    learner: Annotated[str, typer.Option(help=f"{', '.join(LEARNERS)}.", autocompletion=one_of(LEARNERS))] = "doormax",
    inference: Annotated[
        str | None,
        typer.Option(
            help="What DOORMAX makes of failures: memorise, as in the paper, or near-miss, which needs fewer steps and "
            "assumes one conjunctive condition per action.",
            autocompletion=one_of(INFERENCES),
        ),
    ] = None,
    repetitions: Annotated[int, typer.Option(help="How many learners, each from knowing nothing.")] = 20,
    seed: SeedOption = 0,
    rules_out: Annotated[Path | None, typer.Option(help="Where to save what the last learner knows, as JSON.")] = None,
    out: Annotated[Path | None, typer.Option(help="Where to draw the learning curve: a .png or an .svg file.")] = None,
    *,
    page: PageOptions,
    output: OutputOptions,
) -> None:
    """Count the steps until a learner's policy is optimal from six probes, as published for Taxi."""
    if out is not None and out.suffix not in (".png", ".svg"):
        raise InputError("--out", str(out), "must end in .png or .svg")
    chosen = _learner(learner, inference)
    from wherry.files import write_atomically
    from wherry.learning.rule_files.files import save_rules
    from wherry.pipelines.grids.learning import Settings, TaxiExperiment
    from wherry.views.metrics_tables import LEARNING_METRICS
    from wherry.views.terminal import print_metrics, print_rules

    experiment = TaxiExperiment(
        Settings(size=size, learner=chosen, repetitions=repetitions, seed=seed, domain=domain, world=world)
    )
    console = output.console()
    with trace_sink("wherry: learning", None, console, page) as sink:
        experiment.watch = sink if page.view else None
        with progress_bar(console, "repetitions") as progress:
            task = progress.add_task(f"{chosen}: {experiment.arena.title}", total=repetitions)
            for _ in experiment.repetitions():
                progress.advance(task)
    result = experiment.result()
    if experiment.learner is not None:
        print_rules(console, experiment.learner.sentences())
        if rules_out is not None:
            save_rules(experiment.learner, rules_out)
    figures = result.as_json()
    print_metrics(console, experiment.arena.title, figures, LEARNING_METRICS)
    if out is not None:
        from wherry.views.learning_curve import as_bytes, learning_curves

        figure = learning_curves(
            {chosen: [run.curve for run in result.runs]}, len(experiment.arena.probes), experiment.arena.title
        )
        write_atomically(out, as_bytes(figure, "svg" if out.suffix == ".svg" else "png"))
        say(console, f"Learning curve: {out}")
    if output.as_json:
        print_json(figures)
    raise typer.Exit(0 if result.converged == result.repetitions else 1)


def _learner(learner: str, inference: str | None) -> str:
    """The experiment's name for a learner with a way to infer."""
    if inference is None:
        return learner
    if inference not in INFERENCES:
        raise InputError("--inference", inference, f"is none of {', '.join(INFERENCES)}")
    if learner != "doormax":
        raise InputError("--inference", inference, f"is DOORMAX's, not of {learner}")
    return "doormax-near-miss" if inference == "near-miss" else learner
