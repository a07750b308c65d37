"""A game in the terminal: the world, the condition with its names, what is foretold, and the rules learnt so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

BESIDE = 36  # columns that the terms need beside the drawing


@dataclass(frozen=True, slots=True)
class Row:
    """What is foretold of an action.

    Attributes:
        key: The key that does it.
        action: Its name.
        words: What it would change.
        worth: Its reward, in words.
        probability: How sure that is; None where nothing is said.
    """

    key: str
    action: str
    words: str
    worth: str
    probability: float | None


@dataclass(frozen=True, slots=True)
class Screen:
    """Everything that is shown at a time.

    Attributes:
        title: What is played, and how far.
        drawing: The world as text.
        condition: The terms' names, and whether they hold.
        rows: What is foretold of every action.
        rules: The rules, in words.
        new_rules: Those that were not there before the last step.
        told: What happened last.
        keys: Further keys, in words.
    """

    title: str
    drawing: str
    condition: Sequence[tuple[str, bool]]
    rows: Sequence[Row]
    rules: Sequence[str]
    new_rules: frozenset[str]
    told: str
    keys: str


def render(screen: Screen, width: int) -> RenderableType:
    """The screen for a terminal of some width, in columns."""
    drawing = Text(screen.drawing.rstrip("\n"))
    across = max(map(len, screen.drawing.splitlines()))
    beside = Table.grid(padding=(0, 3))
    beside.add_row(drawing, _condition(screen.condition))
    world: RenderableType = beside if across + BESIDE <= width else Group(drawing, _condition(screen.condition))
    return Group(
        Text(screen.title, style="bold"),
        world,
        Text(screen.told, style="bold cyan"),
        Text(),
        _foretold(screen.rows),
        Text(),
        Text(f"What was learnt ({len(screen.rules)} rules)", style="bold"),
        *(
            Text(
                f"{'+' if rule in screen.new_rules else ' '} {rule}", style="green" if rule in screen.new_rules else ""
            )
            for rule in screen.rules
        ),
        Text(screen.keys, style="dim"),
    )


def _condition(condition: Sequence[tuple[str, bool]]) -> Text:
    """cond(s) as signs, and every term on a line of its own."""
    text = Text("cond(s) = " + "".join("1" if holds else "0" for _, holds in condition) + "\n")
    for name, holds in condition:
        text.append(f"{'●' if holds else '○'} {name}\n", style="bold green" if holds else "dim")
    return text


def _foretold(rows: Sequence[Row]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for heading in ("key", "action", "the learner foretells", "reward", "sure"):
        table.add_column(heading)
    for row in rows:
        sure = "" if row.probability is None else f"{row.probability:.0%}"
        style = "yellow" if row.words == "UNKNOWN" else ""
        table.add_row(row.key, row.action, Text(row.words, style=style), row.worth, sure)
    return table
