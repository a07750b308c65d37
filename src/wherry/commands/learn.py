"""``wherry learn``: the published learning experiments."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wherry.commands.common import JsonOption, SeedOption, console_for, one_of, print_json, progress_bar, shown
from wherry.errors import InputError

DOMAINS = ("taxi",)


def learn(
    domain: Annotated[str, typer.Argument(help="What to learn: taxi.", autocompletion=one_of(DOMAINS))],
    size: Annotated[int, typer.Option(help="The grid's side: 5 or 10.")] = 5,
    learner: Annotated[
        str,
        typer.Option(
            help="bayes, doormax, doormax-near-miss, doormax-letter, factored-rmax, rmax, q-learning or "
            "q-learning-optimistic."
        ),
    ] = "doormax",
    repetitions: Annotated[int, typer.Option(help="How many learners, each from knowing nothing.")] = 20,
    seed: SeedOption = 0,
    rules_out: Annotated[Path | None, typer.Option(help="Where to save what the last learner knows, as JSON.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Run the published Taxi experiment: steps until the policy is optimal from six probes."""
    if domain not in DOMAINS:
        raise InputError("DOMAIN", domain, f"is none of {', '.join(DOMAINS)}")
    from wherry.experiments.taxi import Settings, TaxiExperiment
    from wherry.learning.rules import save_rules
    from wherry.views.terminal import print_rules, print_table

    experiment = TaxiExperiment(Settings(size=size, learner=learner, repetitions=repetitions, seed=seed))
    console = console_for(as_json=as_json)
    with progress_bar(console, "repetitions") as progress:
        task = progress.add_task("learning", total=repetitions)
        for _ in experiment.repetitions():
            progress.advance(task)
    result = experiment.result()
    if experiment.learner is not None:
        print_rules(console, experiment.learner.sentences())
        if rules_out is not None:
            save_rules(experiment.learner, rules_out)
    figures = result.as_json()
    print_table(console, f"Taxi {size}×{size}", {name: shown(value) for name, value in figures.items()})
    if as_json:
        print_json(figures)
    raise typer.Exit(0 if result.converged == result.repetitions else 1)
