"""Off-screen rendering of the simulated world through EGL."""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.simulation.model import MAX_PICTURE_HEIGHT, MAX_PICTURE_WIDTH
from wherry.simulation.simulator import Simulation

FIELD_OF_VIEW = 45.0  # °, vertical, of MuJoCo's free camera
OVERHEAD_MARGIN = 0.5  # m added to the smallest distance at which the overhead camera shows the whole building
CHASE_DISTANCE = 2.2  # m from the chase camera to the robot
CHASE_ELEVATION = -35.0  # ° of the chase camera
EXTRA_GEOMS = 100  # decorative geoms that MuJoCo may add to those of the model

Image = NDArray[np.uint8]
"""[height, width, 3] RGB picture, row 0 at the top."""


class SceneRenderer:
    """Renders pictures of a simulation; call `close` afterwards, or use ``contextlib.closing``.

    Args:
        simulation: The simulation.
        width: Width of the pictures, pixels, at most 1920.
        height: Height of the pictures, pixels, at most 1080.

    Raises:
        InputError: OpenGL is not available, or the picture is too large.
    """

    def __init__(self, simulation: Simulation, width: int = 640, height: int = 480) -> None:
        if not (0 < width <= MAX_PICTURE_WIDTH and 0 < height <= MAX_PICTURE_HEIGHT):
            limits = f"{MAX_PICTURE_WIDTH} × {MAX_PICTURE_HEIGHT}"
            raise InputError("picture", "size", f"must be 1 × 1 to {limits} pixels, not {width} × {height}")
        self._simulation = simulation
        model = simulation.physics.model
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._gl = _gl_context(width, height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_150.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + EXTRA_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0  # shadows take four times the time
        self._option = mujoco.MjvOption()

    def overhead(self) -> Image:
        """[height, width, 3] RGB picture of the whole building from above, north at the top."""
        geometry = self._simulation.geometry
        width, depth = float(np.ptp(geometry.xs)), float(np.ptp(geometry.ys))
        aspect_ratio = self._rectangle.width / self._rectangle.height
        distance = max(depth, width / aspect_ratio) / 2 / math.tan(math.radians(FIELD_OF_VIEW / 2)) + OVERHEAD_MARGIN
        centre = (float(geometry.xs.mean()), float(geometry.ys.mean()))
        return self._render(centre, azimuth=90.0, elevation=-90.0, distance=distance)

    def chase(self) -> Image:
        """[height, width, 3] RGB picture of the robot from behind and above."""
        pose = self._simulation.physics.robot_pose
        azimuth = math.degrees(pose.theta)
        return self._render((pose.x, pose.y), azimuth=azimuth, elevation=CHASE_ELEVATION, distance=CHASE_DISTANCE)

    def close(self) -> None:
        """Release the graphics memory."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()

    def _render(self, target: tuple[float, float], *, azimuth: float, elevation: float, distance: float) -> Image:
        """Render from a camera that looks at a point on the floor.

        Args:
            target: Point x, y, m, world frame.
            azimuth: Direction in which the camera looks, °, counter-clockwise from the x axis.
            elevation: Angle of the view above the horizontal, °; −90 looks straight down.
            distance: Distance of the camera from the target, m.
        """
        camera = mujoco.MjvCamera()
        camera.lookat = [*target, 0.0]
        camera.azimuth, camera.elevation, camera.distance = azimuth, elevation, distance
        physics = self._simulation.physics
        self._gl.make_current()
        all_categories = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(physics.model, physics.data, self._option, None, camera, all_categories, self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._context)
        image = np.empty((self._rectangle.height, self._rectangle.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(image, None, self._rectangle, self._context)
        return np.ascontiguousarray(image[::-1])


def _gl_context(width: int, height: int) -> mujoco.GLContext:
    """Create an off-screen OpenGL context through EGL."""
    try:
        from mujoco.egl import GLContext  # noqa: PLC0415 - loads the graphics library, which may be missing

        return GLContext(width, height)
    except (ImportError, AttributeError, RuntimeError, OSError) as error:
        advice = "install it (Debian: apt-get install libegl1 libgl1-mesa-dri)"
        raise InputError("picture", "OpenGL", f"EGL is not available ({error}); {advice}") from error
