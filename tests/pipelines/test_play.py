"""Playing: what is foretold is what the learner predicts, and what is learnt is what was done."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.oomdp.domain import Action
from wherry.pipelines.grids.play import LEARNERS, TABLES, Game, Settings, changes_in_words


def foretold(game: Game) -> dict[str, str]:
    return {str(row.action): row.changes for row in game.predictions()}


@pytest.mark.parametrize("learner", LEARNERS)
@pytest.mark.parametrize("domain", TABLES)
def test_nothing_is_known_at_first_and_what_was_done_is_known_then(domain: str, learner: str) -> None:
    game = Game(Settings(domain, learner=learner, seed=3))
    assert set(foretold(game).values()) == {"UNKNOWN"}
    before = game.state
    game.do(Action("N"))
    assert game.told.startswith(f"N: {changes_in_words(before, game.state)}")
    assert game.told.endswith("which nobody knew.")
    if game.state == before:
        assert foretold(game)["N"] == "nothing changes"


@pytest.mark.parametrize("domain", TABLES)
def test_the_learner_plays_an_episode_to_its_end_and_the_next_one_quickly(domain: str) -> None:
    game = Game(Settings(domain, seed=1, learner="bayes"))
    for episode in range(1, 4):
        while not game.over:
            action = game.advise()
            assert action is not None
            game.do(action)
        assert game.episodes == episode
        assert "Done after" in game.told
        with pytest.raises(RuntimeError):
            game.do(Action("N"))
        game.begin()
    assert "N: if not touch_N" in "\n".join(game.rules)
    assert game.advise() is not None


def test_the_drawing_shows_who_is_where() -> None:
    drawing = Game(Settings("taxi")).drawing
    assert [drawing.count(letter) for letter in "Tpd"] == [1, 1, 1]
    assert "R" in Game(Settings("delivery", boxes=1)).drawing


def test_changes_are_told_in_words() -> None:
    game = Game(Settings("delivery", boxes=1, seed=0))
    (box,) = game.state.of_class("Box")
    moved = game.state.replace("robot", x=game.state["robot"].x + 1)
    assert changes_in_words(game.state, moved) == "robot.x += 1"
    assert changes_in_words(game.state, game.state) == "nothing changes"
    assert changes_in_words(game.state, game.state.replace(box.name, in_bot=True)) == f"{box.name}.in_bot := True"
    assert changes_in_words(game.state, game.state.without(box.name)) == f"{box.name} leaves"


@pytest.mark.parametrize(
    ("settings", "source"),
    [
        (Settings("chess"), "DOMAIN"),
        (Settings("taxi", size=7), "--size"),
        (Settings("taxi", learner="oracle"), "--learner"),
        (Settings("delivery", world="nowhere"), "nowhere"),
        (Settings("taxi", rules=Path("gone.json")), "gone.json"),
    ],
)
def test_what_there_is_not_is_refused(settings: Settings, source: str) -> None:
    with pytest.raises(InputError) as caught:
        Game(settings)
    assert caught.value.source == source
