from .bayes import BayesianLearner
from .bounds import UnknownAnswers
from .doormax import Doormax
from .registry import RULE_LEARNERS, Job, LearnerEntry, learners_for
from .rule_files.files import load_rules, save_rules
from .rules import Rule, RuleLearner
from .unknowns import UnknownPairs

__all__ = [
    "RULE_LEARNERS",
    "BayesianLearner",
    "Doormax",
    "Job",
    "LearnerEntry",
    "Rule",
    "RuleLearner",
    "UnknownAnswers",
    "UnknownPairs",
    "learners_for",
    "load_rules",
    "save_rules",
]
