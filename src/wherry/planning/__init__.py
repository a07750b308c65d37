"""Planners on any model, one file each; search for plans and experiments; export of a model as PDDL."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
