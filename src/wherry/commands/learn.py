"""``wherry learn``: the published learning experiment, with any learner and in several domains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import (
    OutputOptions,
    SeedOption,
    learner_completion,
    name_completion,
    print_json,
    progress_bar,
    say,
)
from wherry.commands.option_groups import with_option_groups
from wherry.commands.watching import PageOptions, trace_sink
from wherry.errors import InputError
from wherry.pipelines.grids.learners import LEARNERS

if TYPE_CHECKING:
    from rich.console import Console

    from wherry.pipelines.grids.learning import LearningExperiment

DOMAINS = ("taxi", "delivery", "gymnasium-taxi")
INFERENCES = {"memorise": "doormax", "near-miss": "doormax-near-miss"}
"""The registered learners by the values of ``--inference``."""

LEARNER_CHOICES = {
    name: entry for name, entry in LEARNERS.items() if name == "doormax" or name not in INFERENCES.values()
}
"""The values of ``--learner``; variants of DOORMAX are chosen by ``--inference``."""


@with_option_groups
def learn(
    domain: Annotated[str, typer.Argument(help=f"{', '.join(DOMAINS)}.", autocompletion=name_completion(DOMAINS))],
    size: Annotated[int, typer.Option(help="The Taxi grid's side: 5 or 10.")] = 5,
    world: Annotated[str, typer.Option(help="Where to deliver: a built-in world's name, or a world file.")] = "small",
    learner: Annotated[
        str, typer.Option(help=f"{', '.join(LEARNER_CHOICES)}.", autocompletion=learner_completion(LEARNER_CHOICES))
    ] = "doormax",
    inference: Annotated[
        str | None,
        typer.Option(
            help="How DOORMAX uses failures: memorise, as in the paper, or near-miss, which needs fewer steps and "
            "assumes one conjunctive condition per action.",
            autocompletion=name_completion(INFERENCES),
        ),
    ] = None,
    repetitions: Annotated[int, typer.Option(help="Number of repetitions, each without prior knowledge.")] = 20,
    seed: SeedOption = 0,
    rules_out: Annotated[Path | None, typer.Option(help="JSON file for the rules of the last repetition.")] = None,
    out: Annotated[Path | None, typer.Option(help="Picture of the learning curve: a .png or an .svg file.")] = None,
    *,
    page: PageOptions,
    output: OutputOptions,
) -> None:
    """Count a learner's steps until its policy is optimal from six probes, as in the published Taxi experiment."""
    if out is not None and out.suffix not in (".png", ".svg"):
        raise InputError("--out", str(out), "must end in .png or .svg")
    name = _learner_name(learner, inference)
    if rules_out is not None and name in LEARNERS and not LEARNERS[name].has_rules:
        raise InputError("--rules-out", str(rules_out), f"{name} learns no rules that could be saved")
    from wherry.pipelines.grids.learning import LearningExperiment, LearningSettings

    experiment = LearningExperiment(
        LearningSettings(size=size, learner=name, repetitions=repetitions, seed=seed, domain=domain, world=world)
    )
    console = output.console()
    with trace_sink("wherry: learning", None, console, page) as sink:
        experiment.sink = sink if page.view else None
        _run(experiment, console)
    result = experiment.result()
    _report_rules(experiment, console, rules_out)
    _report_statistics(experiment, console)
    if out is not None:
        _draw_curve(experiment, out)
        say(console, f"Learning curve: {out}")
    if output.as_json:
        print_json(result.as_json())
    raise typer.Exit(0 if result.converged == result.repetitions else 1)


def _learner_name(learner: str, inference: str | None) -> str:
    """Return the registered name for the values of ``--learner`` and ``--inference``."""
    if inference is None:
        return learner
    if inference not in INFERENCES:
        raise InputError("--inference", inference, f"is none of {', '.join(INFERENCES)}")
    if learner != "doormax":
        raise InputError("--inference", inference, f"is an option of doormax, not of {learner}")
    return INFERENCES[inference]


def _run(experiment: LearningExperiment, console: Console) -> None:
    """Run all repetitions and show their progress."""
    settings = experiment.settings
    with progress_bar(console, "repetitions") as progress:
        task = progress.add_task(f"{settings.learner}: {experiment.arena.title}", total=settings.repetitions)
        for _ in experiment.repetitions():
            progress.advance(task)


def _report_rules(experiment: LearningExperiment, console: Console, rules_out: Path | None) -> None:
    """Print the rules of the last learner, and save them if a file is given."""
    if experiment.learner is None:
        return
    from wherry.learning.rule_files.files import save_rules
    from wherry.views.terminal import print_rules

    print_rules(console, experiment.learner.sentences())
    if rules_out is not None:
        save_rules(experiment.learner, rules_out)


def _report_statistics(experiment: LearningExperiment, console: Console) -> None:
    """Print the statistics of all repetitions."""
    from wherry.views.metrics_tables import LEARNING_METRICS
    from wherry.views.terminal import print_metrics

    print_metrics(console, experiment.arena.title, experiment.result().as_json(), LEARNING_METRICS)


def _draw_curve(experiment: LearningExperiment, out: Path) -> None:
    """Draw the learning curve of all repetitions to a file."""
    from wherry.files import write_atomically
    from wherry.views.learning_curve import as_bytes, learning_curves

    arena, curves = experiment.arena, [run.curve for run in experiment.result().runs]
    figure = learning_curves({experiment.settings.learner: curves}, len(arena.probes), arena.title)
    write_atomically(out, as_bytes(figure, "svg" if out.suffix == ".svg" else "png"))
