"""What real stacks make of the simulated robot's messages, worked out as their sources do.

amcl_node.cpp and slam_gmapping.cpp of ROS 1's navigation stack, laser_utils.cpp and Karto.h of slam_toolbox, and the
defaults in nav2_params.yaml: none of them is here, but what they ask of a robot is arithmetic on its messages.
"""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
import pytest

from wherry.pipelines.delivery.simulator import node_of
from wherry.ros import messages as ros
from wherry.ros.decoding import decode_stamp
from wherry.ros.description import robot_description
from wherry.ros.names import load_names
from wherry.simulation.model import robot_urdf
from wherry_testing.bus import Bus
from wherry_testing.worlds import hall

TOPICS = load_names().topics
FLOAT = np.float32  # of a LaserScan's numbers


@pytest.fixture(scope="module")
def bus() -> Bus:
    """All that the robot says in a second."""
    bus, simulation = Bus(), hall()
    node_of(simulation, bus.node(), load_names(), 20.0).run(lambda: simulation.time >= 1.0)
    return bus


@pytest.fixture(scope="module")
def scan(bus: Bus) -> ros.LaserScan:
    message = bus.heard["/scan"][-1]
    assert isinstance(message, ros.LaserScan)
    return message


@pytest.fixture(scope="module")
def links(bus: Bus) -> dict[str, ros.TransformStamped]:
    """By the child's frame, of the scan's instant or without one."""
    stamp = bus.heard["/scan"][-1].header.stamp
    moving = [link for message in bus.heard["/tf"] for link in message.transforms if link.header.stamp == stamp]
    fixed = [link for message in bus.heard["/tf_static"] for link in message.transforms]
    found = {link.child_frame_id: link for link in moving + fixed}
    assert len(found) == len(moving) + len(fixed), "a frame has one parent"
    return found


def described() -> dict[str, tuple[str, list[float]]]:
    """The fixed joints that robot_state_publisher publishes: parent and place, by child."""
    urdf = ElementTree.fromstring(robot_description(robot_urdf()))  # noqa: S314 - our own file
    return {
        joint.find("child").get("link"): (
            joint.find("parent").get("link"),
            [float(number) for number in joint.find("origin").get("xyz").split()],
        )
        for joint in urdf.findall("joint")
    }


def test_every_frame_hangs_on_odom_whether_robot_state_publisher_runs_or_not(
    links: dict[str, ros.TransformStamped],
) -> None:
    for frames in (links, links | dict.fromkeys(described())):
        for frame in frames:
            above, chain = frame, [frame]
            while above != "odom":
                above = links[above].header.frame_id if above in links else described()[above][0]
                assert above not in chain
                chain.append(above)


def test_robot_state_publisher_says_of_the_same_frames_the_same(links: dict[str, ros.TransformStamped]) -> None:
    shared = links.keys() & described().keys()
    assert shared == {"laser", "base_footprint"}
    for frame in shared:
        parent, place = described()[frame]
        shift = links[frame].transform.translation
        assert links[frame].header.frame_id == parent
        assert [shift.x, shift.y, shift.z] == pytest.approx(place)


def test_the_frames_are_those_that_stacks_look_for(scan: ros.LaserScan, links: dict[str, ros.TransformStamped]) -> None:
    """nav2's amcl and slam_toolbox take base_footprint, everything else base_link; none has a slash before it."""
    assert {"base_link", "base_footprint", scan.header.frame_id} <= links.keys()
    named = [frame for link in links.values() for frame in (link.header.frame_id, link.child_frame_id)]
    assert not any(frame.startswith("/") for frame in named)


def test_gmapping_takes_the_lidar_for_level_and_upright(links: dict[str, ros.TransformStamped]) -> None:
    """It turns a point 1 m above the lidar into the lidar's frame: z must be 1 or −1 to a thousandth."""
    mount = links["laser"].transform
    assert (mount.rotation.x, mount.rotation.y) == (0.0, 0.0)
    assert (1 + mount.translation.z) - mount.translation.z == pytest.approx(1.0, abs=0.001)


