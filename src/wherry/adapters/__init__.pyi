from .base import GymnasiumAdapter
from .gymnasium_taxi import GymnasiumTaxi, gymnasium_taxi_reward, is_delivered
from .minigrid import MINIGRID_EFFECT_TYPES, MiniGrid, is_at_goal, minigrid_domain

__all__ = [
    "MINIGRID_EFFECT_TYPES",
    "GymnasiumAdapter",
    "GymnasiumTaxi",
    "MiniGrid",
    "gymnasium_taxi_reward",
    "is_at_goal",
    "is_delivered",
    "minigrid_domain",
]
