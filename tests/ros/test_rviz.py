"""The configuration files of `wherry rviz`, and Debian's RViz on a virtual screen rendered in software."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from wherry.errors import InputError
from wherry.ros import rviz
from wherry.ros.description import robot_description
from wherry.ros.names import load_names
from wherry.simulation.model import robot_urdf
from wherry_testing.ros1_system import Peer, Program, Roscore, heading, require, wait_until

BLUE, RED, GREEN = "0; 0; 255", "255; 0; 0", "0; 255; 0"


def displays(ros_version: int, **options: Any) -> dict[str, dict[str, Any]]:
    document = yaml.safe_load(rviz.configuration(ros_version, load_names(**options), rviz.RvizView()))
    return {display["Name"]: display for display in document["Visualization Manager"]["Displays"]}


def topic_of(display: dict[str, Any]) -> Any:
    topic = display.get("Marker Topic", display.get("Topic"))
    return topic["Value"] if isinstance(topic, dict) else topic


# ---- configuration files


def test_both_ros_versions_have_the_same_displays() -> None:
    one, two = displays(1), displays(2)
    assert list(one) == list(two)
    for name, display in one.items():
        other = two[name]
        assert topic_of(display) == topic_of(other)
        assert display["Class"].split("/") == ["rviz", other["Class"].split("/")[1]]
        assert other["Class"].startswith("rviz_default_plugins/")
        for key in ("Color", "Enabled", "Style", "Size (m)", "Line Width", "Arrow Length"):
            assert display.get(key) == other.get(key)


def test_the_colours_are_those_of_the_paper() -> None:
    shown = displays(1)
    assert (topic_of(shown["Laser"]), shown["Laser"]["Color"]) == ("/scan", BLUE)
    assert (topic_of(shown["Particles"]), shown["Particles"]["Color"]) == ("/particlecloud", RED)
    assert (topic_of(shown["Predicted path"]), shown["Predicted path"]["Color"]) == ("/predicted_path", GREEN)


@pytest.mark.parametrize("ros_version", [1, 2])
def test_the_names_of_a_robot_are_filled_in(ros_version: int) -> None:
    shown = displays(ros_version, namespace="robot1", remappings=["scan:=/front/scan"])
    assert topic_of(shown["Laser"]) == "/front/scan"
    assert topic_of(shown["Map"]) == "/robot1/map"
    assert topic_of(shown["Boxes and cells"]) == "/robot1/markers"
    text = rviz.configuration(ros_version, load_names(namespace="robot1"), rviz.RvizView())
    tools = {tool["Class"].split("/")[1]: tool for tool in yaml.safe_load(text)["Visualization Manager"]["Tools"]}
    assert topic_of(tools["SetInitialPose"]) == "/robot1/initialpose"
    assert topic_of(tools["SetGoal"]) in ("/move_base_simple/goal", "/goal_pose"), "not ours"


@pytest.mark.parametrize("ros_version", [1, 2])
def test_the_configuration_can_be_written_to_a_file(tmp_path: Path, ros_version: int) -> None:
    command = [
        sys.executable,
        "-m",
        "wherry",
        "rviz",
        "--ros",
        str(ros_version),
        "--write",
        str(tmp_path / "robot.rviz"),
    ]
    subprocess.run([*command, "--remap", "scan:=/front/scan"], check=True)
    assert "/front/scan" in (tmp_path / "robot.rviz").read_text()


@pytest.mark.parametrize("ros_version", [1, 2])
def test_the_view_is_filled_in(ros_version: int) -> None:
    text = rviz.configuration(ros_version, load_names(), rviz.RvizView(1.5, -2.0, 120.0))
    view = yaml.safe_load(text)["Visualization Manager"]["Views"]["Current"]
    assert (view["X"], view["Y"], view["Scale"]) == (1.5, -2.0, 120.0)


def test_the_displays_request_the_qos_that_is_offered() -> None:
    """In ROS 2 a subscriber that requests more than is offered receives nothing."""
    shown = displays(2)
    assert shown["Map"]["Topic"]["Durability Policy"] == "Transient Local"
    assert shown["Laser"]["Topic"]["Reliability Policy"] == "Best Effort"


def test_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda program: None)
    monkeypatch.delenv("ROS_VERSION", raising=False)
    with pytest.raises(InputError, match="rviz and rviz2: is not installed: apt install"):
        rviz.find_rviz(None)
    with pytest.raises(InputError, match="rviz2: is not installed"):
        rviz.find_rviz(2)


@pytest.mark.parametrize(("version", "expected"), [("1", (1, "/bin/rviz")), ("2", (2, "/bin/rviz2"))])
def test_the_sourced_ros_is_used(monkeypatch: pytest.MonkeyPatch, version: str, expected: tuple[int, str]) -> None:
    monkeypatch.setattr(shutil, "which", lambda program: f"/bin/{program}")
    monkeypatch.setenv("ROS_VERSION", version)
    assert rviz.find_rviz(None) == expected


def test_the_description_has_base_link_as_its_root_and_all_links_of_the_simulator() -> None:
    description = robot_description(robot_urdf())
    assert '<parent link="base_link" />\n    <child link="base_footprint" />' in description
    assert "mesh" not in description, "meshes would not be found on another machine"
    assert robot_description(description).count("<link") == robot_urdf().count("<link")
    with pytest.raises(ValueError, match="base_joint"):
        robot_description("<robot name='other'/>")


# ---- what RViz draws

VIEW = rviz.RvizView(2.1, -1.5, 165.0)  # the small world, relative to its robot's start, fills the screen
SIMULATE = ("ros1", "simulate", "small", "--boxes", "2", "--rate", "2")
DELIVER = ("ros1", "deliver", "--warehouse", "3.6,-0.6", "--warehouse", "3.6,-1.8")
SUBSCRIBED = {
    "/scan": "sensor_msgs/LaserScan",
    "/map": "nav_msgs/OccupancyGrid",
    "/particlecloud": "geometry_msgs/PoseArray",
    "/plan": "nav_msgs/Path",
    "/predicted_path": "nav_msgs/Path",
}
BACKGROUND = (48, 48, 48)
PIXEL_TOLERANCE = 4  # pixels
DRAWING_TIMEOUT = 30.0  # s


@dataclass(frozen=True)
class Screen:
    """A screenshot of RViz, and the projection of the map frame onto it."""

    pixels: NDArray[np.int64]

    @property
    def view(self) -> tuple[slice, slice]:
        """Rows and columns of the 3D view, recognized by its background, which is larger than the map."""
        background = (self.pixels == BACKGROUND).all(axis=2)
        rows, columns = (np.flatnonzero(background.sum(axis=axis) > 100) for axis in (1, 0))
        return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)

    def project(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Rows and columns [N, 2] of points [N, 2], m, in the view's orthographic projection."""
        middle = np.array([(side.start + side.stop) / 2 for side in self.view])
        shift = (points - [VIEW.x, VIEW.y]) * VIEW.scale
        return np.floor(middle + np.column_stack([-shift[:, 1], shift[:, 0]])).astype(np.int64)

    def coloured(self, red: tuple[int, int], green: tuple[int, int], blue: tuple[int, int]) -> NDArray[np.bool_]:
        """Mask of the pixels of the view whose colour lies within limits."""
        limits = np.array([red, green, blue])
        found = np.zeros(self.pixels.shape[:2], bool)
        inside = self.pixels[self.view]
        found[self.view] = ((inside >= limits[:, 0]) & (inside <= limits[:, 1])).all(axis=2)
        return found


