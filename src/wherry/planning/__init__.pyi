from .lrtdp import Lrtdp
from .pddl import PddlTask, export_pddl
from .planner import Planner
from .policy_iteration import PolicyIteration
from .prediction_cache import PredictionCache
from .registry import PLANNERS, PlannerEntry
from .search import Plan, a_star, cheapest_experiment
from .state_space import StateSpace
from .uct import Uct
from .value_iteration import ValueIteration

__all__ = [
    "PLANNERS",
    "Lrtdp",
    "PddlTask",
    "Plan",
    "Planner",
    "PlannerEntry",
    "PolicyIteration",
    "PredictionCache",
    "StateSpace",
    "Uct",
    "ValueIteration",
    "a_star",
    "cheapest_experiment",
    "export_pddl",
]
