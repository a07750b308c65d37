"""Views of traces and results: terminal output, web pages, reports, drawings, and recordings for Rerun."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
