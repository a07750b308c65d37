from .distance_field import DistanceField
from .frame import CellFrame, fit_cell_frame
from .map_files import load_map, save_map
from .mapper import GridMapper
from .occupancy import OccupancyGrid
from .pose import IDENTITY, Pose, compose, relative, wrap
from .raycast import cast_rays
from .trajectory import Trajectory, merge_odometry, save_trajectory, save_tum
from .wean_map import load_wean_map

__all__ = [
    "IDENTITY",
    "CellFrame",
    "DistanceField",
    "GridMapper",
    "OccupancyGrid",
    "Pose",
    "Trajectory",
    "cast_rays",
    "compose",
    "fit_cell_frame",
    "load_map",
    "load_wean_map",
    "merge_odometry",
    "relative",
    "save_map",
    "save_trajectory",
    "save_tum",
    "wrap",
]
