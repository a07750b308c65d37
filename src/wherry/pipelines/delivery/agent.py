"""The delivery episode of a robot, simulated or on ROS, without access to ground truth."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wherry.domains.delivery import (
    DROPOFF,
    PICKUP,
    DeliveryHeuristic,
    all_delivered,
    boxes_left,
    delivery_domain,
    delivery_reward,
)
from wherry.episodes import GoalAgent, Step, run_episode
from wherry.errors import InputError
from wherry.learning.registry import RULE_LEARNERS, Job, learners_for
from wherry.learning.rule_files.files import load_rules
from wherry.learning.rules import RuleLearner
from wherry.oomdp.conditions import Condition
from wherry.oomdp.objects import State
from wherry.pipelines.records import learnt_model, perceived_state
from wherry.realization.mission import SurveyedWorld
from wherry.robot import Body
from wherry.space.frame import CellFrame
from wherry.trace.records import CellLayout, Narration, Phase, RunStarted, Sink, StepTaken

UNBOUNDED = (-1_000_000, 1_000_000)  # columns or rows of a world whose size is not known yet
MAX_ACTIONS = 5000  # actions after which an episode ends


def delivery_learner(name: str, rules_file: Path | None = None) -> RuleLearner:
    """Make a learner of the delivery domain, without rules or with those of a file.

    Args:
        name: Name of a registered learner that can deliver; the learner in a rules file takes precedence.
        rules_file: Learnt rules to start with.

    Raises:
        InputError: There is no such learner, or the file is invalid.
    """
    learners = learners_for(Job.DELIVERY, RULE_LEARNERS)
    if name not in learners:
        raise InputError("--learner", name, f"is none of {', '.join(learners)}")
    domain = delivery_domain(UNBOUNDED, UNBOUNDED)
    if rules_file is not None:
        return load_rules(rules_file, domain, reward=delivery_reward, terminated=all_delivered)
    return learners[name].factory(domain, reward=delivery_reward, terminated=all_delivered)


def run_started(world: str, learner: RuleLearner, body: Body) -> RunStarted:
    """The first record of a delivery.

    Args:
        world: Name of the world.
        learner: The robot's learner.
        body: The robot's shape.
    """
    domain, name = learner.domain, type(learner).__name__
    return RunStarted("deliver", world, name, domain.term_names, tuple(domain.actions), body.radius, body.box_radius)


class DeliveryEpisode:
    """Delivers every box that can be found, and learns from each action; iteration yields each step after its action.

    A box may block the way to other boxes or to the warehouse. The robot therefore extends its survey whenever it has
    picked up a box, and picks up a box that blocks its way when nothing else can be delivered.

    Args:
        world: What the robot knows after its survey.
        learner: The robot's learner, which learns from the steps.
        sink: Called with records of each step.
        rng: Source of all randomness.

    Attributes:
        world: What the robot knows after its last survey.
    """

    def __init__(self, world: SurveyedWorld, learner: RuleLearner, sink: Sink, rng: np.random.Generator) -> None:
        self.world = world
        self._learner = learner
        self._sink = sink
        self._rng = rng
        self._recorded_revisions: dict[str, int] = {}
        self._actions = 0
        self._gave_up: str | None = None

    def __iter__(self) -> Iterator[Step]:
        """Deliver until no box can be delivered, no new area surveyed and no blocking box picked up."""
        environment = self.world.environment
        self._sink(_cell_layout(self.world))
        self._record_learnt_model()
        can_continue = True
        while can_continue:
            agent = GoalAgent(self._learner, boxes_left, DeliveryHeuristic())
            has_more = bool(environment.remaining) and (yield from self._pursue_goal(agent))
            self._gave_up = agent.failure_reason
            can_continue = has_more or self._extend_survey() or (yield from self._pick_up_blocking_box())
        self._say(Phase.DONE, _final_narration(environment.delivered, environment.remaining, self._gave_up))

    def _extend_survey(self) -> bool:
        """Survey the area that has become reachable; return whether there is one."""
        extended = self.world.extend_survey()
        if extended is None:
            return False
        self.world = extended
        self._sink(_cell_layout(extended))
        return True

    def _pick_up_blocking_box(self) -> Generator[Step, None, bool]:
        """Pick up a box that blocks the way, and survey the area behind it; return whether this succeeded."""
        if not self.world.environment.remaining:
            return False
        for name in self.world.blocking_boxes():
            self._say(Phase.DELIVER, f"I cannot deliver any box now, but {name} blocks my way: I pick it up.")
            if (
                yield from self._pursue_goal(
                    GoalAgent(self._learner, partial(_unmet_pickups, name), max_detour_cost=0.0)
                )
            ):
                return True
        return False

    def _pursue_goal(self, agent: GoalAgent) -> Generator[Step, None, bool]:
        """Execute an agent's decisions until it stops, or until the survey was extended after a pick-up.

        The area behind a box that was picked up is surveyed before the robot drives there, since the robot cannot be
        localized in unknown space.

        Returns:
            Whether the survey was extended.
        """
        environment = self.world.environment
        for step in run_episode(environment, agent, self._rng, max_steps=MAX_ACTIONS - self._actions):
            self._actions += 1
            self._record_step(step, agent.plan)
            yield step
            if step.action == PICKUP and not step.transition.failed and self._extend_survey():
                return True
        return False

    def _record_step(self, step: Step, plan: Sequence[State]) -> None:
        """Record a step, the state after it, the learnt model if it changed, and the narration."""
        environment = self.world.environment
        time = environment.pilot.time
        self._sink(
            StepTaken(
                time=time,
                condition=str(step.condition),
                action=str(step.action),
                is_learning=step.is_learning,
                has_effect=not step.transition.failed,
                unknown_pairs=step.unknown_pairs,
                delivered=environment.delivered,
                remaining=environment.remaining,
                plan=_cell_centres(plan, self.world.frame),
            )
        )
        self._sink(perceived_state(self._learner.domain, step.transition.next_state, time))
        self._record_learnt_model()
        self._narrate(step)

    def _record_learnt_model(self) -> None:
        """Record the learnt model if it has changed since it was recorded last."""
        if self._recorded_revisions != self._learner.revisions:
            self._sink(learnt_model(self._learner, self.world.environment.pilot.time))
            self._recorded_revisions = dict(self._learner.revisions)

    def _narrate(self, step: Step) -> None:
        """Narrate an unexpected outcome, a pick-up or a delivery."""
        phase = Phase.LEARN if step.is_learning else Phase.DELIVER
        if step.is_surprise:
            terms = _true_terms(step.condition, self._learner.domain.term_names)
            self._say(phase, f"{step.action} had an unexpected outcome while {terms}: I learn from it.")
        if step.transition.failed or step.action not in (PICKUP, DROPOFF):
            return
        before = {box.name for box in step.state.of_class("Box")}
        after = step.transition.next_state.of_class("Box")
        if step.action == PICKUP:
            held = next(box.name for box in after if box.in_bot)
            self._say(phase, f"I picked up {held}.")
        else:
            delivered = ", ".join(sorted(before - {box.name for box in after}))
            self._say(phase, f"I delivered {delivered}; {len(after)} left.")

    def _say(self, phase: Phase, text: str) -> None:
        self._sink(Narration(self.world.environment.pilot.time, phase, text))


def _true_terms(condition: Condition, names: Sequence[str]) -> str:
    """Name the terms that are true in a condition: "touch_N(robot, wall) was true"."""
    true = [name for name, bit in zip(names, str(condition), strict=True) if bit == "1"]
    return f"{' and '.join(true) or 'no term'} {'were' if len(true) > 1 else 'was'} true"


def _unmet_pickups(name: str, state: State) -> int:
    """Number of unmet goals of picking up a box: 0 once it is held or delivered, else 1."""
    box = state.get(name)
    return int(box is not None and not box.in_bot)


def _final_narration(delivered: int, remaining: int, reason: str | None) -> str:
    """The text of an episode's last narration.

    Args:
        delivered: Number of boxes delivered.
        remaining: Number of boxes found but not delivered.
        reason: Why the agent gave up; None if it was stopped after `MAX_ACTIONS`.
    """
    if remaining:
        boxes = "1 box" if remaining == 1 else f"{remaining} boxes"
        return f"I give up: I cannot deliver {boxes} ({reason or f'not within {MAX_ACTIONS:,} actions'})."
    return "All boxes are delivered." if delivered else "I found no boxes to deliver."


def _cell_layout(world: SurveyedWorld) -> CellLayout:
    """The record of the cells on the robot's map."""
    site = world.environment.site
    warehouse = np.array([(cell.x, cell.y) for cell in sorted(site.warehouse)], np.int32).reshape(-1, 2)
    walls = [(wall.cell.x, wall.cell.y, wall.north) for wall in sorted(site.walls)]
    return CellLayout(world.environment.pilot.time, world.frame, warehouse, np.array(walls, np.int32).reshape(-1, 3))


def _cell_centres(states: Sequence[State], frame: CellFrame) -> NDArray[np.float32]:
    """[M, 2] centres of the robot's cells in a sequence of states, m, map frame."""
    robots = [state["robot"] for state in states]
    return np.array([frame.centre(robot.x, robot.y) for robot in robots], np.float32).reshape(-1, 2)
