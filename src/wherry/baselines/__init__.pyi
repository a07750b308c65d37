from .compiled.model_entries import ModelEntries
from .compiled.q_learning import TabularQLearning
from .compiled.rmax import TabularRmax
from .compiled.tabular import TabularLearner, TabularMdp
from .factored_rmax import FactoredRmax
from .q_learning import QLearning
from .registry import BASELINES
from .rmax import Rmax

__all__ = [
    "BASELINES",
    "FactoredRmax",
    "ModelEntries",
    "QLearning",
    "Rmax",
    "TabularLearner",
    "TabularMdp",
    "TabularQLearning",
    "TabularRmax",
]
