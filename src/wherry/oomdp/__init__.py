"""Object-oriented Markov decision processes: objects, terms, conditions and effects; environments and models."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
