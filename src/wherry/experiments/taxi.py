"""The published Taxi experiment: how many steps a learner needs to an optimal policy (Diuk et al. 2008, section 5).

Episodes start at random. After every episode the greedy policy is tried from six probes; a repetition ends when all six
take the fewest steps possible, and its figure is the number of steps that were taken in the episodes until then.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass

import numpy as np

from wherry.domains.taxi import PROBES, SIZES, TaxiGrid, taxi_grid
from wherry.episodes import PolicyAgent, run
from wherry.errors import InputError
from wherry.learning.bayes import BayesianLearner
from wherry.learning.doormax import Doormax
from wherry.learning.learners import RuleLearner
from wherry.oomdp.domain import Domain
from wherry.planning.state_space import StateSpace
from wherry.planning.value_iteration import ValueIteration

OPTIMAL_LENGTHS: Mapping[int, tuple[int, ...]] = {5: (10, 14, 13, 13, 10, 13), 10: (17, 22, 20, 24, 13, 21)}
"""The fewest steps from each probe, as published; a test works them out again."""

EPISODE_STEPS = 100  # after which an episode is begun anew
MOST_STEPS = 20_000  # after which a repetition has not converged

LEARNERS: Mapping[str, Callable[[Domain], RuleLearner]] = {"doormax": Doormax, "bayes": BayesianLearner}


@dataclass(frozen=True, slots=True)
class Settings:
    """What to run.

    Attributes:
        size: 5 or 10, the grid's side.
        learner: A key of `LEARNERS`.
        repetitions: How often.
        seed: Of the first repetition; each one has a generator of its own.
    """

    size: int = 5
    learner: str = "doormax"
    repetitions: int = 100
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Repetition:
    """One learner's life.

    Attributes:
        steps: Taken in episodes until all probes were optimal, or until it was given up.
        episodes: In which they were taken.
        converged: Whether all probes were optimal in the end.
        seconds: Spent on predicting, learning and planning in the episodes.
    """

    steps: int
    episodes: int
    converged: bool
    seconds: float


@dataclass(frozen=True, slots=True)
class Result:
    """All repetitions together; steps are of those that converged.

    Attributes:
        steps_mean: Mean steps.
        steps_sd: Their standard deviation.
        steps_p95: Their 95th percentile.
        converged: How many repetitions converged.
        repetitions: How many there were.
        ms_per_step: ms, median over repetitions of a step's mean time, learning and planning included.
        learner: Its name.
        size: The grid's side.
        seed: Of the first repetition.
    """

    steps_mean: float | None
    steps_sd: float | None
    steps_p95: float | None
    converged: int
    repetitions: int
    ms_per_step: float
    learner: str
    size: int
    seed: int

    def as_json(self) -> dict[str, object]:
        """The fields."""
        return asdict(self)


class TaxiExperiment:
    """An experiment that is ready to run.

    Args:
        settings: What to run.

    Raises:
        InputError: There is no such grid or learner, or no repetition to run.
    """

    def __init__(self, settings: Settings) -> None:
        if settings.size not in SIZES:
            raise InputError("--size", str(settings.size), f"is none of the published {', '.join(map(str, SIZES))}")
        if settings.learner not in LEARNERS:
            raise InputError("--learner", settings.learner, f"is none of {', '.join(LEARNERS)}")
        if settings.repetitions < 1:
            raise InputError("--repetitions", str(settings.repetitions), "is fewer than 1")
        self.settings = settings
        self.learner: RuleLearner | None = None
        self._grid = taxi_grid(settings.size)
        self._spaces = StateSpace(), StateSpace()  # one for acting, one for the greedy policy
        self._done: list[Repetition] = []

    def repetitions(self) -> Iterator[Repetition]:
        """Run all repetitions, one after the other."""
        for number in range(self.settings.repetitions):
            repetition = self._repeat(np.random.default_rng([self.settings.seed, number]))
            self._done.append(repetition)
            yield repetition

    def result(self) -> Result:
        """What came of those repetitions that were run."""
        steps = np.array([item.steps for item in self._done if item.converged], dtype=float)
        some = len(steps) > 0
        return Result(
            steps_mean=float(steps.mean()) if some else None,
            steps_sd=float(steps.std()) if some else None,
            steps_p95=float(np.percentile(steps, 95)) if some else None,
            converged=len(steps),
            repetitions=len(self._done),
            ms_per_step=float(np.median([1e3 * item.seconds / item.steps for item in self._done])),
            learner=self.settings.learner,
            size=self.settings.size,
            seed=self.settings.seed,
        )

    def steps(self) -> tuple[int, ...]:
        """The steps of the repetitions that converged, for a learning curve."""
        return tuple(item.steps for item in self._done if item.converged)

    def _repeat(self, rng: np.random.Generator) -> Repetition:
        """One learner from knowing nothing to being optimal."""
        learner = self.learner = LEARNERS[self.settings.learner](self._grid.domain)
        agent = PolicyAgent(learner, ValueIteration(learner, space=self._spaces[0]))
        greedy = ValueIteration(learner, space=self._spaces[1], optimistic=False)
        steps = episodes = 0
        seconds = 0.0
        while steps < MOST_STEPS:
            began = time.perf_counter()
            steps += sum(1 for _ in run(self._grid, agent, rng, max_steps=EPISODE_STEPS))
            seconds += time.perf_counter() - began
            episodes += 1
            if is_optimal(self._grid, greedy, OPTIMAL_LENGTHS[self.settings.size]):
                return Repetition(steps, episodes, converged=True, seconds=seconds)
        return Repetition(steps, episodes, converged=False, seconds=seconds)


def is_optimal(grid: TaxiGrid, planner: ValueIteration, lengths: tuple[int, ...]) -> bool:
    """Whether the policy delivers every probe's passenger in the fewest steps."""
    return all(_delivers_within(grid, planner, probe, most) for probe, most in zip(PROBES, lengths, strict=True))


def _delivers_within(
    grid: TaxiGrid, planner: ValueIteration, probe: tuple[tuple[int, int], str, str], most: int
) -> bool:
    state = grid.state_of(*probe)
    for _ in range(most):
        transition = grid.transition(state, planner.policy(state))
        if transition.terminated:
            return True
        state = transition.next_state
    return False
