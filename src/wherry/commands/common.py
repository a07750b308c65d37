"""What the commands share: options that mean the same everywhere, and where to print."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wherry.learning.registry import RULE_LEARNERS, Job, LearnerEntry, learners_for

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, Task


def learner_completion(learners: Mapping[str, LearnerEntry[Any]]) -> Callable[[str], list[tuple[str, str]]]:
    """Return a completion that offers learners to the shell, each with its summary."""
    return lambda incomplete: [(name, entry.summary) for name, entry in learners.items() if name.startswith(incomplete)]


DELIVERY_LEARNERS = learners_for(Job.DELIVERY, RULE_LEARNERS)

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object, as the last line.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors, and what --json prints.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Same seed, same run.")]

WorldArgument = Annotated[str, typer.Argument(help="A built-in world's name, or a world file.")]
BoxesOption = Annotated[int | None, typer.Option(help="How many boxes; without it, what the world says.")]
MapOption = Annotated[Path | None, typer.Option("--map", help="A map.yaml to use instead of exploring.")]
RulesOption = Annotated[Path | None, typer.Option(help="Learnt rules to start with.")]
LearnerOption = Annotated[
    str,
    typer.Option(
        help=f"How the robot learns: {' or '.join(DELIVERY_LEARNERS)}.",
        autocompletion=learner_completion(DELIVERY_LEARNERS),
    ),
]
LogArgument = Annotated[
    Path, typer.Argument(help="A lidar log: CARMEN or Wean format, plain or gzipped, or a ROS bag.")
]
LenientOption = Annotated[bool, typer.Option("--lenient", help="Leave out broken lines, and count them.")]
ParamsOption = Annotated[Path | None, typer.Option(help="An amcl.yaml, of nav2 or of ROS 1.")]


def console_for(*, as_json: bool, quiet: bool = False) -> Console:
    """Where people read: standard output, or standard error when standard output is for JSON.

    Colours, bars and moving lines are left out where that is not a terminal.
    """
    from rich.console import Console

    return Console(stderr=as_json, quiet=quiet)


def say(console: Console, line: str) -> None:
    """Print a line as it is, and whole, so that a path in it can be copied, or found by another program."""
    console.print(line, highlight=False, markup=False, soft_wrap=True)


def help_without_command(context: typer.Context) -> None:
    """Print the help of a group of commands where none of them is called."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def one_of(names: Iterable[str]) -> Callable[[str], list[str]]:
    """What a shell offers to complete an option or an argument with."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


def print_json(result: Mapping[str, object]) -> None:
    """Print one JSON object on a line of its own, figures rounded to what they can be trusted for."""
    typer.echo(json.dumps(_rounded(result), allow_nan=False))


def _rounded(value: object) -> object:
    """The value with all floats in it rounded."""
    if isinstance(value, float):
        return round(value, 6)
    if isinstance(value, Mapping):
        return {name: _rounded(entry) for name, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list | tuple) else value


def progress_bar(console: Console, unit: str) -> Progress:
    """A bar with a rate and the time that is left; nothing where the console is not a terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class RateColumn(ProgressColumn):
        """How many are done in a second."""

        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:,.0f} {unit}/s" if task.speed else "")

    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        RateColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal or console.quiet,
    )