def test_a_scan_comes_after_the_transform_of_its_own_instant(bus: Bus, links: dict[str, ros.TransformStamped]) -> None:
    """Message filters hold a scan back until the transform of exactly its stamp is there."""
    stamp = bus.heard["/scan"][-1].header.stamp
    assert links["base_link"].header.stamp == stamp
    assert decode_stamp(bus.heard["/scan"][0].header.stamp) > 0.0, "0 means the latest to tf, and no time to roscpp"


def test_slam_toolbox_expects_as_many_readings_as_there_are(scan: ros.LaserScan) -> None:
    """Karto refuses scans of any other length; it works with the message's float32."""
    low, high, step = FLOAT(scan.angle_min), FLOAT(scan.angle_max), FLOAT(scan.angle_increment)
    angular_range = FLOAT(abs(high - low))
    is_360 = abs(float(angular_range) - 2 * math.pi) < float(step) - float(np.finfo(FLOAT).eps) * 2 * math.pi
    if angular_range > 6.10865 and round(float(angular_range / step)) + 1 == len(scan.ranges):
        is_360 = False
    expected = math.floor((float(high) - float(low)) / float(step) + 0.5) + (0 if is_360 else 1)
    assert expected == len(scan.ranges)


def test_gmappings_and_amcls_angles_are_the_scans(scan: ros.LaserScan) -> None:
    beams = np.arange(len(scan.ranges))
    angles = scan.angle_min + beams * scan.angle_increment
    assert scan.angle_min < scan.angle_max  # otherwise gmapping reverses the ranges
    centre = (scan.angle_min + scan.angle_max) / 2
    gmapping = centre - abs(scan.angle_min - scan.angle_max) / 2 + beams * abs(scan.angle_increment)
    np.testing.assert_allclose(gmapping, angles, atol=1e-6)
    step = math.remainder(scan.angle_min + scan.angle_increment - scan.angle_min, math.tau)  # amcl: by quaternions
    np.testing.assert_allclose(scan.angle_min + beams * step, angles, atol=1e-6)


def test_what_meets_nothing_is_dropped_by_all_of_them_and_what_meets_a_wall_by_none(scan: ros.LaserScan) -> None:
    """gmapping leaves out ranges over range_max − 0.01, amcl those from range_max on; the hall has none that far."""
    assert (scan.ranges < scan.range_max - 0.01).all()
    assert (scan.ranges > scan.range_min).all()
    assert FLOAT(math.inf) > scan.range_max
    assert (scan.time_increment, scan.scan_time) == (0.0, pytest.approx(0.1))
    assert len(scan.intensities) in (0, len(scan.ranges))


def test_odometry_moves_the_frame_that_tf_moves(bus: Bus, links: dict[str, ros.TransformStamped]) -> None:
    """move_base takes the velocity from /odom, and the place from tf."""
    odometry = next(
        message for message in bus.heard["/odom"] if message.header.stamp == links["base_link"].header.stamp
    )
    link = links["base_link"]
    assert (odometry.header.frame_id, odometry.child_frame_id) == (link.header.frame_id, link.child_frame_id)
    place, shift = odometry.pose.pose.position, link.transform.translation
    assert (place.x, place.y, place.z) == (shift.x, shift.y, shift.z)
    assert odometry.pose.pose.orientation == link.transform.rotation
    covariance = odometry.pose.covariance.reshape(6, 6)
    assert (np.diag(covariance) > 0).all()
    np.testing.assert_array_equal(covariance, covariance.T)


def test_names_of_joints_are_the_descriptions(bus: Bus) -> None:
    """robot_state_publisher moves only joints that it knows."""
    urdf = ElementTree.fromstring(robot_description(robot_urdf()))  # noqa: S314 - our own file
    moving = {joint.get("name") for joint in urdf.findall("joint") if joint.get("type") != "fixed"}
    assert set(bus.heard["/joint_states"][-1].name) == moving
