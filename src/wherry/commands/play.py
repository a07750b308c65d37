"""``wherry play``: a domain played by hand, with a learner that watches."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wherry.commands.common import (
    BoxesOption,
    JsonOption,
    SeedOption,
    console_for,
    learner_completion,
    name_completion,
    print_json,
)
from wherry.learning.registry import RULE_LEARNERS, Job, learners_for

if TYPE_CHECKING:
    from wherry.oomdp.domain import Action
    from wherry.pipelines.grids.play import Game
    from wherry.views.play_screen import GameScreen

DOMAINS = ("taxi", "delivery")
LEARNERS = learners_for(Job.PLAY, RULE_LEARNERS)

ARROWS = {"\x1b[A": "n", "\x1b[B": "s", "\x1b[C": "e", "\x1b[D": "w"}
ADVISE, RESTART, QUIT = "l", "r", "q"
QUIT_KEYS = {"\x03", "\x04", "\x1b"}  # Ctrl-C, Ctrl-D, Escape
KEYS = "arrows or n s e w, p, d: act   l: the learner acts   r: new episode   q: quit"


def play(
    domain: Annotated[str, typer.Argument(help=f"{' or '.join(DOMAINS)}.", autocompletion=name_completion(DOMAINS))],
    size: Annotated[int, typer.Option(help="The Taxi grid's side: 5 or 10.")] = 5,
    world: Annotated[str, typer.Option(help="Where to deliver: a built-in world's name, or a world file.")] = "small",
    boxes: BoxesOption = None,
    seed: SeedOption = 0,
    learner: Annotated[
        str, typer.Option(help=f"{', '.join(LEARNERS)}.", autocompletion=learner_completion(LEARNERS))
    ] = "bayes",
    rules: Annotated[Path | None, typer.Option(help="Learnt rules that the learner begins with.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Play a domain in the terminal: its terms, what a learner predicts, and the rules that it learns from you.

    Keys act at once. What comes through a pipe is read line by line: keys, or an action's name.
    """
    from wherry.pipelines.grids.game_setups import GameSettings
    from wherry.pipelines.grids.play import Game
    from wherry.views.play_screen import render

    settings = GameSettings(domain, size, world, boxes, seed, learner, rules)
    game = Game(settings)
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
    """Return the actions by their keys, which are their first letters."""
    return {action.name[0].lower(): action for action in game.actions}


def _obey(game: Game, key: str) -> None:
    """Do what a key is for."""
    if key == RESTART:
        game.begin()
        return
    action = game.advise() if key == ADVISE else keys_of(game).get(key)
    if game.over:
        game.message = "This episode is over; r begins a new one, and what was learnt is kept."
    elif action is not None:
        game.do(action)
    elif key == ADVISE:
        game.message = "The learner has nothing more to do."
    else:
        game.message = f"{key!r} means nothing. {KEYS}"


def _typed(game: Game) -> Iterator[str]:
    """Yield keys from lines of text: an action's name is read as its key, a word made of keys as each of them."""
    for line in sys.stdin:
        for word in line.lower().split():
            actions = keys_of(game)
            names = {action.name.lower(): key for key, action in actions.items()}
            if word in names:
                yield names[word]
            elif set(word) <= {*actions, ADVISE, RESTART, QUIT}:
                yield from word
            else:
                yield word


def _pressed() -> Iterator[str]:
    """Yield single keys without waiting for a new line; the terminal's mode is restored at the end."""
    import os
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal, termios.TCSANOW)  # what was typed before counts, too
        while True:
            typed = os.read(terminal, 8).decode("utf-8", errors="replace")
            if typed in QUIT_KEYS or not typed:
                return
            yield from [ARROWS[typed]] if typed in ARROWS else typed.lower()
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _screen(game: Game, known: tuple[str, ...]) -> GameScreen:
    """Return what the terminal shows.

    Args:
        game: The game.
        known: Rules before the last step.
    """
    from wherry.views.play_screen import GameScreen, PredictionRow

    keys = {action: key for key, action in keys_of(game).items()}
    rows = [
        PredictionRow(keys[entry.action], str(entry.action), entry.changes, entry.reward, entry.probability)
        for entry in game.predictions()
    ]
    settings = game.settings
    place = f"Taxi {settings.size}×{settings.size}" if settings.domain == "taxi" else f"Delivery in {settings.world}"
    return GameScreen(
        title=f"{place}, watched by {settings.learner}: step {game.steps}, reward {game.total:+g}, "
        f"{game.episodes} episodes finished, {game.surprises} surprises",
        drawing=game.drawing,
        condition=game.condition,
        rows=rows,
        rules=game.rules,
        new_rules=frozenset(game.rules) - frozenset(known),
        message=game.message,
        keys=KEYS,
    )
