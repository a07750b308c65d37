from .agent import DeliveryEpisode, delivery_learner
from .film import film_recording
from .result import DeliveryResult, DeliveryStatus
from .shortest_delivery import shortest_delivery
from .simulated import DeliveryRun, DeliverySettings, prepare_delivery

__all__ = [
    "DeliveryEpisode",
    "DeliveryResult",
    "DeliveryRun",
    "DeliverySettings",
    "DeliveryStatus",
    "delivery_learner",
    "film_recording",
    "prepare_delivery",
    "shortest_delivery",
]
