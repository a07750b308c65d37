"""Options and output shared by the commands."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wherry.learning.registry import RULE_LEARNERS, Job, LearnerEntry, learners_for

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress, Task


def learner_completion(learners: Mapping[str, LearnerEntry[Any]]) -> Callable[[str], list[tuple[str, str]]]:
    """A shell completion with the names and summaries of learners."""
    return lambda incomplete: [(name, entry.summary) for name, entry in learners.items() if name.startswith(incomplete)]


DELIVERY_LEARNERS = learners_for(Job.DELIVERY, RULE_LEARNERS)

JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on the last line.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print only errors, and what --json prints.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of the random number generator.")]

WorldArgument = Annotated[str, typer.Argument(help="A built-in world's name, or a world file.")]
BoxesOption = Annotated[int | None, typer.Option(help="Number of boxes; by default that of the world file.")]
MapOption = Annotated[Path | None, typer.Option("--map", help="A map.yaml to use instead of exploring.")]
RulesOption = Annotated[Path | None, typer.Option(help="Learnt rules to start with, as saved by an earlier run.")]
LearnerOption = Annotated[
    str,
    typer.Option(
        help=f"The learner: {' or '.join(DELIVERY_LEARNERS)}.", autocompletion=learner_completion(DELIVERY_LEARNERS)
    ),
]
ParamsOption = Annotated[Path | None, typer.Option(help="An amcl.yaml of nav2 or ROS 1.")]


@dataclass(frozen=True, slots=True)
class OutputOptions:
    """Options for the output of a command.

    Attributes:
        as_json: Whether to print the result as JSON.
        quiet: Whether to print only errors and the JSON.
    """

    as_json: JsonOption = False
    quiet: QuietOption = False

    def console(self) -> Console:
        """The console for human-readable output."""
        return console_for(as_json=self.as_json, quiet=self.quiet)


def console_for(*, as_json: bool, quiet: bool = False) -> Console:
    """The console for human-readable output: standard output, or standard error if JSON goes to standard output.

    Rich prints no colours or progress bars unless it is a terminal.
    """
    from rich.console import Console

    return Console(stderr=as_json, quiet=quiet)


def say(console: Console, line: str) -> None:
    """Print a line without wrapping and markup, so that paths in it can be copied or parsed."""
    console.print(line, highlight=False, markup=False, soft_wrap=True)


def help_without_command(context: typer.Context) -> None:
    """Print the help of a command group that is called without a command."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def name_completion(names: Iterable[str]) -> Callable[[str], list[str]]:
    """A shell completion with the given names."""
    return lambda incomplete: [name for name in names if name.startswith(incomplete)]


def print_json(result: Mapping[str, object]) -> None:
    """Print one JSON object on a line of its own, with numbers rounded to six decimals."""
    typer.echo(json_line(result))


def json_line(result: Mapping[str, object]) -> str:
    """One JSON object on one line, with numbers rounded to six decimals."""
    return json.dumps(_rounded(result), allow_nan=False)


def _rounded(value: object) -> object:
    """The value with all numbers in it rounded to six decimals."""
    if isinstance(value, float):
        return round(value, 6)
    if isinstance(value, Mapping):
        return {name: _rounded(entry) for name, entry in value.items()}
    return [_rounded(entry) for entry in value] if isinstance(value, list | tuple) else value


def progress_bar(console: Console, unit: str) -> Progress:
    """A progress bar with rate and remaining time; disabled unless the console is a terminal."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class RateColumn(ProgressColumn):
        """Units per second."""

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
