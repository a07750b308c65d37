"""Agents that learn on a grid with a planner, and the policies that they are tested by."""

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

CURIOSITY = 8.0  # reward that planners give for settling a doubt; a delivery is worth 20


def curiosity_of(entry: LearnerEntry[Any]) -> float:
    """Return the reward for settling a doubt with a learner; 0 for one that has no doubts."""
    return CURIOSITY if entry.is_probabilistic else 0.0


@dataclass(frozen=True, slots=True)
class TestedAgent:
    """An agent that learns in an arena, and is tested there.

    Attributes:
        agent: Acts and learns.
        greedy_policy: The best action by what was learnt, without exploration.
    """

    agent: PolicyAgent
    greedy_policy: Callable[[State], Action]

    @classmethod
    def of(cls, entry: LearnerEntry[Any], learner: RuleLearner, arena: Arena) -> TestedAgent:
        """Let a learner act by value iteration on its predictions.

        A probabilistic learner explores by curiosity, so it is tested by a planner of its own without optimism. For
        others the optimistic policy is optimal as soon as all that it needs is known.
        """
        planner = ValueIteration(learner, curiosity=curiosity_of(entry), space=arena.acting)
        tester = ValueIteration(learner, optimistic=False, space=arena.testing) if entry.is_probabilistic else planner
        return cls(PolicyAgent(learner, planner), tester.policy)


class TimedAgent(PolicyAgent):
    """An agent that measures the time it takes to decide and to learn, and counts its "I don't know".

    Args:
        agent: The agent.
        unknown_answers: Counts the learner's "I don't know"; None where they are not counted.

    Attributes:
        seconds: Processor time of all decisions and of learning so far, s.
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
