"""The published Taxi experiment: steps until six probes are all solved optimally (Diuk et al. 2008, section 5).

Episodes begin at random. After every episode the greedy policy is tested from six probes, without learning. What
counts is the steps taken in the environment, those of the tests excluded, until it solves all six in the fewest steps
possible. Other domains are run under the same protocol (`wherry.pipelines.grids.arenas`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from wherry.baselines.compiled.q_learning import TabularQLearning
from wherry.baselines.compiled.rmax import TabularRmax
from wherry.baselines.compiled.tables import TabularLearner
from wherry.episodes import Decision, PolicyAgent, run_episode
from wherry.errors import InputError
from wherry.learning.bayes import BayesianLearner
from wherry.learning.bounds import UnknownAnswers
from wherry.learning.doormax import Doormax
from wherry.learning.learners import RuleLearner
from wherry.oomdp.domain import Action
from wherry.oomdp.mdp import Transition
from wherry.oomdp.objects import State
from wherry.pipelines.grids.arenas import ARENAS, LONGEST_EPISODE, Arena
from wherry.pipelines.grids.trace import GridTrace
from wherry.planning.value_iteration import ValueIteration
from wherry.trace.records import Sink

CURIOSITY = 8.0  # what it is worth to the Bayesian learner to settle a doubt; a delivery is worth 20
OPTIMISTIC_VALUE = 20.0  # Q-learning's first values where they are to be optimistic: nothing is worth more
PATIENCE = 20_000_000  # steps after which a learner is said not to converge
LETTER = "doormax-letter"
LESS_PATIENCE: Mapping[str, int] = {LETTER: 20_000}  # without refutation, some repetitions never converge


@dataclass(frozen=True, slots=True)
class Settings:
    """What to run.

    Attributes:
        size: The grid's side, 5 or 10, for Taxi.
        learner: A key of `LEARNERS`.
        repetitions: How often, each time with other random numbers.
        seed: Of all that is random.
        domain: A key of `ARENAS`.
        world: The world to deliver in, for deliveries.
    """

    size: int = 5
    learner: str = "doormax"
    repetitions: int = 100
    seed: int = 0
    domain: str = "taxi"
    world: str = "small"


@dataclass(frozen=True, slots=True)
class Repetition:
    """One learner's life.

    Attributes:
        steps: Steps in the environment until all probes were solved, or until patience ended.
        converged: Whether all probes were solved.
        seconds: Time that deciding and learning took on one core; what else the machine does does not count.
        curve: After every episode the steps so far, and how many of the probes were solved then.
        unknown_answers: DOORMAX's most "I don't know" for an action, attribute and type of effect; None for others.
    """

    steps: int
    converged: bool
    seconds: float
    curve: tuple[tuple[int, int], ...]
    unknown_answers: int | None


@dataclass(frozen=True, slots=True)
class Result:
    """What came of it.

    Attributes:
        settings: What was run.
        runs: All repetitions, in their order.
        repetitions: How many.
        converged: How many of them solved all probes.
        steps_mean: Steps of those that did, on average; None where there were none.
        steps_sd: Their standard deviation.
        steps_p95: Their 95th percentile.
        ms_per_step: Time to decide and to learn, planning included: the median of the repetitions' averages, ms.
        unknown_answers: The most of all repetitions' `Repetition.unknown_answers`.
        unknown_answers_bound: What the theorem says that they cannot exceed, nk + k + 1.
    """

    settings: Settings
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
    def of(cls, settings: Settings, runs: Sequence[Repetition], bound: int | None) -> Result:
        """The figures of some repetitions, at least one."""
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
            unknown_answers_bound=bound,
        )

    def as_json(self) -> dict[str, float | int | str | None]:
        """The figures as plain data."""
        figures = {field.name: getattr(self, field.name) for field in fields(self)[2:]}
        settings = {name: getattr(self.settings, name) for name in ("domain", "size", "learner", "seed")}
        return {**settings, **figures}


@dataclass(frozen=True, slots=True)
class Contender:
    """A learner that is ready to begin.

    Attributes:
        agent: Acts and learns.
        best: Its greedy policy, which is tested.
    """

    agent: PolicyAgent
    best: Callable[[State], Action]


def _doormax(arena: Arena, rng: np.random.Generator, **options: Any) -> Contender:
    learner = Doormax(arena.environment.domain, **options)
    planner = ValueIteration(learner, space=arena.acting)
    return Contender(PolicyAgent(learner, planner), planner.policy)


def _near_miss(arena: Arena, rng: np.random.Generator) -> Contender:
    return _doormax(arena, rng, inference="near-miss")


def _letter(arena: Arena, rng: np.random.Generator) -> Contender:
    return _doormax(arena, rng, refutation=False)


def _bayes(arena: Arena, rng: np.random.Generator) -> Contender:
    learner = BayesianLearner(arena.environment.domain)
    planner = ValueIteration(learner, curiosity=CURIOSITY, space=arena.acting)
    return Contender(
        PolicyAgent(learner, planner), ValueIteration(learner, optimistic=False, space=arena.testing).policy
    )


def _rmax(arena: Arena, rng: np.random.Generator) -> TabularRmax:
    return TabularRmax(arena.entries["rmax"])


def _factored_rmax(arena: Arena, rng: np.random.Generator, network: str = "published") -> TabularRmax:
    if network not in arena.networks:
        raise InputError("--learner", "factored-rmax", f"needs to be told what depends on what in {arena.title}")
    return TabularRmax(arena.entries[network])


def _minimal_factored_rmax(arena: Arena, rng: np.random.Generator) -> TabularRmax:
    return _factored_rmax(arena, rng, "minimal")


def _q_learning(arena: Arena, rng: np.random.Generator) -> TabularQLearning:
    return TabularQLearning()


def _optimistic_q_learning(arena: Arena, rng: np.random.Generator) -> TabularQLearning:
    return TabularQLearning(exploration=0.0, first_value=OPTIMISTIC_VALUE)


LEARNERS: Mapping[str, Callable[[Arena, np.random.Generator], Contender | TabularLearner]] = {
    "bayes": _bayes,
    "doormax": _doormax,
    "doormax-near-miss": _near_miss,
    LETTER: _letter,
    "factored-rmax": _factored_rmax,
    "factored-rmax-minimal": _minimal_factored_rmax,
    "rmax": _rmax,
    "q-learning": _q_learning,
    "q-learning-optimistic": _optimistic_q_learning,
}
"""The learners that can be compared.

