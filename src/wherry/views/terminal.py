"""Progress of a delivery on a terminal: what is explored, what is unknown, what is delivered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from wherry.trace.records import MapUpdate, Narration, Record, StepTaken
from wherry.views.figures import Words, in_words, not_measured


class DeliveryProgress:
    """A sink that shows three bars and what the robot says; use it as a context manager.

    Args:
        console: Where to print; bars are left out where it is not a terminal.
        boxes: How many boxes there are to deliver.
    """

    def __init__(self, console: Console, boxes: int) -> None:
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description:<10}"),
            BarColumn(bar_width=30),
            TextColumn("{task.fields[words]}"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._explored = self._progress.add_task("explored", total=1.0, words="")
        self._unknown = self._progress.add_task("learnt", total=None, words="", start=False)
        self._delivered = self._progress.add_task("delivered", total=boxes, words=f"0 of {boxes} boxes", start=False)
        self._most_unknown = 0
        self._started: set[TaskID] = set()

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._progress.stop()

    def __call__(self, record: Record) -> None:
        """Show a record."""
        match record:
            case Narration(time=time, phase=phase, text=text):
                console = self._progress.console
                line = f"[dim]{time:7.1f} s[/dim]  [bold]{phase:<8}[/bold] {escape(text)}"
                console.print(line, highlight=False, soft_wrap=not console.is_terminal)
            case MapUpdate(explored_fraction=fraction, frontier_length=frontier):
                words = f"{fraction:.0%}, {frontier:.1f} m of frontier left"
                self._progress.update(self._explored, completed=fraction, words=words)
            case StepTaken():
                self._step(record)
            case _:
                pass  # too much, or too often, for a terminal

    def _step(self, step: StepTaken) -> None:
        for task in (self._unknown, self._delivered):
            if task not in self._started:
                self._progress.start_task(task)
                self._started.add(task)
        self._progress.stop_task(self._explored)
        self._most_unknown = max(self._most_unknown, step.unknown_pairs, 1)
        words = f"{step.unknown_pairs} unknown pairs left   {step.condition} {step.action}"
        self._progress.update(
            self._unknown, total=self._most_unknown, completed=self._most_unknown - step.unknown_pairs, words=words
        )
        total = step.delivered + step.remaining
        self._progress.update(
            self._delivered, total=total, completed=step.delivered, words=f"{step.delivered} of {total} boxes"
        )


def print_figures(console: Console, title: str, figures: Mapping[str, object], words: Words) -> None:
    """Print what was measured as a closing table, in words and with units, and below it what was not.

    Args:
        console: Where to print.
        title: Of the table.
        figures: By their names in JSON.
        words: What people call them, of `wherry.views.figures`.
    """
    _print_rows(console, title, in_words(figures, words))
    lacking = not_measured(figures, words)
    if lacking:
        console.print(f"Not measured: {', '.join(lacking)}.", highlight=False, soft_wrap=True)


def print_table(console: Console, title: str, figures: Mapping[str, str]) -> None:
    """Print figures, name and value, as a closing table."""
    _print_rows(console, title, figures.items())


def _print_rows(console: Console, title: str, rows: Iterable[tuple[str, str]]) -> None:
    table = Table(title=escape(title), show_header=False, title_justify="left")
    table.add_column(style="dim")
    table.add_column(justify="right")
    for name, value in rows:
        table.add_row(escape(name), escape(value))
    console.print(table)


def print_rules(console: Console, rules: Sequence[str]) -> None:
    """Print what was learnt, a rule a line."""
    console.print("[bold]What is known of the actions[/bold]")
    for rule in rules:
        console.print(f"  {rule}", highlight=False, markup=False, soft_wrap=True)
