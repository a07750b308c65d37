"""What is installed here, each asked in the way in which it is going to be used."""

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
from wherry.kernels import are_compiled

OLDEST_PYTHON = (3, 11)
REQUIRED = (
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
class Finding:
    """What is known of one thing.

    Attributes:
        name: What it is called.
        works: Whether it is there and works.
        detail: What was found: a version, a place, or an error.
        advice: What to do where it is not there.
        required: Whether nothing goes without it.
    """

    name: str
    works: bool
    detail: str
    advice: str
    required: bool = False


def failed(name: str, error: Exception) -> Finding:
    """The finding that looking for something raised an error."""
    required = name in ("Python", "packages")
    return Finding(
        name, works=False, detail=f"{type(error).__name__}: {error}", advice="see the error", required=required
    )


def _python() -> Finding:
    works = sys.version_info >= OLDEST_PYTHON
    return Finding("Python", works, platform.python_version(), "install Python 3.11 or newer", required=True)


def _packages() -> Finding:
    """Whether the packages that everything else stands on are installed."""
    missing, found = [], []
    for name in REQUIRED:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    detail = f"missing: {', '.join(missing)}" if missing else ", ".join(found)
    return Finding("packages", not missing, detail, "pip install wherry, again", required=True)


def _kernels() -> Finding:
    works = are_compiled()
    detail = "compiled" if works else "not compiled yet"
    return Finding("numba cache", works, detail, "nothing: the first run compiles, in about half a minute")


def _rendering() -> Finding:
    """Whether pictures can be taken without a screen; really takes one, small, and looks whether it is blank."""
    import numpy as np  # noqa: PLC0415 - what is broken is to be told, not to keep the rest from being told

    from wherry.floorplan.world_files import find_world  # noqa: PLC0415
    from wherry.simulation import build  # noqa: PLC0415
    from wherry.simulation.rendering import SceneRenderer  # noqa: PLC0415

    world = build(find_world("small"), np.random.default_rng(0))
    with closing(SceneRenderer(world, 64, 64)) as renderer:
        works = bool(np.ptp(renderer.overhead()))
    return Finding("rendering", works, "EGL, a picture was taken", ADVICE_GL)


ADVICE_GL = "apt install libegl1 libgl1-mesa-dri; needed for pictures and films of the simulated world"


def _rendering_or_why() -> Finding:
    try:
        return _rendering()
    except Exception as error:  # noqa: BLE001, RUF100 - GL libraries fail in ways of their own
        return Finding("rendering", works=False, detail=str(error).splitlines()[0], advice=ADVICE_GL)


def _module(name: str, module: str, advice: str) -> Finding:
    """Whether a module is there; it is not imported."""
    try:
        works = importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        works = False
    try:
        detail = version(module.partition(".")[0]) if works else "not installed"
    except PackageNotFoundError:
        detail = "installed"
    return Finding(name, works, detail, advice)


def _program(name: str, programs: tuple[str, ...], advice: str) -> Finding:
    """Whether one of some programs is on the path."""
    place = next((found for program in programs if (found := shutil.which(program))), None)
    return Finding(name, place is not None, place or "not found", advice)


def _ros1() -> Finding:
    """Whether rospy can be imported, from a sourced ROS environment or from Debian's packages."""
    from wherry.ros.transports.ros1_messages import ros1_module  # noqa: PLC0415 - as for rendering

    try:
        found = ros1_module("rospy").__file__
    except InputError as error:
        return Finding("ROS 1", works=False, detail="not installed", advice=error.reason)
    return Finding("ROS 1", works=True, detail=str(Path(found or "").parent), advice="")


def _data() -> Finding:
    folder = Path(os.environ.get("WHERRY_DATA", "../shared/data"))
    works = (folder / "intel").is_dir()
    return Finding("recorded logs", works, str(folder) if works else f"not in {folder}",
                   "set WHERRY_DATA to the folder with intel/ in it; needed by reproduce and bench")  # fmt: skip


CHECKS: Mapping[str, Callable[[], Finding]] = {
    "Python": _python,
    "packages": _packages,
    "numba cache": _kernels,
    "rendering": _rendering_or_why,
    "ROS 1": _ros1,
    "ROS 2": partial(_module, "ROS 2", "cyclonedds", "pip install 'wherry[ros2]'"),
    "RViz": partial(_program, "RViz", ("rviz2", "rviz"), "apt install ros-…-rviz2 (ROS 2) or rviz (ROS 1)"),
    "Gazebo": partial(_program, "Gazebo", ("gz", "ign"), "install Gazebo, to drive its robots"),
    "bags": partial(_module, "bags", "rosbags", "pip install 'wherry[bags]', to read ROS bags"),
    "MiniGrid": partial(_module, "MiniGrid", "minigrid", "pip install 'wherry[minigrid]'"),
    "PDDL": partial(_module, "PDDL", "unified_planning", "pip install 'wherry[pddl]'"),
    "Rerun": partial(_module, "Rerun", "rerun", "pip install 'wherry[rerun]', for deliver --rerun"),
    "films": partial(_module, "films", "av", "pip install 'wherry[video]', for deliver --video"),
    "Chromium": partial(_program, "Chromium", ("chromium", "chromium-browser", "google-chrome"),
                        "apt install chromium; any browser shows the live page, only its tests need this one"),
    "Playwright": partial(_module, "Playwright", "playwright", "pip install playwright; only tests need it"),
    "recorded logs": _data,
}  # fmt: skip
"""What is looked for, in the order in which it is told."""
