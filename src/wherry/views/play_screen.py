"""The screen of a game in the terminal: the world, the terms, the learner's predictions, and the learnt rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

TERMS_WIDTH = 36  # columns of the terms to the right of the drawing
UNKNOWN_TEXT = "UNKNOWN"  # shown for an action whose effects the learner does not predict


@dataclass(frozen=True, slots=True)
class PredictionRow:
    """A learner's prediction for one action.

    Attributes:
        key: Key for the action.
        action: Name of the action.
        changes: Predicted changes in words; None where the learner does not predict them.
        reward: Predicted reward in words.
        probability: Probability of the prediction; None not to show one.
    """

    key: str
    action: str
    changes: str | None
    reward: str
    probability: float | None


@dataclass(frozen=True, slots=True)
class GameScreen:
    """The content of the screen.

    Attributes:
        title: Name and progress of the game.
        drawing: The world as text.
        condition: Names of the terms, each with whether it holds.
        rows: Predictions, a row for each action.
        rules: Learnt rules, in words.
        new_rules: Rules that were learnt in the latest step.
        message: Result of the latest key, in words.
        keys: Functions of the keys, in words.
    """

    title: str
    drawing: str
    condition: Sequence[tuple[str, bool]]
    rows: Sequence[PredictionRow]
    rules: Sequence[str]
    new_rules: frozenset[str]
    message: str
    keys: str


def render(screen: GameScreen, width: int) -> RenderableType:
    """Return the screen for a terminal of the given width, columns."""
    drawing = Text(screen.drawing.rstrip("\n"))
    drawing_width = max(map(len, screen.drawing.splitlines()))
    beside = Table.grid(padding=(0, 3))
    beside.add_row(drawing, _condition(screen.condition))
    world: RenderableType = (
        beside if drawing_width + TERMS_WIDTH <= width else Group(drawing, _condition(screen.condition))
    )
    return Group(
        Text(screen.title, style="bold"),
        world,
        Text(screen.message, style="bold cyan"),
        Text(),
        _prediction_table(screen.rows),
        Text(),
        Text(f"Learnt rules ({len(screen.rules)})", style="bold"),
        *(
            Text(
                f"{'+' if rule in screen.new_rules else ' '} {rule}", style="green" if rule in screen.new_rules else ""
            )
            for rule in screen.rules
        ),
        Text(screen.keys, style="dim"),
    )


def _condition(condition: Sequence[tuple[str, bool]]) -> Text:
    """Return cond(s) as bits, and every term on a line of its own."""
    text = Text("cond(s) = " + "".join("1" if holds else "0" for _, holds in condition) + "\n")
    for name, holds in condition:
        text.append(f"{'●' if holds else '○'} {name}\n", style="bold green" if holds else "dim")
    return text


def _prediction_table(rows: Sequence[PredictionRow]) -> Table:
    """Return a table of the predictions, a row for each action."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    for heading in ("key", "action", "the learner predicts", "reward", "probability"):
        table.add_column(heading)
    for row in rows:
        probability = "" if row.probability is None else f"{row.probability:.0%}"
        changes = Text(UNKNOWN_TEXT, style="yellow") if row.changes is None else Text(row.changes)
        table.add_row(row.key, row.action, changes, row.reward, probability)
    return table
