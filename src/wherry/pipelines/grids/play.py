"""Playing a domain by hand while a learner watches, learns, and predicts every action before it is done.

The player sees what the learner sees: the state, its condition, and the prediction for every action.
"""

from __future__ import annotations

import numpy as np

from wherry.environments.pictures import render_text
from wherry.errors import InputError
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import State
from wherry.pipelines.grids.game_setups import GAME_SETUPS, PLAY_LEARNERS, GameSettings
from wherry.pipelines.grids.prediction_text import PredictionText, describe_changes, describe_prediction


class Game:
    """A game, episode after episode.

    Args:
        settings: What to play.

    Raises:
        InputError: There is no such domain, size, world or learner, or the rules cannot be used.

    Attributes:
        settings: What is played.
        state: Current state s.
        steps: Steps of the current episode.
        all_steps: Steps of all episodes.
        episodes: Number of episodes that ended.
        total: Sum of the current episode's rewards.
        surprises: Number of wrong predictions in all episodes.
        over: Whether the current episode has ended.
        message: What happened last, in words.
    """

    def __init__(self, settings: GameSettings) -> None:
        if settings.domain not in GAME_SETUPS:
            raise InputError("DOMAIN", settings.domain, f"is none of {', '.join(GAME_SETUPS)}")
        if settings.learner not in PLAY_LEARNERS:
            raise InputError("--learner", settings.learner, f"is none of {', '.join(PLAY_LEARNERS)}")
        self.settings = settings
        self._setup = GAME_SETUPS[settings.domain](settings)
        self._rng = np.random.default_rng(settings.seed)
        self.episodes, self.surprises, self.all_steps = 0, 0, 0
        self.begin()

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
        """The terms by name, each with whether it holds."""
        bits = str(self._setup.mdp.domain.cond(self.state))
        return tuple((name, bit == "1") for name, bit in zip(self._setup.mdp.domain.term_names, bits, strict=True))

    @property
    def rules(self) -> tuple[str, ...]:
        """What was learnt so far, in words."""
        return self._setup.learner.sentences()

    def predictions(self) -> tuple[PredictionText, ...]:
        """Return what the learner predicts of every action."""
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

    def begin(self) -> None:
        """Begin an episode."""
        self.state: State = self._setup.mdp.reset(self._rng)
        self.steps, self.total, self.over = 0, 0.0, False
        self.message = "What are the rules? Try."

    def advise(self) -> Action | None:
        """Return the learner's action; None where it has nothing more to do."""
        decision = None if self.over else self._setup.agent.decide(self.state)
        return None if decision is None else decision.action

    def do(self, action: Action) -> Transition:
        """Do an action, let the learner learn from it, and report what happened in `message`.

        Raises:
            RuntimeError: The episode has ended.
        """
        if self.over:
            raise RuntimeError("the episode has ended; begin another")
        predicted = self._setup.learner.predict(self.state, action).most_likely.next_state
        transition = self._setup.mdp.step(action)
        self._setup.agent.learn(transition)
        self.steps += 1
        self.all_steps += 1
        self.total += transition.reward
        self.message = (
            f"{action}: {describe_changes(self.state, transition.next_state)} ({transition.reward:+g})"
            f"{self._compare(predicted, transition.next_state)}"
        )
        self.state = transition.next_state
        if transition.terminated:
            self.over = True
            self.episodes += 1
            self.message += f" Done after {self.steps} steps, with {self.total:+g}."
        return transition

    def _compare(self, predicted: State | None, after: State) -> str:
        """Return in words whether a prediction came true, and count it if not."""
        if predicted is None:
            return ", which was unknown."
        if predicted.objects != after.objects:
            self.surprises += 1
            return ", a surprise!"
        return ", as predicted."
