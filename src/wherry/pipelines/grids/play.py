"""A domain played by a person, while a learner learns from the actions and predicts each of them beforehand.

The player is shown the learner's inputs and outputs: the state, its condition, and the prediction for every action.
"""

from __future__ import annotations

import numpy as np

from wherry.environments.rendering import render_text
from wherry.errors import InputError
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import State
from wherry.pipelines.grids.game_setups import GAME_SETUPS, PLAY_LEARNERS, GameSettings
from wherry.pipelines.grids.prediction_text import PredictionText, describe_changes, describe_prediction


class Game:
    """A game of any number of episodes.

    Args:
        settings: Settings of the game.

    Raises:
        InputError: There is no such domain, size, world or learner, or the rules cannot be used.

    Attributes:
        settings: Settings of the game.
        state: Current state s.
        steps: Number of steps in the current episode.
        total_steps: Number of steps in all episodes.
        finished_episodes: Number of episodes that have ended.
        episode_return: Sum of the rewards in the current episode, not discounted.
        wrong_predictions: Number of wrong predictions in all episodes.
        is_over: Whether the current episode has ended.
        message: Result of the latest action, in words.
    """

    def __init__(self, settings: GameSettings) -> None:
        if settings.domain not in GAME_SETUPS:
            raise InputError("DOMAIN", settings.domain, f"is none of {', '.join(GAME_SETUPS)}")
        if settings.learner not in PLAY_LEARNERS:
            raise InputError("--learner", settings.learner, f"is none of {', '.join(PLAY_LEARNERS)}")
        self.settings = settings
        self._setup = GAME_SETUPS[settings.domain](settings)
        self._rng = np.random.default_rng(settings.seed)
        self.finished_episodes, self.wrong_predictions, self.total_steps = 0, 0, 0
        self.begin_episode()

    @property
    def actions(self) -> tuple[Action, ...]:
        """The actions of the current state."""
        return self._setup.mdp.domain.ground_actions(self.state)

    @property
    def drawing(self) -> str:
        """The world as text."""
        return render_text(self._setup.plan, self._setup.sprites(self.state))

    @property
    def condition(self) -> tuple[tuple[str, bool], ...]:
        """The names of the terms, each with whether it holds."""
        bits = str(self._setup.mdp.domain.cond(self.state))
        return tuple((name, bit == "1") for name, bit in zip(self._setup.mdp.domain.term_names, bits, strict=True))

    @property
    def rules(self) -> tuple[str, ...]:
        """The learnt rules, in words."""
        return self._setup.learner.sentences()

    def predictions(self) -> tuple[PredictionText, ...]:
        """Return the learner's prediction for every action."""
        is_probabilistic = PLAY_LEARNERS[self.settings.learner].is_probabilistic
        return tuple(
            describe_prediction(
                self.state,
                action,
                self._setup.learner.predict(self.state, action),
                is_probabilistic=is_probabilistic,
            )
            for action in self.actions
        )

    def begin_episode(self) -> None:
        """Begin an episode."""
        self.state: State = self._setup.mdp.reset(self._rng)
        self.steps, self.episode_return, self.is_over = 0, 0.0, False
        self.message = "A new episode begins. Find out what the actions do."

    def suggest_action(self) -> Action | None:
        """Return the action that the agent would choose; None where it has nothing more to do."""
        decision = None if self.is_over else self._setup.agent.decide(self.state)
        return None if decision is None else decision.action

    def act(self, action: Action) -> Transition:
        """Carry out an action, let the learner learn from it, and describe the result in `message`.

        Raises:
            RuntimeError: The episode has ended.
        """
        if self.is_over:
            raise RuntimeError("the episode has ended; begin another")
        predicted = self._setup.learner.predict(self.state, action).most_likely.next_state
        transition = self._setup.mdp.step(action)
        self._setup.agent.learn(transition)
        self.steps += 1
        self.total_steps += 1
        self.episode_return += transition.reward
        self.message = (
            f"{action}: {describe_changes(self.state, transition.next_state)} ({transition.reward:+g})"
            f"{self._compare(predicted, transition.next_state)}"
        )
        self.state = transition.next_state
        if transition.terminated:
            self.is_over = True
            self.finished_episodes += 1
            self.message += f" The episode ended after {self.steps} steps with a return of {self.episode_return:+g}."
        return transition

    def _compare(self, predicted: State | None, after: State) -> str:
        """Return in words whether a prediction was right, and count it if it was wrong."""
        if predicted is None:
            return ", which was not predicted."
        if predicted.objects != after.objects:
            self.wrong_predictions += 1
            return ", contrary to the prediction."
        return ", as predicted."
