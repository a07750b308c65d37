"""The domains of the paper, Taxi and Delivery: classes, terms, actions, rewards, and grids to act on."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
