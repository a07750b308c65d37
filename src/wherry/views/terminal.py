"""Progress and results printed to a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from wherry.trace.records import MapUpdate, Narration, Record, RunStarted, StepTaken
from wherry.views.metrics_tables import MetricLabels, format_metrics, unmeasured_metrics


class DeliveryProgress:
    """A sink that shows progress as three bars and prints narrations; use it as a context manager.

    Args:
        console: The console; without a terminal, no bars are shown.
        boxes: Number of boxes to deliver.
    """

    def __init__(self, console: Console, boxes: int) -> None:
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description:<10}"),
            BarColumn(bar_width=30),
            TextColumn("{task.fields[status]}"),
            TimeElapsedColumn(),
            console=console,
            disable=not console.is_terminal,
        )
        self._explored = self._progress.add_task("explored", total=1.0, status="")
        self._unknown = self._progress.add_task("learnt", total=None, status="", start=False)
        self._delivered = self._progress.add_task("delivered", total=boxes, status=f"0 of {boxes} boxes", start=False)
        self._max_unknown = 0
        self._started: set[TaskID] = set()
        self._terms: tuple[str, ...] = ()

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._progress.stop()

    def __call__(self, record: Record) -> None:
        """Update the bars, or print a narration."""
        match record:
            case RunStarted():
                self._terms = record.terms
            case Narration(time=time, phase=phase, text=text):
                console = self._progress.console
                line = f"[dim]{time:7.1f} s[/dim]  [bold]{phase:<8}[/bold] {escape(text)}"
                console.print(line, highlight=False, soft_wrap=not console.is_terminal)
            case MapUpdate(explored_fraction=fraction, frontier_length=frontier):
                status = f"{fraction:.0%}, {frontier:.1f} m of frontier left"
                self._progress.update(self._explored, completed=fraction, status=status)
            case StepTaken():
                self._show_step(record)
            case _:
                pass  # snapshots and models are too detailed for a terminal

    def _show_step(self, step: StepTaken) -> None:
        for task in (self._unknown, self._delivered):
            if task not in self._started:
                self._progress.start_task(task)
                self._started.add(task)
        self._progress.stop_task(self._explored)
        self._max_unknown = max(self._max_unknown, step.unknown_pairs, 1)
        self._progress.update(
            self._unknown,
            total=self._max_unknown,
            completed=self._max_unknown - step.unknown_pairs,
            status=f"{step.unknown_pairs} unknown pairs left   {step.action} · {self._true_terms(step.condition)}",
        )
        total = step.delivered + step.remaining
        self._progress.update(
            self._delivered, total=total, completed=step.delivered, status=f"{step.delivered} of {total} boxes"
        )

    def _true_terms(self, condition: str) -> str:
        """Names of the terms that are true in a condition."""
        names = [term for term, bit in zip(self._terms, condition, strict=False) if bit == "1"]
        return ", ".join(names) or "no term holds"


def print_metrics(console: Console, title: str, metrics: Mapping[str, object], labels: MetricLabels) -> None:
    """Print measured metrics as a table with labels and units, and below it the names of the others.

    Args:
        console: The console.
        title: Title of the table.
        metrics: Values by their names in JSON.
        labels: Labels and formats from `wherry.views.metrics_tables`.
    """
    _print_rows(console, title, format_metrics(metrics, labels))
    unmeasured = unmeasured_metrics(metrics, labels)
    if unmeasured:
        console.print(f"Not measured: {', '.join(unmeasured)}.", highlight=False, soft_wrap=True)


def print_table(console: Console, title: str, rows: Mapping[str, str]) -> None:
    """Print names and values as a table."""
    _print_rows(console, title, rows.items())


def _print_rows(console: Console, title: str, rows: Iterable[tuple[str, str]]) -> None:
    table = Table(title=escape(title), show_header=False, title_justify="left")
    table.add_column(style="dim")
    table.add_column(justify="right")
    for name, value in rows:
        table.add_row(escape(name), escape(value))
    console.print(table)


def print_rules(console: Console, rules: Sequence[str]) -> None:
    """Print learnt rules, one per line."""
    console.print("[bold]Learnt rules[/bold]")
    for rule in rules:
        console.print(f"  {rule}", highlight=False, markup=False, soft_wrap=True)
