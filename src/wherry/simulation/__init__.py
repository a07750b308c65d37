"""The simulated robot: floor plans become MuJoCo models with a `Robot` in them (paper, sections 1 and 3)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
