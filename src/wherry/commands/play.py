"""``wherry play``: a domain played by hand, with a learner that watches."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import BoxesOption, JsonOption, SeedOption, console_for, one_of, print_json

if TYPE_CHECKING:
    from wherry.oomdp.domain import Action
    from wherry.pipelines.grids.play import Game
    from wherry.views.play_screen import Screen

DOMAINS = ("taxi", "delivery")
LEARNERS = ("bayes", "doormax", "doormax-near-miss")

ARROWS = {"\x1b[A": "n", "\x1b[B": "s", "\x1b[C": "e", "\x1b[D": "w"}
LEARNER, AGAIN, QUIT = "l", "r", "q"
STOP = {"\x03", "\x04", "\x1b"}  # Ctrl-C, Ctrl-D, Escape
KEYS = "arrows or n s e w, p, d: act   l: the learner acts   r: begin anew   q: quit"


def play(
    domain: Annotated[str, typer.Argument(help=f"{' or '.join(DOMAINS)}.", autocompletion=one_of(DOMAINS))],
    size: Annotated[int, typer.Option(help="The Taxi grid's side: 5 or 10.")] = 5,
    world: Annotated[str, typer.Option(help="Where to deliver: a built-in world's name, or a world file.")] = "small",
    boxes: BoxesOption = None,
    seed: SeedOption = 0,
    learner: Annotated[str, typer.Option(help=f"{', '.join(LEARNERS)}.", autocompletion=one_of(LEARNERS))] = "bayes",
    rules: Annotated[Path | None, typer.Option(help="Learnt rules that the learner begins with.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Play a domain in the terminal: its terms, what a learner foretells, and the rules that it learns from you.

    Keys act at once. What comes through a pipe is read line by line: keys, or an action's name.
    """
    from wherry.pipelines.grids.play import Game, Settings
    from wherry.views.play_screen import render

    game = Game(Settings(domain=domain, size=size, world=world, boxes=boxes, seed=seed, learner=learner, rules=rules))
    console = console_for(as_json=as_json)
    single_keys = sys.stdin.isatty() and console.is_terminal
    known = game.rules
    keys = _pressed() if single_keys else _typed(game)
    while True:
        if single_keys:
            console.clear()
        console.print(render(_screen(game, known), console.width), highlight=False)
        key = next(keys, QUIT)
        if key == QUIT:
            break
        known = game.rules
        _obey(game, key)
    if as_json:
        print_json(
            {"steps": game.all_steps, "episodes": game.episodes, "surprises": game.surprises, "rules": len(game.rules)}
        )


def keys_of(game: Game) -> dict[str, Action]:
    """The key of every action: its first letter."""
    return {action.name[0].lower(): action for action in game.actions}


def _obey(game: Game, key: str) -> None:
    """Do what a key stands for."""
    if key == AGAIN:
        game.begin()
        return
    action = game.advise() if key == LEARNER else keys_of(game).get(key)
    if game.over:
        game.told = "This one is over; r begins anew, and what was learnt stays."
    elif action is not None:
        game.do(action)
    elif key == LEARNER:
        game.told = "The learner has nothing more to do."
    else:
        game.told = f"{key!r} means nothing. {KEYS}"


def _typed(game: Game) -> Iterator[str]:
    """Keys from lines: an action's name stands for its key, a word of nothing but keys for each of them."""
    for line in sys.stdin:
        for word in line.lower().split():
            actions = keys_of(game)
            names = {action.name.lower(): key for key, action in actions.items()}
            if word in names:
                yield names[word]
            elif set(word) <= {*actions, LEARNER, AGAIN, QUIT}:
                yield from word
            else:
                yield word


def _pressed() -> Iterator[str]:
    """Single keys, without waiting for a new line; the terminal is put back as it was."""
    import os
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal, termios.TCSANOW)  # what was typed before counts, too
        while True:
            typed = os.read(terminal, 8).decode("utf-8", errors="replace")
            if typed in STOP or not typed:
                return
            yield from [ARROWS[typed]] if typed in ARROWS else typed.lower()
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _screen(game: Game, known: tuple[str, ...]) -> Screen:
    """What is to be seen now.

    Args:
        game: The game.
        known: The rules before the last step.
    """
    from wherry.views.play_screen import Row, Screen

    keys = {action: key for key, action in keys_of(game).items()}
    rows = [
        Row(keys[row.action], str(row.action), row.changes, row.reward, row.probability) for row in game.predictions()
    ]
    settings = game.settings
    place = f"Taxi {settings.size}×{settings.size}" if settings.domain == "taxi" else f"Delivery in {settings.world}"
    return Screen(
        title=f"{place}, watched by {settings.learner}: step {game.steps}, reward {game.total:+g}, "
        f"{game.episodes} done before, {game.surprises} surprises",
        drawing=game.drawing,
        condition=game.condition,
        rows=rows,
        rules=game.rules,
        new_rules=frozenset(game.rules) - frozenset(known),
        told=game.told,
        keys=KEYS,
    )
