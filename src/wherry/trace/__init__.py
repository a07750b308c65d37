"""Traces: the records that a run emits, the sinks that receive them, and trace files."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
