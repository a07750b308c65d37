"""Adapters that present existing Gymnasium environments, unmodified, as object-oriented MDPs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
