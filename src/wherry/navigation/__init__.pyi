from .controller import clear_distance, drive_line, follow_path, go_to, safe_velocity, turn_to
from .exploration import Viewpoint, frontier_cells, next_viewpoint, visible_unknown_area
from .path import Costmap, shortest_path, travel_costs

__all__ = [
    "Costmap",
    "Viewpoint",
    "clear_distance",
    "drive_line",
    "follow_path",
    "frontier_cells",
    "go_to",
    "next_viewpoint",
    "safe_velocity",
    "shortest_path",
    "travel_costs",
    "turn_to",
    "visible_unknown_area",
]
