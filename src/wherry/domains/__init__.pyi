from .delivery import (
    BoxState,
    DeliveryHeuristic,
    DeliverySite,
    all_delivered,
    boxes_left,
    delivery_domain,
    delivery_grid,
    delivery_reward,
    delivery_transition,
)
from .taxi import TaxiGrid, taxi_domain, taxi_grid

__all__ = [
    "BoxState",
    "DeliveryHeuristic",
    "DeliverySite",
    "TaxiGrid",
    "all_delivered",
    "boxes_left",
    "delivery_domain",
    "delivery_grid",
    "delivery_reward",
    "delivery_transition",
    "taxi_domain",
    "taxi_grid",
]
