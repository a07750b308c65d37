"""Learning and playing on grids: the published experiment, and games that a learner watches."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
