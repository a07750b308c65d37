from .gymnasium_taxi import GymnasiumTaxi
from .minigrid import MiniGrid, minigrid_domain

__all__ = [
    "GymnasiumTaxi",
    "MiniGrid",
    "minigrid_domain",
]