doormax-letter is the paper's own, without refutation; factored-rmax-minimal is given the smallest network that is true.
"""


class TaxiExperiment:
    """The experiment, one repetition after the other.

    Args:
        settings: What to run.

    Raises:
        InputError: There is no such domain, grid, world or learner, or there is nothing to repeat.
    """

    def __init__(self, settings: Settings) -> None:
        if settings.domain not in ARENAS:
            raise InputError("DOMAIN", settings.domain, f"is none of {', '.join(ARENAS)}")
        if settings.learner not in LEARNERS:
            raise InputError("--learner", settings.learner, f"is none of {', '.join(LEARNERS)}")
        if settings.repetitions < 1:
            raise InputError("--repetitions", str(settings.repetitions), "must be at least 1")
        self.settings = settings
        self.arena = ARENAS[settings.domain](settings.size, settings.world)
        self.learner: RuleLearner | None = None  # the last repetition's, if it learns rules
        self.watch: Sink | None = None  # told of the first repetition
        self._runs: list[Repetition] = []
        self._bound: int | None = None

    def repetitions(self) -> Iterator[Repetition]:
        """Run them all; each is given out when it is over."""
        arena = self.arena
        warm_up, *streams = np.random.default_rng(self.settings.seed).spawn(self.settings.repetitions + 1)
        self._repeat(arena, warm_up, patience=1)  # compiles the kernels, so that no repetition is charged for that
        patience = LESS_PATIENCE.get(self.settings.learner, PATIENCE)
        for rng in streams:
            self._runs.append(self._repeat(arena, rng, patience))
            yield self._runs[-1]

    def result(self) -> Result:
        """The figures of the repetitions that are over, at least one."""
        return Result.of(self.settings, self._runs, self._bound)

    def _repeat(self, arena: Arena, rng: np.random.Generator, patience: int) -> Repetition:
        """Let a contender learn until it solves all probes, or patience ends."""
        contender = LEARNERS[self.settings.learner](arena, rng)
        if not isinstance(contender, Contender):
            curve, seconds = contender.learn(
                arena.tables, arena.probes, rng, longest=LONGEST_EPISODE, patience=patience
            )
            steps, solved = curve[-1]
            return Repetition(steps, solved == len(arena.probes), seconds, curve, unknown_answers=None)
        agent = _Stopwatch(contender.agent)
        self.learner = agent.learner if isinstance(agent.learner, Doormax | BayesianLearner) else None
        trace = None
        if self.watch is not None and self.learner is not None and patience > 1 and not self._runs:
            trace = GridTrace(arena.title, self.learner, self.watch)
        steps, solved, points = 0, 0, list[tuple[int, int]]()
        while solved < len(arena.probes) and steps < patience:
            for step in run_episode(arena.environment, agent, rng, max_steps=LONGEST_EPISODE):
                steps += 1
                if trace is not None:
                    trace.step(step)
            solved = arena.solved(contender.best)
            if trace is not None:
                trace.episode_ended(solved, len(arena.probes))
            points.append((steps, solved))
        answers = agent.unknown_answers
        self._bound = None if answers is None else answers.bound
        most = None if answers is None else answers.most
        return Repetition(steps, solved == len(arena.probes), agent.seconds, tuple(points), most)


def solved_at_once(learner: RuleLearner, arena: Arena) -> int:
    """How many of a grid's probes are solved in the fewest steps by what was learnt elsewhere, with no further step.

    DOORMAX is settled for that (`Doormax.settle`).
    """
    if isinstance(learner, Doormax):
        learner.settle()
    return arena.solved(ValueIteration(learner, optimistic=False, space=arena.testing).policy)


class _Stopwatch(PolicyAgent):
    """An agent whose deciding and learning is timed, and whose "I don't know" is counted."""

    def __init__(self, agent: PolicyAgent) -> None:
        super().__init__(agent.learner, agent.planner)
        self.seconds = 0.0
        self.unknown_answers = UnknownAnswers(agent.learner) if isinstance(agent.learner, Doormax) else None

    def decide(self, state: State) -> Decision:
        began = time.thread_time()
        decision = super().decide(state)
        self.seconds += time.thread_time() - began
        return decision

    def learn(self, transition: Transition) -> None:
        if self.unknown_answers is not None:
            self.unknown_answers.observe(transition)
        began = time.thread_time()
        super().learn(transition)
        self.seconds += time.thread_time() - began
