from .grids import DeliveryEnvironment, ObjectEnvironment, TaxiEnvironment

__all__ = [
    "DeliveryEnvironment",
    "ObjectEnvironment",
    "TaxiEnvironment",
]
