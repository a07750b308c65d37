"""Checks of the installation; each dependency is tried in the way in which wherry uses it."""

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
    """The result of one check.

    Attributes:
        name: Name of the dependency.
        works: Whether it is installed and works.
        detail: Version or path that was found, or an error.
        advice: How to install it.
        is_required: Whether wherry cannot be used without it.
    """

    name: str
    works: bool
    detail: str
    advice: str
    is_required: bool = False

    def as_json(self) -> dict[str, object]:
        """The entry of ``wherry doctor --json``."""
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


def _python() -> CheckResult:
    works = sys.version_info >= MIN_PYTHON
    return CheckResult("Python", works, platform.python_version(), "install Python 3.11 or newer", is_required=True)


def _packages() -> CheckResult:
    """Whether the required packages are installed."""
    missing, found = [], []
    for name in REQUIRED_PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    detail = f"missing: {', '.join(missing)}" if missing else ", ".join(found)
    return CheckResult("packages", not missing, detail, "reinstall with pip install wherry", is_required=True)


def _kernels() -> CheckResult:
    works = are_kernels_cached()
    detail = "compiled" if works else "not compiled yet"
    return CheckResult(
        "numba cache", works, detail, "none needed: the first run compiles the kernels, in about half a minute"
    )


def _rendering() -> CheckResult:
    """Whether the simulated world can be rendered without a screen: renders a small image that must not be blank."""
    import numpy as np  # noqa: PLC0415 - a broken package must not break the other checks

    from wherry.floorplan.world_files import find_world  # noqa: PLC0415
    from wherry.simulation import build  # noqa: PLC0415
    from wherry.simulation.rendering import SceneRenderer  # noqa: PLC0415

    world = build(find_world("small"), np.random.default_rng(0))
    with closing(SceneRenderer(world, 64, 64)) as renderer:
        works = bool(np.ptp(renderer.overhead()))
    return CheckResult("rendering", works, "EGL, rendered an image", RENDERING_ADVICE)


RENDERING_ADVICE = "apt install libegl1 libgl1-mesa-dri; needed for images and videos of the simulated world"


def _rendering_or_error() -> CheckResult:
    try:
        return _rendering()
    except Exception as error:  # noqa: BLE001, RUF100 - GL libraries raise many kinds of errors
        return CheckResult("rendering", works=False, detail=str(error).splitlines()[0], advice=RENDERING_ADVICE)


def _module(name: str, module: str, advice: str) -> CheckResult:
    """Whether a module is installed; it is not imported."""
    try:
        works = importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        works = False
    try:
        detail = version(module.partition(".")[0]) if works else "not installed"
    except PackageNotFoundError:
        detail = "installed"
    return CheckResult(name, works, detail, advice)


def _program(name: str, programs: tuple[str, ...], advice: str) -> CheckResult:
    """Whether one of several programs is on the path."""
    place = next((found for program in programs if (found := shutil.which(program))), None)
    return CheckResult(name, place is not None, place or "not found", advice)


def _ros1() -> CheckResult:
    """Whether rospy can be imported, from a sourced ROS environment or from Debian's packages."""
    from wherry.ros.transports.ros1_messages import ros1_module  # noqa: PLC0415 - a broken package must not break the other checks

    try:
        found = ros1_module("rospy").__file__
    except InputError as error:
        return CheckResult("ROS 1", works=False, detail="not installed", advice=error.reason)
    return CheckResult("ROS 1", works=True, detail=str(Path(found or "").parent), advice="")


def _data() -> CheckResult:
    folder = Path(os.environ.get("WHERRY_DATA", "../shared/data"))
    works = (folder / "intel").is_dir()
    advice = "set WHERRY_DATA to the folder that contains intel/; needed by reproduce and bench"
    return CheckResult("recorded logs", works, str(folder) if works else f"not in {folder}", advice)


CHECKS: Mapping[str, Callable[[], CheckResult]] = {
    "Python": _python,
    "packages": _packages,
    "numba cache": _kernels,
    "rendering": _rendering_or_error,
    "ROS 1": _ros1,
    "ROS 2": partial(_module, "ROS 2", "cyclonedds", "pip install 'wherry[ros2]'"),
    "RViz": partial(_program, "RViz", ("rviz2", "rviz"), "apt install ros-…-rviz2 (ROS 2) or rviz (ROS 1)"),
    "Gazebo": partial(_program, "Gazebo", ("gz", "ign"), "install Gazebo, to drive its robots"),
    "bags": partial(_module, "bags", "rosbags", "pip install 'wherry[bags]', to read ROS bags"),
    "MiniGrid": partial(_module, "MiniGrid", "minigrid", "pip install 'wherry[minigrid]'"),
    "PDDL": partial(_module, "PDDL", "unified_planning", "pip install 'wherry[pddl]'"),
    "Rerun": partial(_module, "Rerun", "rerun", "pip install 'wherry[rerun]', for deliver --rerun"),
    "films": partial(_module, "films", "av", "pip install 'wherry[video]', for deliver --video"),
    "Chromium": partial(
        _program,
        "Chromium",
        ("chromium", "chromium-browser", "google-chrome"),
        "apt install chromium; only the page's tests need it, any browser shows the page",
    ),
    "Playwright": partial(_module, "Playwright", "playwright", "pip install playwright; only tests need it"),
    "recorded logs": _data,
}
"""The checks, in the order of their output."""
