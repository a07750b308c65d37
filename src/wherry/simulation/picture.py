"""Pictures of the simulated world, drawn without a screen through EGL."""

from __future__ import annotations

import math
from types import TracebackType
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.simulation.simulator import Simulation

LARGEST_WIDTH, LARGEST_HEIGHT = 1920, 1080  # pixels
FIELD_OF_VIEW = 45.0  # °, MuJoCo's free camera, from top to bottom
CHASE_DISTANCE, CHASE_ELEVATION = 2.2, -35.0  # m, °

Image = NDArray[np.uint8]


class Photographer:
    """Takes pictures of a simulation; to be closed, or used in a ``with`` statement.

    Args:
        simulation: The world.
        width: Pixels, at most 1920.
        height: Pixels, at most 1080.

    Raises:
        InputError: OpenGL cannot be used here, or the picture is too large.
    """

    def __init__(self, simulation: Simulation, width: int = 640, height: int = 480) -> None:
        if not (0 < width <= LARGEST_WIDTH and 0 < height <= LARGEST_HEIGHT):
            limits = f"{LARGEST_WIDTH} × {LARGEST_HEIGHT}"
            raise InputError("picture", "size", f"must be 1 × 1 to {limits} pixels, not {width} × {height}")
        self._simulation = simulation
        model = simulation.physics.model
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._gl = _gl_context(width, height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 100)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0  # shadows take four times as long
        self._option = mujoco.MjvOption()

    def overhead(self) -> Image:
        """[height, width, 3] RGB: the whole building from above, north at the top."""
        solids = self._simulation.solids
        width, depth = float(np.ptp(solids.xs)), float(np.ptp(solids.ys))
        shape = self._rectangle.width / self._rectangle.height
        distance = max(depth, width / shape) / 2 / math.tan(math.radians(FIELD_OF_VIEW / 2)) + 0.5
        middle = (float(solids.xs.mean()), float(solids.ys.mean()))
        return self._take(middle, azimuth=90.0, elevation=-90.0, distance=distance)

    def chase(self) -> Image:
        """[height, width, 3] RGB: the robot from behind and above."""
        pose = self._simulation.physics.robot_pose
        azimuth = math.degrees(pose.theta)
        return self._take((pose.x, pose.y), azimuth=azimuth, elevation=CHASE_ELEVATION, distance=CHASE_DISTANCE)

    def close(self) -> None:
        """Give the graphics memory back."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take(self, middle: tuple[float, float], *, azimuth: float, elevation: float, distance: float) -> Image:
        """A picture from a camera that looks at a place on the floor; angles in °."""
        camera = mujoco.MjvCamera()
        camera.lookat = [*middle, 0.0]
        camera.azimuth, camera.elevation, camera.distance = azimuth, elevation, distance
        physics = self._simulation.physics
        self._gl.make_current()
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(physics.model, physics.data, self._option, None, camera, everything, self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._context)
        image = np.empty((self._rectangle.height, self._rectangle.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, self._rectangle, self._context)
        return np.ascontiguousarray(image[::-1])


def _gl_context(width: int, height: int) -> mujoco.GLContext:
    """An OpenGL context that needs no screen."""
    try:
        from mujoco.egl import GLContext  # noqa: PLC0415 - looks for the graphics library, which may be missing

        return GLContext(width, height)
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        advice = "install it (Debian: apt-get install libegl1 libgl1-mesa-dri)"
        raise InputError("picture", "OpenGL", f"EGL cannot be used here ({error}); {advice}") from error
