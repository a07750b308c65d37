"""Agents of the learning experiment, with the greedy policies that are tested."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from wherry.episodes import Decision, PolicyAgent
from wherry.learning.bounds import UnknownAnswers
from wherry.learning.registry import LearnerEntry
from wherry.learning.rules import RuleLearner
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import State
from wherry.pipelines.grids.arenas import Arena
from wherry.planning.value_iteration import ValueIteration

CURIOSITY = 8.0  # exploration bonus for full disagreement, as a reward; the reward of a delivery is 20


def curiosity_of(entry: LearnerEntry[Any]) -> float:
    """Return the exploration bonus for a learner: 0 for one whose predictions have no disagreement."""
    return CURIOSITY if entry.is_probabilistic else 0.0


@dataclass(frozen=True, slots=True)
class TestedAgent:
    """An agent that learns in an arena, and the policy that is tested there.

    Attributes:
        agent: The agent, which explores.
        greedy_policy: Returns the best action under the learnt model, without exploration.
    """

    agent: PolicyAgent
    greedy_policy: Callable[[State], Action]

    @classmethod
    def of(cls, entry: LearnerEntry[Any], learner: RuleLearner, arena: Arena) -> TestedAgent:
        """Make an agent that acts by value iteration on a learner's predictions.

        A probabilistic learner explores by curiosity, so a second planner without curiosity and optimism is tested.
        For other learners the acting policy is tested: an optimistic policy is optimal once the steps on its way are
        known.

        Args:
            entry: The learner's entry in the registry.
            learner: The learner.
            arena: Where the agent acts and is tested.
        """
        planner = ValueIteration(learner, curiosity=curiosity_of(entry), space=arena.acting)
        tester = ValueIteration(learner, optimistic=False, space=arena.testing) if entry.is_probabilistic else planner
        return cls(PolicyAgent(learner, planner), tester.policy)


class TimedAgent(PolicyAgent):
    """An agent whose time for deciding and learning is measured, and whose answers "I don't know" are counted.

    Args:
        agent: The agent.
        unknown_answers: Counter of the learner's answers "I don't know"; None not to count them.

    Attributes:
        seconds: Processor time of all decisions and of learning so far, s.
        unknown_answers: Counter of the learner's answers "I don't know".
    """

    def __init__(self, agent: PolicyAgent, unknown_answers: UnknownAnswers | None) -> None:
        super().__init__(agent.learner, agent.planner)
        self.seconds = 0.0
        self.unknown_answers = unknown_answers

    def decide(self, state: State) -> Decision:
        """Return the policy's action."""
        began = time.thread_time()
        decision = super().decide(state)
        self.seconds += time.thread_time() - began
        return decision

    def learn(self, transition: Transition) -> None:
        """Learn from one transition."""
        if self.unknown_answers is not None:
            self.unknown_answers.observe(transition)
        began = time.thread_time()
        super().learn(transition)
        self.seconds += time.thread_time() - began
