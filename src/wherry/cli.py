"""The command line: parse, call, print. What computes is imported inside the commands, so that --help answers at once.

Exit status: 0 all went well, 1 the run ended without reaching its goal, 2 the input cannot be used, 130 stopped by
Ctrl-C.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry import __version__
from wherry.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

BAD_INPUT = 2
STOPPED = 130

app = typer.Typer(
    name="wherry",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Robots that find out by themselves how their world works, and then deliver.",
)

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object, as the last line.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Same seed, same run.")]


def main() -> None:
    """Run a command; turn bad input into one line and exit status 2."""
    try:
        app()
    except InputError as error:
        print(f"wherry: {error}", file=sys.stderr)  # noqa: T201 - the one place that prints errors
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        print("wherry: stopped", file=sys.stderr)  # noqa: T201
        sys.exit(STOPPED)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"wherry {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Options of wherry itself."""


def _console(*, as_json: bool) -> Console:
    """Where people read: standard output, or standard error when standard output is for JSON."""
    from rich.console import Console

    return Console(stderr=as_json)


def _print_json(result: Mapping[str, object]) -> None:
    typer.echo(json.dumps(result, allow_nan=False))


@app.command()
def deliver(
    world: Annotated[str, typer.Option(help="A built-in world's name, or a world file.")] = "rooms",
    boxes: Annotated[int | None, typer.Option(help="How many boxes; without it, what the world says.")] = None,
    seed: SeedOption = 0,
    map_file: Annotated[Path | None, typer.Option("--map", help="A map.yaml to use instead of exploring.")] = None,
    rules: Annotated[Path | None, typer.Option(help="Learnt rules to start with.")] = None,
    learner: Annotated[str, typer.Option(help="How the robot learns: bayes or doormax.")] = "bayes",
    out: Annotated[
        Path | None, typer.Option(help="Where to write report, map and rules; without it, runs/WORLD-seedN.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """A robot explores a building, maps it, learns what its actions do, and delivers every box."""
    from wherry.experiments import delivery
    from wherry.views.terminal import DeliveryProgress, print_rules, print_table

    settings = delivery.Settings(
        world=world, boxes=boxes, seed=seed, map_file=map_file, rules_file=rules, learner=learner, out=out
    )
    run = delivery.prepare(settings)
    console = _console(as_json=as_json)
    for cell in run.unreachable:
        console.print(f"The box in column {cell.x + 1}, row {cell.y + 1} from below cannot be reached by any robot.")
    with DeliveryProgress(console, len(run.plan.boxes)) as progress:
        result = run(progress)
    print_rules(console, run.rules)
    print_table(console, f"Delivery in {result.world}, seed {result.seed}: {result.status}", result.figures)
    console.print(f"Pictures, map and rules: {run.out / 'report.html'}")
    if as_json:
        _print_json(result.as_json())
    raise typer.Exit(result.exit_status)
