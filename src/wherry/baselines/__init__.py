"""Tabular baselines: Q-learning, R-max and Factored R-max, on object states and compiled for numbered states."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
