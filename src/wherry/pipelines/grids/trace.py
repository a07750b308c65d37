"""The trace of an agent that learns on a grid; every action takes one second on its clock."""

from __future__ import annotations

import numpy as np

from wherry.episodes import Step
from wherry.learning.rules import RuleLearner
from wherry.learning.unknowns import UnknownPairs
from wherry.oomdp.objects import State
from wherry.pipelines.records import learnt_model, perceived_state
from wherry.space.frame import CellFrame
from wherry.space.pose import Pose
from wherry.trace.records import CellLayout, Narration, Phase, RunStarted, Sink, StepTaken

NO_PLAN = np.empty((0, 2), np.float32)


class GridTrace:
    """Calls a sink with the records of one learner, from its first episode on.

    Args:
        title: Name of the world in the page's heading.
        learner: The learner.
        sink: Called with every record.
    """

    def __init__(self, title: str, learner: RuleLearner, sink: Sink) -> None:
        self._learner = learner
        self._sink = sink
        self._unknown = UnknownPairs(learner)
        self._recorded_revisions: dict[str, int] | None = None
        self._time = 0.0
        self._episodes = 0
        domain = learner.domain
        sink(RunStarted("learn", title, type(learner).__name__, domain.term_names, tuple(domain.actions)))

    def step(self, step: Step) -> None:
        """Record one action."""
        state, after = step.transition.state, step.transition.next_state
        if self._recorded_revisions is None:
            self._sink(_cell_layout(state))
            self._say("I do not know yet what my actions do.")
        self._time += 1.0
        self._unknown.add(state)
        self._episodes += step.transition.terminated
        self._sink(
            StepTaken(
                time=self._time,
                condition=str(step.condition),
                action=str(step.action),
                is_learning=step.is_learning,
                has_effect=not step.transition.failed,
                unknown_pairs=self._unknown.count(),
                delivered=self._episodes,
                remaining=0,
                plan=NO_PLAN,
            )
        )
        self._sink(perceived_state(self._learner.domain, after, self._time))
        if self._learner.revisions != self._recorded_revisions:
            self._recorded_revisions = dict(self._learner.revisions)
            self._sink(learnt_model(self._learner, self._time))

    def episode_ended(self, solved: int, probes: int) -> None:
        """Record how many probes the policy now solves in the fewest steps."""
        self._say(f"My rules now solve {solved} of {probes} probes in the fewest steps.")
        if solved == probes:
            self._sink(Narration(self._time, Phase.DONE, "My policy is optimal from every probe."))

    def _say(self, text: str) -> None:
        self._sink(Narration(self._time, Phase.LEARN, text))


def _cell_layout(state: State) -> CellLayout:
    """Return the walls and the goal cells of a state's static objects, in a cell frame with cells of 1 m."""
    walls = [(wall.x, wall.y, wall.north) for wall in state.scene.of_class("Wall")]
    goals = [(cell.x, cell.y) for cell in state.scene.of_class("Warehouse")]
    frame = CellFrame(Pose(), 1.0)
    return CellLayout(0.0, frame, np.array(goals, np.int32).reshape(-1, 2), np.array(walls, np.int32).reshape(-1, 3))
