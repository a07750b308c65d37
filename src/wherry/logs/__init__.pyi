from .lidar_log import LidarLog
from .odometry_files import with_odometry_file
from .options import ReadingOptions
from .reading import read_log
from .tables import read_odometry, read_rows, read_trajectory
from .timestamps import increasing_times

__all__ = [
    "LidarLog",
    "ReadingOptions",
    "increasing_times",
    "read_log",
    "read_odometry",
    "read_rows",
    "read_trajectory",
    "with_odometry_file",
]
