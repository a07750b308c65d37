"""Games: predictions are those of the learner, and the learner learns from the player's actions."""

from __future__ import annotations

from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.oomdp.domain import Action
from wherry.pipelines.grids.game_setups import GAME_SETUPS, PLAY_LEARNERS, GameSettings
from wherry.pipelines.grids.play import Game
from wherry.pipelines.grids.prediction_text import describe_changes


def predicted_changes(game: Game) -> dict[str, str | None]:
    return {str(entry.action): entry.changes for entry in game.predictions()}


@pytest.mark.parametrize("learner", PLAY_LEARNERS)
@pytest.mark.parametrize("domain", GAME_SETUPS)
def test_an_action_is_predicted_only_after_it_was_tried(domain: str, learner: str) -> None:
    game = Game(GameSettings(domain, learner=learner, seed=3))
    assert set(predicted_changes(game).values()) == {None}
    before = game.state
    game.act(Action("N"))
    assert game.message.startswith(f"N: {describe_changes(before, game.state)}")
    assert game.message.endswith("which was not predicted.")
    if game.state == before:
        assert predicted_changes(game)["N"] == "nothing changes"


@pytest.mark.parametrize("domain", GAME_SETUPS)
def test_the_suggested_actions_complete_episodes(domain: str) -> None:
    game = Game(GameSettings(domain, seed=1, learner="bayes"))
    for episode in range(1, 4):
        while not game.is_over:
            action = game.suggest_action()
            assert action is not None
            game.act(action)
        assert game.finished_episodes == episode
        assert "The episode ended after" in game.message
        with pytest.raises(RuntimeError):
            game.act(Action("N"))
        game.begin_episode()
    assert "N: if not touch_N" in "\n".join(game.rules)
    assert game.suggest_action() is not None


def test_the_drawing_shows_taxi_passenger_destination_and_robot() -> None:
    drawing = Game(GameSettings("taxi")).drawing
    assert [drawing.count(letter) for letter in "Tpd"] == [1, 1, 1]
    assert "R" in Game(GameSettings("delivery", boxes=1)).drawing


def test_changes_are_described_in_words() -> None:
    game = Game(GameSettings("delivery", boxes=1, seed=0))
    (box,) = game.state.of_class("Box")
    moved = game.state.replace("robot", x=game.state["robot"].x + 1)
    assert describe_changes(game.state, moved) == "robot.x += 1"
    assert describe_changes(game.state, game.state) == "nothing changes"
    assert describe_changes(game.state, game.state.replace(box.name, in_bot=True)) == f"{box.name}.in_bot := True"
    assert describe_changes(game.state, game.state.without(box.name)) == f"{box.name} leaves"


@pytest.mark.parametrize(
    ("settings", "source"),
    [
        (GameSettings("chess"), "DOMAIN"),
        (GameSettings("taxi", size=7), "--size"),
        (GameSettings("taxi", learner="oracle"), "--learner"),
        (GameSettings("delivery", world="nowhere"), "nowhere"),
        (GameSettings("taxi", rules=Path("gone.json")), "gone.json"),
    ],
)
def test_unknown_domains_sizes_learners_worlds_and_rules_are_refused(settings: GameSettings, source: str) -> None:
    with pytest.raises(InputError) as caught:
        Game(settings)
    assert caught.value.source == source
