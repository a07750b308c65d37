"""The published learning experiment: steps until six probes are solved optimally (Diuk et al. 2008, section 5).

Episodes begin at random. After every episode the greedy policy is tested from six probes, without learning. What counts
is the number of steps in the environment, those of the tests excluded, until it solves all six in the fewest possible
steps. The published experiment is on Taxi; `wherry.pipelines.grids.arenas` has further domains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np

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

MAX_STEPS = 20_000_000  # steps after which a repetition counts as not converged
MAX_STEPS_WITHOUT_CONVERGENCE = 20_000  # the same for learners of which some repetitions never converge


@dataclass(frozen=True, slots=True)
class LearningSettings:
    """What to run.

    Attributes:
        size: Side of the Taxi grid, cells: 5 or 10.
        learner: A key of `LEARNERS`.
        repetitions: Number of repetitions, each with its own random numbers.
        seed: Seed of all random numbers.
        domain: A key of `ARENAS`.
        world: World to deliver in, for deliveries.
    """

    size: int = 5
    learner: str = "doormax"
    repetitions: int = 100
    seed: int = 0
    domain: str = "taxi"
    world: str = "small"


@dataclass(frozen=True, slots=True)
class Repetition:
    """One run of a learner that began with no knowledge.

    Attributes:
        steps: Steps in the environment until all probes were solved, or until the step limit.
        converged: Whether all probes were solved.
        seconds: Processor time of deciding and learning, s.
        curve: After every episode the number of steps so far, and the number of probes solved.
        unknown_answers: DOORMAX's largest count of "I don't know" for an action, attribute and type of effect; None for
            learners that have no bound on it.
        unknown_answers_bound: Bound of that count, nk + k + 1; None for the same learners.
    """

    steps: int
    converged: bool
    seconds: float
    curve: tuple[tuple[int, int], ...]
    unknown_answers: int | None = None
    unknown_answers_bound: int | None = None


@dataclass(frozen=True, slots=True)
class LearningResult:
    """Statistics of all repetitions.

    Attributes:
        settings: What was run.
        runs: All repetitions, in their order.
        repetitions: Number of repetitions.
        converged: Number of repetitions that solved all probes.
        steps_mean: Mean steps of the converged repetitions; None where none converged.
        steps_sd: Standard deviation of their steps.
        steps_p95: 95th percentile of their steps.
        ms_per_step: Time to decide and to learn, planning included, ms: the median of the repetitions' means.
        unknown_answers: Largest `Repetition.unknown_answers`.
        unknown_answers_bound: Bound that it cannot exceed in theory, nk + k + 1.
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
        """Return the statistics as plain data."""
        statistics = {field.name: getattr(self, field.name) for field in fields(self)[2:]}
        settings = {name: getattr(self.settings, name) for name in ("domain", "size", "learner", "seed")}
        return {**settings, **statistics}


class LearningExperiment:
    """The experiment, one repetition after the other.

    Args:
        settings: What to run.

    Raises:
        InputError: There is no such domain, grid, world or learner, or there is nothing to repeat.

    Attributes:
        arena: The world, its truth and the probes.
        learner: Learner of the last repetition, if it learns rules.
        watch: Sink that is called with the records of the first repetition.
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
        self.watch: Sink | None = None
        self._runs: list[Repetition] = []

    def repetitions(self) -> Iterator[Repetition]:
        """Run all repetitions, yielding each when it is over."""
        warm_up, *streams = np.random.default_rng(self.settings.seed).spawn(self.settings.repetitions + 1)
        self._repeat(warm_up, max_steps=1)  # compiles the kernels, so that no repetition is charged for that
        converges = LEARNERS[self.settings.learner].converges
        max_steps = MAX_STEPS if converges else MAX_STEPS_WITHOUT_CONVERGENCE
        for rng in streams:
            self._runs.append(self._repeat(rng, max_steps, None if self._runs else self.watch))
            yield self._runs[-1]

    def result(self) -> LearningResult:
        """Return the statistics of the repetitions that are over, at least one."""
        return LearningResult.of(self.settings, self._runs)

    def _repeat(self, rng: np.random.Generator, max_steps: int, sink: Sink | None = None) -> Repetition:
        """Let a new learner learn until it solves all probes, or the step limit is reached."""
        if self.settings.learner in BASELINES:
            return self._repeat_on_tables(rng, max_steps)
        return self._repeat_on_objects(rng, max_steps, sink)

    def _repeat_on_tables(self, rng: np.random.Generator, max_steps: int) -> Repetition:
        arena = self.arena
        learner = BASELINES[self.settings.learner].factory(arena)
        curve, seconds = learner.learn(
            arena.tables, arena.probes, rng, max_episode_steps=MAX_EPISODE_STEPS, max_steps=max_steps
        )
        steps, solved = curve[-1]
        return Repetition(steps, solved == len(arena.probes), seconds, curve)

    def _repeat_on_objects(self, rng: np.random.Generator, max_steps: int, sink: Sink | None) -> Repetition:
        arena, entry = self.arena, RULE_LEARNERS[self.settings.learner]
        learner = self.learner = entry.factory(arena.environment.domain)
        tested = TestedAgent.of(entry, learner, arena)
        unknown = entry.count_unknown_answers(learner)
        agent = TimedAgent(tested.agent, unknown)
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
        most, bound = (None, None) if unknown is None else (unknown.most, unknown.bound)
        return Repetition(steps, solved == len(arena.probes), agent.seconds, tuple(curve), most, bound)


def solved_at_once(learner: RuleLearner, arena: Arena) -> int:
    """Return how many of an arena's probes are solved in the fewest steps by rules learnt elsewhere.

    The learner is settled for that and takes no further step.
    """
    learner.keep_simplest()
    return arena.solved(ValueIteration(learner, optimistic=False, space=arena.testing).policy)
