"""Learners of rules: models of the effects of actions, learnt from experience (paper, sections 4 and 6)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
