from .agent import DeliveryEpisode, delivery_learner
from .film import filmed
from .score import DeliveryResult, DeliveryStatus, shortest_delivery
from .simulated import DeliveryRun, DeliverySettings, prepare_delivery

__all__ = [
    "DeliveryEpisode",
    "DeliveryResult",
    "DeliveryRun",
    "DeliverySettings",
    "DeliveryStatus",
    "delivery_learner",
    "filmed",
    "prepare_delivery",
    "shortest_delivery",
]
