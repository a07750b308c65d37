from .generation import generate_world, place_boxes
from .plan import Cell, Direction, FloorPlan, Wall
from .world_files import built_in_worlds, find_world, format_world, load_world, parse_world

__all__ = [
    "Cell",
    "Direction",
    "FloorPlan",
    "Wall",
    "built_in_worlds",
    "find_world",
    "format_world",
    "generate_world",
    "load_world",
    "parse_world",
    "place_boxes",
]
