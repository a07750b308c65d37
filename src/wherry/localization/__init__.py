"""Localization on a known map: Monte Carlo localization and the filters it is compared with (paper, section 5)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
