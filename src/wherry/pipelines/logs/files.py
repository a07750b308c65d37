"""Files and folders of runs over logs."""

from __future__ import annotations

from pathlib import Path

from wherry.errors import InputError
from wherry.files import remove_files
from wherry.space.trajectory import TRAJECTORY_FORMATS, Trajectory, save_trajectory

DEFAULT_FORMAT = "tum"  # written always, since --reference, --odometry and evo read it


def check_trajectory_format(name: str) -> None:
    """Check the name of a format of trajectories.

    Raises:
        InputError: There is no such format.
    """
    if name not in TRAJECTORY_FORMATS:
        raise InputError("--trajectory-format", name, f"is none of {', '.join(TRAJECTORY_FORMATS)}")


def save_trajectories(trajectory: Trajectory, folder: Path, format_name: str) -> list[Path]:
    """Write trajectory.tum and, if another format is chosen, the trajectory in that format too; remove those of others.

    Args:
        trajectory: The trajectory.
        folder: The folder.
        format_name: A key of `TRAJECTORY_FORMATS`, which is also the suffix.

    Raises:
        InputError: The folder cannot be written to.
    """
    files = {name: folder / f"trajectory.{name}" for name in TRAJECTORY_FORMATS}
    remove_files(files.values())  # an earlier run may have written other formats
    paths = [files[name] for name in dict.fromkeys((DEFAULT_FORMAT, format_name))]
    for path in paths:
        save_trajectory(trajectory, path)
    return paths
