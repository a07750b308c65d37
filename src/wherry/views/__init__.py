"""Views of traces and results: terminal, pages, reports, pictures and recordings for other viewers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
