"""Checks of the installation, which try each dependency in the way that wherry uses it."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import sys
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from wherry.errors import InputError
from wherry.kernels import are_kernels_cached

MIN_PYTHON = (3, 11)
REQUIRED_PACKAGES = (
    "numpy",
    "scipy",
    "numba",
    "mujoco-core",
    "gymnasium",
    "pydantic",
    "matplotlib",
    "starlette",
)


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of checking one dependency.

    Attributes:
        name: Name of the dependency.
        works: Whether it is installed and works.
        detail: Version or path of the dependency, or an error.
        advice: How to install the dependency.
        is_required: Whether wherry needs the dependency to run.
    """

    name: str
    works: bool
    detail: str
    advice: str
    is_required: bool = False

    def as_json(self) -> dict[str, object]:
        """The result as in ``wherry doctor --json``."""
        return {"works": self.works, "detail": self.detail, "advice": self.advice, "required": self.is_required}


def failed_check(name: str, error: Exception) -> CheckResult:
    """The result of a check that raised an error."""
    return CheckResult(
        name,
        works=False,
        detail=f"{type(error).__name__}: {error}",
        advice="see the error",
        is_required=name in ("Python", "packages"),
    )


def _check_python() -> CheckResult:
    """Whether Python is recent enough."""
    works = sys.version_info >= MIN_PYTHON
    return CheckResult("Python", works, platform.python_version(), "install Python 3.11 or newer", is_required=True)


def _check_packages() -> CheckResult:
    """Whether the required packages are installed."""
    missing, found = [], []
    for name in REQUIRED_PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    detail = f"missing: {', '.join(missing)}" if missing else ", ".join(found)
    return CheckResult("packages", not missing, detail, "reinstall with pip install wherry", is_required=True)


def _check_kernels() -> CheckResult:
    """Whether the numba kernels are in the cache."""
    works = are_kernels_cached()
    detail = "compiled" if works else "not compiled yet"
    return CheckResult(
        "numba cache", works, detail, "nothing: the first run compiles the kernels in about half a minute"
    )


def _render_image() -> CheckResult:
    """Whether the simulated world can be rendered without a screen; a blank image counts as a failure."""
    import numpy as np  # noqa: PLC0415 - a broken package must not break the other checks

    from wherry.floorplan.world_files import find_world  # noqa: PLC0415
    from wherry.simulation import build  # noqa: PLC0415
    from wherry.simulation.rendering import SceneRenderer  # noqa: PLC0415

    world = build(find_world("small"), np.random.default_rng(0))
    with closing(SceneRenderer(world, 64, 64)) as renderer:
        works = bool(np.ptp(renderer.overhead()))
    return CheckResult("rendering", works, "EGL, rendered an image", RENDERING_ADVICE)


RENDERING_ADVICE = "apt install libegl1 libgl1-mesa-dri; needed for images and videos of the simulated world"


def _check_rendering() -> CheckResult:
    """Whether rendering works, with the error in one line if it does not."""
    try:
        return _render_image()
    except Exception as error:  # noqa: BLE001, RUF100 - GL libraries raise various errors
        return CheckResult("rendering", works=False, detail=str(error).splitlines()[0], advice=RENDERING_ADVICE)


def _check_module(name: str, module: str, advice: str) -> CheckResult:
    """Whether a Python module is installed; the module is not imported."""
    try:
        works = importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        works = False
    try:
        detail = version(module.partition(".")[0]) if works else "not installed"
    except PackageNotFoundError:
        detail = "installed"
    return CheckResult(name, works, detail, advice)


def _check_program(name: str, programs: tuple[str, ...], advice: str) -> CheckResult:
    """Whether one of several programs is on the PATH."""
    path = next((found for program in programs if (found := shutil.which(program))), None)
    return CheckResult(name, path is not None, path or "not found", advice)


def _check_ros1() -> CheckResult:
    """Whether rospy can be imported, from a sourced ROS environment or from Debian's packages."""
    from wherry.ros.transports.ros1_messages import ros1_module  # noqa: PLC0415 - a broken package must not break the other checks

    try:
        found = ros1_module("rospy").__file__
    except InputError as error:
        return CheckResult("ROS 1", works=False, detail="not installed", advice=error.reason)
    return CheckResult("ROS 1", works=True, detail=str(Path(found or "").parent), advice="")


def _check_logs() -> CheckResult:
    """Whether the recorded lidar logs are in the data folder."""
    folder = Path(os.environ.get("WHERRY_DATA", "../shared/data"))
    works = (folder / "intel").is_dir()
    advice = "set WHERRY_DATA to the folder that contains intel/ (docs/how-to/logs.md); for reproduce and bench"
    return CheckResult("recorded logs", works, str(folder) if works else f"not in {folder}", advice)


CHECKS: Mapping[str, Callable[[], CheckResult]] = {
    "Python": _check_python,
    "packages": _check_packages,
    "numba cache": _check_kernels,
    "rendering": _check_rendering,
    "ROS 1": _check_ros1,
    "ROS 2": partial(_check_module, "ROS 2", "cyclonedds", "pip install 'wherry[ros2]'"),
    "RViz": partial(_check_program, "RViz", ("rviz2", "rviz"), "apt install ros-…-rviz2 (ROS 2) or rviz (ROS 1)"),
    "Gazebo": partial(_check_program, "Gazebo", ("gz", "ign"), "install Gazebo; needed to drive its robots"),
    "bags": partial(_check_module, "bags", "rosbags", "pip install 'wherry[bags]'; needed for ROS bags"),
    "MiniGrid": partial(_check_module, "MiniGrid", "minigrid", "pip install 'wherry[minigrid]'"),
    "PDDL": partial(_check_module, "PDDL", "unified_planning", "pip install 'wherry[pddl]'"),
    "Rerun": partial(_check_module, "Rerun", "rerun", "pip install 'wherry[rerun]'; needed for deliver --rerun"),
    "films": partial(_check_module, "films", "av", "pip install 'wherry[video]'; needed for deliver --video"),
    "Chromium": partial(
        _check_program,
        "Chromium",
        ("chromium", "chromium-browser", "google-chrome"),
        "apt install chromium; needed only for the tests of the page",
    ),
    "Playwright": partial(_check_module, "Playwright", "playwright", "pip install playwright; needed only for tests"),
    "recorded logs": _check_logs,
}
"""The check of each dependency, in the order of their output."""
