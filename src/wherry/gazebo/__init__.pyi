from .export import GazeboExportSettings, export_world
from .latch import GazeboLatch
from .latch_settings import GazeboLatchSettings, load_latch_settings
from .sdf import GENERATIONS, GazeboGeneration

__all__ = [
    "GENERATIONS",
    "GazeboExportSettings",
    "GazeboGeneration",
    "GazeboLatch",
    "GazeboLatchSettings",
    "export_world",
    "load_latch_settings",
]