def near(mask: NDArray[np.bool_], places: NDArray[np.int64], distance: float = PIXEL_TOLERANCE) -> NDArray[np.bool_]:
    """[N] whether a pixel of a mask lies within a distance, pixels, of each place."""
    away = ndimage.distance_transform_edt(~mask)
    inside = (places >= 0).all(axis=1) & (places < mask.shape).all(axis=1)
    found = np.zeros(len(places), bool)
    found[inside] = away[tuple(places[inside].T)] <= distance
    return found


def mask_of(shape: tuple[int, int], places: NDArray[np.int64]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, bool)
    inside = (places >= 0).all(axis=1) & (places < shape).all(axis=1)
    mask[tuple(places[inside].T)] = True
    return mask


@contextmanager
def screen(folder: Path) -> Iterator[dict[str, str]]:
    """A virtual screen, rendered in software; yields the environment variables that programs need to use it."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x900x24", "+extension", "GLX"]
    server = subprocess.Popen(command, pass_fds=[write], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as pipe:
            number = pipe.readline().strip()
        runtime = folder / "runtime"
        runtime.mkdir(mode=0o700)
        yield {
            "DISPLAY": f":{number}",
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "QT_X11_NO_MITSHM": "1",
            "OGRE_RTT_MODE": "Copy",
            "XDG_RUNTIME_DIR": str(runtime),
        }
    finally:
        server.terminate()
        server.wait()


def photograph(environment: dict[str, str]) -> bytes:
    command = ["import", "-window", "root", "png:-"]
    return subprocess.run(command, env={**os.environ, **environment}, stdout=subprocess.PIPE, check=True).stdout


def delivers(peer: Peer) -> bool:
    """Whether all topics have messages, there are particles, and the robot follows a path."""
    if not all(peer.received[topic] for topic in SUBSCRIBED):
        return False
    path = peer.last("/predicted_path")["poses"]
    return len(peer.last("/particlecloud")["poses"]) > 0 and len(path) > 1 and length(positions(path)) > 0.4


def positions(poses: list[dict[str, Any]]) -> NDArray[np.float64]:
    """[N, 2] m."""
    inner = [pose.get("pose", pose)["position"] for pose in poses]
    return np.array([(place["x"], place["y"]) for place in inner])


def length(path: NDArray[np.float64]) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def laser_pose(peer: Peer) -> list[float]:
    """[7] x, y, z, and the quaternion of the lidar in the map frame at the time of the last scan."""
    at = peer.last("/scan")["header"]["stamp"]
    return peer.transform("map", "laser", at=(at["secs"], at["nsecs"]))


def check_laser(screen: Screen, peer: Peer) -> None:
    scan = peer.last("/scan")
    x, y, _, _, _, z, w = laser_pose(peer)
    ranges = np.array(scan["ranges"])
    angles = scan["angle_min"] + np.arange(len(ranges)) * scan["angle_increment"] + heading({"z": z, "w": w})
    seen = np.isfinite(ranges) & (ranges > 0.3)  # nearer ones hit a box in the fork, hidden below the robot
    ends = np.column_stack([x + ranges * np.cos(angles), y + ranges * np.sin(angles)])[seen]
    places = screen.project(ends)
    blue = screen.coloured((0, 90), (0, 90), (180, 255))
    assert near(blue, places).mean() > 0.9, "beams must end in blue"
    assert near(mask_of(blue.shape, places), np.argwhere(blue), 0.04 * VIEW.scale + PIXEL_TOLERANCE).mean() > 0.95, (
        "blue elsewhere"
    )


def check_particles(screen: Screen, peer: Peer) -> None:
    places = screen.project(positions(peer.last("/particlecloud")["poses"]))
    red = screen.coloured((215, 255), (0, 60), (0, 60))
    assert red.sum() > 50
    assert near(red, places, 2 * PIXEL_TOLERANCE).mean() > 0.9, "particles must be red"
    assert near(mask_of(red.shape, places), np.argwhere(red), 0.15 * VIEW.scale + PIXEL_TOLERANCE).mean() > 0.95, (
        "red elsewhere"
    )


def check_path(screen: Screen, peer: Peer) -> None:
    path = positions(peer.last("/predicted_path")["poses"])
    steps = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    along = np.arange(0.0, steps[-1], 0.02)
    points = np.column_stack([np.interp(along, steps, path[:, axis]) for axis in (0, 1)])
    places = screen.project(points)
    green = screen.coloured((0, 80), (215, 255), (0, 80))
    assert near(green, places).mean() > 0.7, "the path must be green where the robot does not hide it"
    assert near(mask_of(green.shape, places), np.argwhere(green), 0.04 * VIEW.scale + PIXEL_TOLERANCE).mean() > 0.95


def check_map(screen: Screen, peer: Peer) -> None:
    grid = peer.last("/map")
    info = grid["info"]
    values = np.array(grid["data"]).reshape(info["height"], info["width"])
    origin = info["origin"]["position"]
    assert heading(info["origin"]["orientation"]) == pytest.approx(0.0, abs=1e-6)
    for value, low, high in ((100, 0, 40), (0, 200, 255)):
        # Only the interior of free areas counts, because a cell is only a few pixels wide.
        inner = ndimage.binary_erosion(values == value, np.ones((3, 3))) if value == 0 else values == value
        y, x = np.nonzero(inner)
        points = np.column_stack([x + 0.5, y + 0.5]) * info["resolution"] + [origin["x"], origin["y"]]
        places = screen.project(points)
        shades = screen.pixels[tuple(places.T)]
        grey = np.ptp(shades, axis=1) < 30  # not covered by a coloured display
        assert grey.sum() > 50
        right = ((shades[grey] >= low) & (shades[grey] <= high)).all(axis=1)
        assert right.mean() > 0.8, f"cells of {value} % must have their shade"


@pytest.mark.slow
@pytest.mark.realtime
def test_debians_rviz_shows_a_delivery(tmp_path: Path) -> None:
    require("roscore", "rviz", "Xvfb", "import")
    centre = ("--centre", str(VIEW.x), str(VIEW.y), "--scale", str(VIEW.scale))
    with Roscore(tmp_path) as roscore, screen(tmp_path) as variables, roscore.peer() as peer:
        for topic, type_name in SUBSCRIBED.items():
            peer.listen(topic, type_name)
        with roscore.wherry(*SIMULATE) as simulator:
            roscore.environment.update(variables)
            with (
                roscore.wherry("rviz", "--ros", "1", *centre, "--", "--no-stereo", "--splash-screen", "") as viewer,
                roscore.wherry(*DELIVER) as agent,
            ):
                wait_until(lambda: delivers(peer), 300.0, f"a drive\n{agent.output}\n{viewer.output}")
                peer.transform("map", "laser")  # starts the tf2 listener, which buffers from now on
                count = len(peer.received["/scan"])
                wait_until(lambda: len(peer.received["/scan"]) > count + 10 and delivers(peer), 60.0, "still under way")
                with frozen(simulator, agent, peer):
                    check_until_drawn(Path(os.environ.get("WHERRY_PICTURES", tmp_path)) / "rviz.png", variables, peer)


def check_until_drawn(path: Path, variables: dict[str, str], peer: Peer) -> None:
    """Check screenshots until one is right: RViz rendered in software may be seconds behind."""
    deadline = time.monotonic() + DRAWING_TIMEOUT
    while True:
        picture = photograph(variables)
        path.write_bytes(picture)
        shown = Screen(np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(np.int64))
        try:
            for check in (check_map, check_laser, check_particles, check_path):
                check(shown, peer)
        except AssertionError:
            if time.monotonic() > deadline:
                raise
            time.sleep(1.0)
        else:
            return


@contextmanager
def frozen(simulator: Program, agent: Program, peer: Peer) -> Iterator[None]:
    """Freeze simulator and agent, so that RViz catches up with everything that was published."""
    simulator.freeze()
    time.sleep(0.5)  # messages in flight arrive
    laser_pose(peer)  # the agent has published the transform of the last scan
    time.sleep(0.5)
    agent.freeze()
    time.sleep(1.0)
    try:
        yield
    finally:
        agent.thaw()
        simulator.thaw()
