from .arenas import ARENAS, Arena
from .game_setups import GameSettings
from .learners import LEARNERS
from .learning import LearningExperiment, LearningResult, LearningSettings, Repetition
from .play import Game

__all__ = [
    "ARENAS",
    "LEARNERS",
    "Arena",
    "Game",
    "GameSettings",
    "LearningExperiment",
    "LearningResult",
    "LearningSettings",
    "Repetition",
]
