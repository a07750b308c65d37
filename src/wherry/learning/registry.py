"""The registry of learners: name, factory, codec for rules files, and uses of each.

Factories and codecs are given as ``"module:attribute"`` and imported on first use, so that the command line can list
the learners without loading them. `RULE_LEARNERS` contains the learners of rules; the baselines, in
`wherry.baselines.registry`, have entries of the same type.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from functools import partial
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

if TYPE_CHECKING:
    from wherry.learning.bounds import UnknownAnswers
    from wherry.learning.rules import RuleLearner
    from wherry.oomdp.domain import Domain
    from wherry.oomdp.mdp import RewardFunction, TerminationFunction


class Job(Enum):
    """A use of learners."""

    DELIVERY = auto()
    """Driving the robot: `wherry deliver` and the ROS nodes."""
    PLAY = auto()
    """Learning from a person who plays on a grid: `wherry play`."""
    COMPARISON = auto()
    """The published learning experiment: `wherry learn` and `wherry reproduce taxi`."""


class RuleLearnerFactory(Protocol):
    """Makes a rule learner without knowledge."""

    def __call__(
        self,
        domain: Domain,
        *,
        reward: RewardFunction | None = None,
        terminated: TerminationFunction | None = None,
        **options: Any,
    ) -> RuleLearner:
        """Make a learner.

        Args:
            domain: Domain whose states and actions are learnt about.
            reward: R(s, a, s') where it is given; None to learn it.
            terminated: Whether a state ends the episode where that is given; None to learn it.
            options: Further options of the learner.
        """
        ...


FactoryT = TypeVar("FactoryT", bound=Callable[..., object])


@dataclass(frozen=True, slots=True)
class LearnerEntry(Generic[FactoryT]):
    """A learner in the registry.

    Attributes:
        summary: Description of the learner in one line, shown to users.
        entry_point: Location of the factory, ``"module:attribute"``.
        jobs: Uses of the learner.
        options: Keyword arguments for the factory.
        codec: Location of the codec in `wherry.learning.rule_files`; None for a learner without rules.
        counter: Location of the counter of answers "I don't know"; None for a learner without a bound on their number.
        is_probabilistic: Whether predictions have probabilities and a disagreement that experiments can reduce.
        converges: Whether every run reaches the optimal policy; if not, runs are ended after fewer steps.
    """

    summary: str
    entry_point: str
    jobs: frozenset[Job] = frozenset({Job.COMPARISON})
    options: Mapping[str, Any] = field(default_factory=dict)
    codec: str | None = None
    counter: str | None = None
    is_probabilistic: bool = False
    converges: bool = True

    @property
    def factory(self) -> FactoryT:
        """The factory of the learner, with the entry's options applied."""
        return cast("FactoryT", partial(resolve_name(self.entry_point), **self.options))

    @property
    def has_rules(self) -> bool:
        """Whether the learner's knowledge consists of rules, which can be saved."""
        return self.codec is not None

    def count_unknown_answers(self, learner: RuleLearner) -> UnknownAnswers | None:
        """Return a counter of the learner's answers "I don't know"; None for a learner without a bound on them."""
        if self.counter is None:
            return None
        return cast("UnknownAnswers", resolve_name(self.counter)(learner))


_EVERY_JOB = frozenset(Job)
_DOORMAX = "wherry.learning.doormax:Doormax"
_DOORMAX_CODEC = "wherry.learning.rule_files.doormax:DOORMAX_CODEC"
_UNKNOWN_ANSWERS = "wherry.learning.bounds:UnknownAnswers"

RULE_LEARNERS: Mapping[str, LearnerEntry[RuleLearnerFactory]] = {
    "bayes": LearnerEntry(
        "the most likely simple rules, each with its probability",
        "wherry.learning.bayes:BayesianLearner",
        jobs=_EVERY_JOB,
        codec="wherry.learning.rule_files.bayes:BAYES_CODEC",
        is_probabilistic=True,
    ),
    "doormax": LearnerEntry(
        "rules that are certain under the paper's assumptions, or “I don't know”",
        _DOORMAX,
        jobs=_EVERY_JOB,
        codec=_DOORMAX_CODEC,
        counter=_UNKNOWN_ANSWERS,
    ),
    "doormax-near-miss": LearnerEntry(
        "DOORMAX that infers failures, assuming one conjunctive condition per action",
        _DOORMAX,
        jobs=frozenset({Job.PLAY, Job.COMPARISON}),
        options={"inference": "near-miss"},
        codec=_DOORMAX_CODEC,
        counter=_UNKNOWN_ANSWERS,
    ),
    "doormax-letter": LearnerEntry(
        "DOORMAX to the letter of the paper, without refutation",
        _DOORMAX,
        options={"refutation": False},
        codec=_DOORMAX_CODEC,
        counter=_UNKNOWN_ANSWERS,
        converges=False,
    ),
}
"""The learners of rules, by the names used on the command line."""

EntryT = TypeVar("EntryT", bound=LearnerEntry[Any])


def learners_for(job: Job, learners: Mapping[str, EntryT]) -> dict[str, EntryT]:
    """Return the entries of a registry that can be used for a job, in the registry's order."""
    return {name: entry for name, entry in learners.items() if job in entry.jobs}
