"""The robot as an Environment: scans become States, and Actions become motion (paper, section 7)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
