"""``wherry play``: a domain played in the terminal, with a learner that learns from the player's actions."""

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

ARROW_KEYS = {"\x1b[A": "n", "\x1b[B": "s", "\x1b[C": "e", "\x1b[D": "w"}  # keys of the actions, by escape sequence
LEARNER_KEY, RESTART_KEY, QUIT_KEY = "l", "r", "q"
QUIT_SEQUENCES = {"\x03", "\x04", "\x1b"}  # Ctrl-C, Ctrl-D, Escape
KEYS_HELP = "arrows or n s e w, p, d: act   l: the learner acts   r: new episode   q: quit"


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
    """Play a domain in the terminal, with its terms, a learner's predictions, and the rules that it learns from you.

    In a terminal, keys act at once. A pipe is read line by line: keys, or names of actions.
    """
    from wherry.pipelines.grids.game_setups import GameSettings
    from wherry.pipelines.grids.play import Game
    from wherry.views.play_screen import render

    settings = GameSettings(domain, size, world, boxes, seed, learner, rules)
    game = Game(settings)
    console = console_for(as_json=as_json)
    single_keys = sys.stdin.isatty() and console.is_terminal
    earlier_rules = game.rules
    keys = _keys_from_terminal() if single_keys else _keys_from_lines(game)
    while True:
        if single_keys:
            console.clear()
        console.print(render(_screen(game, earlier_rules), console.width), highlight=False)
        key = next(keys, QUIT_KEY)
        if key == QUIT_KEY:
            break
        earlier_rules = game.rules
        _handle_key(game, key)
    if as_json:
        statistics = {
            "steps": game.total_steps,
            "episodes": game.finished_episodes,
            "surprises": game.wrong_predictions,
        }
        print_json({**statistics, "rules": len(game.rules)})


def _actions_by_key(game: Game) -> dict[str, Action]:
    """Return the actions by their keys, which are the first letters of their names."""
    return {action.name[0].lower(): action for action in game.actions}


def _handle_key(game: Game, key: str) -> None:
    """Act, restart, or report in the game's message why a key does nothing."""
    if key == RESTART_KEY:
        game.begin_episode()
        return
    action = game.suggest_action() if key == LEARNER_KEY else _actions_by_key(game).get(key)
    if game.is_over:
        game.message = "This episode is over. r begins a new one and keeps the learnt rules."
    elif action is not None:
        game.act(action)
    elif key == LEARNER_KEY:
        game.message = "The learner has nothing more to do."
    else:
        game.message = f"{key!r} is not a key. {KEYS_HELP}"


def _keys_from_lines(game: Game) -> Iterator[str]:
    """Yield keys from lines of standard input.

    The name of an action stands for its key. A word of several keys stands for each of them; other words are yielded
    whole.
    """
    for line in sys.stdin:
        for word in line.lower().split():
            actions = _actions_by_key(game)
            names = {action.name.lower(): key for key, action in actions.items()}
            if word in names:
                yield names[word]
            elif set(word) <= {*actions, LEARNER_KEY, RESTART_KEY, QUIT_KEY}:
                yield from word
            else:
                yield word


def _keys_from_terminal() -> Iterator[str]:
    """Yield keys as they are pressed; the terminal's mode is restored at the end."""
    import os
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal, termios.TCSANOW)  # TCSANOW keeps what was typed before
        while True:
            sequence = os.read(terminal, 8).decode("utf-8", errors="replace")
            if sequence in QUIT_SEQUENCES or not sequence:
                return
            yield from [ARROW_KEYS[sequence]] if sequence in ARROW_KEYS else sequence.lower()
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _screen(game: Game, earlier_rules: tuple[str, ...]) -> GameScreen:
    """Return the content of the screen.

    Args:
        game: The game.
        earlier_rules: Rules before the latest step.
    """
    from wherry.views.play_screen import GameScreen, PredictionRow

    keys = {action: key for key, action in _actions_by_key(game).items()}
    rows = [
        PredictionRow(keys[entry.action], str(entry.action), entry.changes, entry.reward, entry.probability)
        for entry in game.predictions()
    ]
    settings = game.settings
    place = f"Taxi {settings.size}×{settings.size}" if settings.domain == "taxi" else f"Delivery in {settings.world}"
    return GameScreen(
        title=f"{place}, learner {settings.learner}: step {game.steps}, return {game.episode_return:+g}, "
        f"episodes finished {game.finished_episodes}, wrong predictions {game.wrong_predictions}",
        drawing=game.drawing,
        condition=game.condition,
        rows=rows,
        rules=game.rules,
        new_rules=frozenset(game.rules) - frozenset(earlier_rules),
        message=game.message,
        keys=KEYS_HELP,
    )
