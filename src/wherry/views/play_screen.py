"""A game in the terminal: the world, the terms that hold, the learner's predictions, and the rules learnt so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

TERMS_WIDTH = 36  # columns that the terms need to the right of the drawing


@dataclass(frozen=True, slots=True)
class PredictionRow:
    """A learner's prediction for one action.

    Attributes:
        key: Key that does the action.
        action: Name of the action.
        changes: Predicted changes in words; "UNKNOWN" where the learner cannot tell.
        reward: Predicted reward in words.
        probability: Probability of the prediction; None where none is shown.
    """

    key: str
    action: str
    changes: str
    reward: str
    probability: float | None


@dataclass(frozen=True, slots=True)
class GameScreen:
    """Everything that is shown at a time.

    Attributes:
        title: Name and progress of the game.
        drawing: The world as text.
        condition: Names of the terms, each with whether it holds.
        rows: Prediction for every action.
        rules: Learnt rules, in words.
        new_rules: Rules that were learnt in the last step.
        message: What happened last, in words.
        keys: What the keys are for, in words.
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
    """Return the screen for a terminal of a width in columns."""
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
    table = Table(box=None, pad_edge=False, header_style="dim")
    for heading in ("key", "action", "the learner predicts", "reward", "probability"):
        table.add_column(heading)
    for row in rows:
        probability = "" if row.probability is None else f"{row.probability:.0%}"
        style = "yellow" if row.changes == "UNKNOWN" else ""
        table.add_row(row.key, row.action, Text(row.changes, style=style), row.reward, probability)
    return table
