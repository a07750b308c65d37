"""The published learning experiment: steps until six probes are solved optimally (Diuk et al. 2008, section 5).

Episodes begin in random states. After every episode the greedy policy is tested from six probes, without learning. The
result is the number of steps in the environment, without those of the tests, until the policy solves all six probes in
the fewest possible steps. The published experiment is on Taxi; `wherry.pipelines.grids.arenas` has further domains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

from wherry.baselines.compiled.tabular import LearningCurve
from wherry.baselines.registry import BASELINES
from wherry.episodes import run_episode
from wherry.errors import InputError
from wherry.learning.registry import RULE_LEARNERS
from wherry.learning.rules import RuleLearner
from wherry.pipelines.grids.agents import TestedAgent, TimedAgent
from wherry.pipelines.grids.arenas import ARENAS, MAX_EPISODE_STEPS, Arena
from wherry.pipelines.grids.learners import LEARNERS
from wherry.pipelines.grids.trace import GridTrace
from wherry.planning.value_iteration import ValueIteration
from wherry.trace.records import Sink

MAX_STEPS = 20_000_000  # steps after which a repetition is ended as not converged
MAX_STEPS_WITHOUT_CONVERGENCE = 20_000  # the same limit for learners whose convergence is not guaranteed


@dataclass(frozen=True, slots=True)
class LearningSettings:
    """The settings of a learning experiment.

    Attributes:
        size: Side of the Taxi grid, cells: 5 or 10.
        learner: Key of `LEARNERS`.
        repetitions: Number of repetitions, each with its own random number generator.
        seed: Seed of all random number generators.
        domain: Key of `ARENAS`.
        world: World of the delivery: a built-in world's name or a world file.
    """

    size: int = 5
    learner: str = "doormax"
    repetitions: int = 100
    seed: int = 0
    domain: str = "taxi"
    world: str = "small"


@dataclass(frozen=True, slots=True)
class Repetition:
    """One run of a learner that began without knowledge.

    Attributes:
        steps: Number of steps in the environment until all probes were solved, or until the step limit.
        converged: Whether all probes were solved.
        seconds: Processor time of deciding and learning, s.
        curve: Learning curve: number of steps up to the end of each episode, and number of probes solved then.
        unknown_answers: DOORMAX's largest number of answers "I don't know" for one action, attribute and type of
            effect; None for a learner without a bound on it.
        unknown_answers_bound: Bound nk + k + 1 on ``unknown_answers``; None for a learner without a bound.
    """

    steps: int
    converged: bool
    seconds: float
    curve: LearningCurve
    unknown_answers: int | None = None
    unknown_answers_bound: int | None = None


@dataclass(frozen=True, slots=True)
class LearningResult:
    """Statistics of all repetitions.

    Attributes:
        settings: Settings of the experiment.
        runs: All repetitions, in their order.
        repetitions: Number of repetitions.
        converged: Number of repetitions that solved all probes.
        steps_mean: Mean number of steps of the converged repetitions; None where none converged.
        steps_sd: Standard deviation of the steps of the converged repetitions; None where none converged.
        steps_p95: 95th percentile of the steps of the converged repetitions; None where none converged.
        ms_per_step: Processor time of a step (predict, learn, plan), ms: median of the repetitions' means.
        unknown_answers: Largest `Repetition.unknown_answers`; None for a learner without a bound on it.
        unknown_answers_bound: Bound nk + k + 1 on ``unknown_answers``; None for a learner without a bound.
    """

    settings: LearningSettings
    runs: tuple[Repetition, ...]
    repetitions: int
    converged: int
    steps_mean: float | None
    steps_sd: float | None
    steps_p95: float | None
    ms_per_step: float
    unknown_answers: int | None
    unknown_answers_bound: int | None

    @classmethod
    def of(cls, settings: LearningSettings, runs: Sequence[Repetition]) -> LearningResult:
        """Return the statistics of at least one repetition."""
        unknown = [run.unknown_answers for run in runs if run.unknown_answers is not None]
        steps = np.array([run.steps for run in runs if run.converged])
        return cls(
            settings,
            tuple(runs),
            repetitions=len(runs),
            converged=len(steps),
            steps_mean=float(steps.mean()) if len(steps) else None,
            steps_sd=float(steps.std()) if len(steps) else None,
            steps_p95=float(np.percentile(steps, 95)) if len(steps) else None,
            ms_per_step=float(np.median([1000 * run.seconds / run.steps for run in runs])),
            unknown_answers=max(unknown, default=None),
            unknown_answers_bound=runs[-1].unknown_answers_bound,
        )

    def as_json(self) -> dict[str, float | int | str | None]:
        """Return statistics and settings as JSON values, without the single repetitions."""
        statistics = {field.name: getattr(self, field.name) for field in fields(self)[2:]}
        settings = {name: getattr(self.settings, name) for name in ("domain", "size", "learner", "seed")}
        return {**settings, **statistics}


class LearningExperiment:
    """The experiment, one repetition after the other.

    Args:
        settings: Settings of the experiment.

    Raises:
        InputError: There is no such domain, grid, world or learner, or the number of repetitions is below 1.

    Attributes:
        settings: Settings of the experiment.
        arena: The world and its probes.
        learner: Learner of the last repetition; None for a learner without rules.
        sink: Sink that is called with the records of the first repetition; None to record nothing.
    """

    def __init__(self, settings: LearningSettings) -> None:
        if settings.domain not in ARENAS:
            raise InputError("DOMAIN", settings.domain, f"is none of {', '.join(ARENAS)}")
        if settings.learner not in LEARNERS:
            raise InputError("--learner", settings.learner, f"is none of {', '.join(LEARNERS)}")
        if settings.repetitions < 1:
            raise InputError("--repetitions", str(settings.repetitions), "must be at least 1")
        self.settings = settings
        self.arena = ARENAS[settings.domain](settings.size, settings.world)
        self.learner: RuleLearner | None = None
        self.sink: Sink | None = None
        self._runs: list[Repetition] = []

    def repetitions(self) -> Iterator[Repetition]:
        """Run all repetitions, yielding each when it has ended."""
        warm_up, *generators = np.random.default_rng(self.settings.seed).spawn(self.settings.repetitions + 1)
        self._repeat(warm_up, max_steps=1)  # compiles the kernels, so that no measured time includes compilation
        converges = LEARNERS[self.settings.learner].converges
        max_steps = MAX_STEPS if converges else MAX_STEPS_WITHOUT_CONVERGENCE
        for rng in generators:
            self._runs.append(self._repeat(rng, max_steps, None if self._runs else self.sink))
            yield self._runs[-1]

    def result(self) -> LearningResult:
        """Return the statistics of the repetitions that have ended, at least one."""
        return LearningResult.of(self.settings, self._runs)

    def _repeat(self, rng: np.random.Generator, max_steps: int, sink: Sink | None = None) -> Repetition:
        """Run a new learner until it solves all probes, or until the step limit is reached."""
        if self.settings.learner in BASELINES:
            return self._repeat_on_tables(rng, max_steps)
        return self._repeat_on_objects(rng, max_steps, sink)

    def _repeat_on_tables(self, rng: np.random.Generator, max_steps: int) -> Repetition:
        """Run a compiled baseline on numbered states."""
        arena = self.arena
        learner = BASELINES[self.settings.learner].factory(arena)
        curve, seconds = learner.learn(
            arena.tables, arena.probes, rng, max_episode_steps=MAX_EPISODE_STEPS, max_steps=max_steps
        )
        steps, solved = curve[-1]
        return Repetition(steps, solved == len(arena.probes), seconds, curve)

    def _repeat_on_objects(self, rng: np.random.Generator, max_steps: int, sink: Sink | None) -> Repetition:
        """Run a learner of rules on object states, with a planner that acts."""
        arena, entry = self.arena, RULE_LEARNERS[self.settings.learner]
        learner = self.learner = entry.factory(arena.environment.domain)
        tested = TestedAgent.of(entry, learner, arena)
        unknown_answers = entry.count_unknown_answers(learner)
        agent = TimedAgent(tested.agent, unknown_answers)
        trace = None if sink is None else GridTrace(arena.title, learner, sink)
        steps, solved, curve = 0, 0, list[tuple[int, int]]()
        while solved < len(arena.probes) and steps < max_steps:
            for step in run_episode(arena.environment, agent, rng, max_steps=MAX_EPISODE_STEPS):
                steps += 1
                if trace is not None:
                    trace.step(step)
            solved = arena.solved(tested.greedy_policy)
            if trace is not None:
                trace.episode_ended(solved, len(arena.probes))
            curve.append((steps, solved))
        return Repetition(
            steps,
            solved == len(arena.probes),
            agent.seconds,
            tuple(curve),
            unknown_answers=None if unknown_answers is None else unknown_answers.max_count,
            unknown_answers_bound=None if unknown_answers is None else unknown_answers.bound,
        )


def probes_solved_by_transfer(learner: RuleLearner, arena: Arena) -> int:
    """Return how many of an arena's probes are solved in the fewest steps by rules learnt in another world.

    The learner does not learn from that, but keeps only its simplest effect types (`RuleLearner.keep_simplest`).
    """
    learner.keep_simplest()
    return arena.solved(ValueIteration(learner, optimistic=False, space=arena.testing).policy)
