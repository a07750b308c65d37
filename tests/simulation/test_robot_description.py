"""The robot's URDF agrees with the constants in the code."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from numpy.testing import assert_allclose

from wherry.robot import BOX_HEIGHT
from wherry.simulation.drive import TRACK_WIDTH, WHEEL_RADIUS
from wherry.simulation.model import BODY, BOX_RADIUS, LIDAR_HEIGHT, robot_urdf
from wherry.simulation.referee import FORK_HALF_WIDTH, FORK_REACH

ROBOT = ET.fromstring(robot_urdf())  # noqa: S314 - a file of this package


def _numbers(element: ET.Element | None, attribute: str) -> np.ndarray:
    return (
        np.array([float(number) for number in element.get(attribute, "0 0 0").split()])
        if element is not None
        else np.zeros(3)
    )


def _joint_to(link: str) -> ET.Element | None:
    return next((joint for joint in ROBOT.iter("joint") if joint.find("child").get("link") == link), None)


def _position(link: str) -> np.ndarray:
    """[3] origin of a link, m, base_footprint frame."""
    joint = _joint_to(link)
    if joint is None:
        return np.zeros(3)
    return _position(joint.find("parent").get("link")) + _numbers(joint.find("origin"), "xyz")


def _corners(link: str, shape: str) -> np.ndarray:
    """[N, 3] corners of the bounding boxes of a link's shapes, m, base_footprint frame."""
    corners = [np.empty((0, 3))]
    for element in ROBOT.find(f"link[@name='{link}']").iter(shape):
        geometry = element.find("geometry")[0]
        size = _numbers(geometry, "size") if geometry.tag == "box" else np.full(3, 2 * float(geometry.get("radius")))
        roll, _, yaw = _numbers(element.find("origin"), "rpy")
        if geometry.tag == "cylinder":
            length = float(geometry.get("length"))
            size[1 if abs(roll) > 1 else 2] = length
        signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
        turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        corners.append(signs * size @ turn + _numbers(element.find("origin"), "xyz") + _position(link))
    return np.vstack(corners)


LINKS = [link.get("name") for link in ROBOT.iter("link")]


@pytest.mark.parametrize("link", LINKS)
def test_collision_shapes_lie_within_the_footprint(link: str) -> None:
    corners = _corners(link, "collision")
    assert np.hypot(corners[:, 0], corners[:, 1]).max(initial=0.0) <= BODY.radius + 5e-4
    assert corners[:, 2].min(initial=0.0) >= -1e-9


@pytest.mark.parametrize("link", [link for link in LINKS if link != "laser"])
def test_no_link_occludes_the_lidar(link: str) -> None:
    assert _corners(link, "visual")[:, 2].max(initial=0.0) < LIDAR_HEIGHT < BOX_HEIGHT


@pytest.mark.parametrize("link", LINKS)
def test_visual_and_collision_shapes_are_the_same(link: str) -> None:
    if link not in {"base_link", "laser"}:
        assert_allclose(_corners(link, "visual"), _corners(link, "collision"))


def test_the_lidar_has_the_pose_of_the_body() -> None:
    assert_allclose(_position("laser"), [BODY.lidar.x, BODY.lidar.y, LIDAR_HEIGHT])


def test_wheels_and_caster_touch_the_floor() -> None:
    for side, sign in (("left", 1), ("right", -1)):
        assert_allclose(_position(f"{side}_wheel"), [0.0, sign * TRACK_WIDTH / 2, WHEEL_RADIUS])
        assert _corners(f"{side}_wheel", "collision")[:, 2].min() == pytest.approx(0.0)
        assert_allclose(_numbers(_joint_to(f"{side}_wheel").find("axis"), "xyz"), [0, 1, 0])
    assert _corners("caster", "collision")[:, 2].min() == pytest.approx(0.0)


def test_a_box_fits_the_fork_with_four_centimetres_around_it() -> None:
    prong = _corners("left_prong", "collision")
    assert prong[:, 0].max() == pytest.approx(FORK_REACH)
    assert prong[:, 1].min() == pytest.approx(FORK_HALF_WIDTH) == BOX_RADIUS + 0.04
    behind = _corners("base_link", "collision")
    beam = behind[np.abs(behind[:, 1]) > 0.1][:, 0].max()
    assert beam <= -(BOX_RADIUS + 0.025)


@pytest.mark.parametrize("link", [link for link in LINKS if link != "base_footprint"])
def test_masses_and_inertias_are_physically_possible(link: str) -> None:
    inertial = ROBOT.find(f"link[@name='{link}']/inertial")
    assert float(inertial.find("mass").get("value")) > 0
    moments = [float(inertial.find("inertia").get(axis)) for axis in ("ixx", "iyy", "izz")]
    assert min(moments) > 0
    assert max(moments) <= sum(moments) - max(moments) + 1e-9


def test_links_and_joints_have_the_conventional_names() -> None:
    assert {"base_footprint", "base_link", "laser", "left_wheel", "right_wheel", "caster"} <= set(LINKS)
    moving = {joint.get("name") for joint in ROBOT.iter("joint") if joint.get("type") == "continuous"}
    assert moving == {"left_wheel_joint", "right_wheel_joint"}
