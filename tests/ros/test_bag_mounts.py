"""Where the lidar of a bag sits: the transforms are followed as tf2 does, and what they leave open is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.logs.lidar_log import LidarLog
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros.bags.reading import read_bag
from wherry.ros.bags.recorded_transport import RecordedTransport
from wherry.ros.bags.writer import BagWriter
from wherry.ros.encoding import encode_laser_scan, encode_odometry, encode_transform
from wherry.ros.messages import TFMessage
from wherry.ros.names import load_names
from wherry.ros.transforms import StampedTransform
from wherry.space.pose import Pose
from wherry_testing.bus import Bus
from wherry_testing.recorded_drives import record_drive

pytest.importorskip("rosbags", reason="the rosbags package is not installed")
from wherry_testing.recorded_bags import KINDS, OLD_TF, Link, SmallBag, link, quaternion, read_back

HALF_TURN = quaternion(yaw=math.pi)
QUARTER_TURN = quaternion(yaw=math.pi / 2)
UNKNOWN = r"frame 'laser': where the lidar sits on base_link is unknown.*--lidar x,y,theta"
TARGET = np.array([2.0, 1.0])  # m, base_link frame; a point that the lidar sees


@pytest.fixture(params=KINDS)
def bag(request: pytest.FixtureRequest) -> SmallBag:
    return SmallBag(request.param)


def assert_lidar(log: LidarLog, x: float, y: float, theta: float) -> None:
    assert (log.lidar.x, log.lidar.y) == pytest.approx((x, y), abs=1e-9)
    assert math.remainder(log.lidar.theta - theta, math.tau) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("chain", [["laser"], ["mast", "laser"]])
@pytest.mark.parametrize("lenient", [False, True])
def test_an_unusable_rotation_without_which_the_mount_is_unknown_names_the_option(
    bag: SmallBag, tmp_path: Path, chain: list[str], lenient: bool
) -> None:
    links = [link(parent, child, 0.2) for parent, child in zip(["base_link", *chain], chain, strict=False)]
    parent, child, place, _ = links[-1]
    bag.transforms([*links[:-1], (parent, child, place, (0.0, 0.0, 0.0, 0.0))]).drive().scan()
    expected = r"/tf_static, message 1: has the orientation \(0, 0, 0, 0\).*; --lidar x,y,theta states"
    with pytest.raises(InputError, match=expected):
        read_back(bag, tmp_path, lenient=lenient)
    assert_lidar(read_back(bag, tmp_path / "stated", lidar=Pose(0.2, 0.0)), 0.2, 0.0, 0.0)


def test_scans_of_a_tilted_lidar_name_the_option_that_chooses_others(bag: SmallBag, tmp_path: Path) -> None:
    bag.transforms([link("base_link", "tilting", 0.2, rotation=quaternion(pitch=0.5)), link("base_link", "laser", 0.2)])
    bag.drive().scan(topic="/tilt", frame="tilting").scan(2.0, topic="/tilt", frame="tilting").scan(topic="/low")
    with pytest.raises(InputError, match=r"tilted by 29°.*; --lidar x,y,theta .*, --scan-topic chooses other scans"):
        read_back(bag, tmp_path)
    assert_lidar(read_back(bag, tmp_path / "low", scan_topic="/low"), 0.2, 0.0, 0.0)


def test_scans_of_an_unknown_lidar_name_the_option_that_chooses_others(bag: SmallBag, tmp_path: Path) -> None:
    bag.transforms([link("base_link", "front", 0.2)]).drive()
    bag.scan(topic="/rear", frame="rear").scan(2.0, topic="/rear", frame="rear")
    bag.scan(topic="/front", frame="front")
    with pytest.raises(InputError, match=r"unknown; --lidar x,y,theta .*, --scan-topic chooses other scans"):
        read_back(bag, tmp_path)
    assert_lidar(read_back(bag, tmp_path / "front", scan_topic="/front"), 0.2, 0.0, 0.0)


# ---- chains


@pytest.mark.parametrize(
    ("links", "expected"),
    [
        ([link("base_link", "laser", 0.2, 0.1, 0.3, QUARTER_TURN)], (0.2, 0.1, math.pi / 2)),
        ([link("laser", "base_link", 0.2, 0.1, 0.3, QUARTER_TURN)], (-0.1, 0.2, -math.pi / 2)),
        ([link("base_link", "mast", 1.0, 0.0, 0.0, QUARTER_TURN), link("mast", "laser", 0.5)], (1.0, 0.5, math.pi / 2)),
        ([link("plate", "laser", 0.5, 0.1), link("plate", "base_link", 0.2)], (0.3, 0.1, 0.0)),
        (
            [
                link("base_footprint", "base_link", 0.0, 0.0, 0.1),
                link("base_footprint", "laser", -0.2, 0.0, 0.4, HALF_TURN),
            ],
            (-0.2, 0.0, math.pi),
        ),
    ],
    ids=["direct", "reversed", "chain", "common ancestor", "over base_footprint"],
)
def test_the_chain_from_base_link_to_the_lidar_is_followed(
    bag: SmallBag, tmp_path: Path, links: list[Link], expected: tuple[float, float, float]
) -> None:
    log = read_back(bag.drive().transforms(links).scan(), tmp_path)
    assert_lidar(log, *expected)


def test_the_base_frame_is_that_of_odometry(bag: SmallBag, tmp_path: Path) -> None:
    links = [link("chassis", "laser", 0.3), link("base_link", "chassis", 1.0)]
    assert_lidar(read_back(bag.drive(child="chassis").transforms(links).scan(), tmp_path), 0.3, 0.0, 0.0)


def test_odometry_without_a_child_frame_is_of_the_frame_in_odom(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive(child="").transforms([link("chassis", "laser", 0.3)])
    log = read_back(bag.transforms([link("odom", "chassis", 1.0)], topic="/tf").scan(), tmp_path)
    assert_lidar(log, 0.3, 0.0, 0.0)
    assert "odometry does not name the robot's frame; 'chassis' is taken for it" in log.notes


def test_base_link_stands_for_a_base_footprint_that_the_transforms_do_not_know(bag: SmallBag, tmp_path: Path) -> None:
    log = read_back(bag.drive(child="base_footprint").transforms([link("base_link", "laser", 0.3)]).scan(), tmp_path)
    assert_lidar(log, 0.3, 0.0, 0.0)
    assert "the frame 'base_footprint' of the messages is taken for 'base_link' of the transforms" in log.notes


def test_scans_in_the_frame_of_the_robot_need_no_transform(bag: SmallBag, tmp_path: Path) -> None:
    assert_lidar(read_back(bag.drive().scan(frame="/base_link"), tmp_path), 0.0, 0.0, 0.0)


def test_the_way_to_the_lidar_does_not_lead_through_the_world(bag: SmallBag, tmp_path: Path) -> None:
    links = [link("odom", "base_link"), link("map", "odom"), link("map", "laser", 3.0)]
    with pytest.raises(
        InputError, match=r"frame 'laser': where the lidar sits on base_link is unknown.*--lidar x,y,theta"
    ):
        read_back(bag.drive().transforms(links, topic="/tf").scan(), tmp_path)


# ---- prefixes and namespaces


@pytest.mark.parametrize(
    ("prefix", "scan_frame", "child", "tf", "scans"),
    [
        ("robot1/", "robot1/laser", "robot1/base_link", "/tf_static", "/robot1/scan"),
        ("robot1/", "laser", "base_link", "/robot1/tf_static", "/robot1/scan"),
        ("robot1/", "laser", "robot1/base_link", "/tf_static", "/scan"),
        ("", "robot1/laser", "robot1/base_link", "/robot1/tf_static", "/robot1/scan"),
        ("/", "laser", "/base_link", "/tf_static", "/scan"),
        ("", "/laser", "base_link", "tf_static", "scan"),
        ("", "laser", "base_link", "/robot1/tf_static", "/scan"),
        ("robot1_", "robot1_laser", "robot1_base_link", "/tf_static", "/robot1/scan"),
    ],
)
def test_prefixes_and_namespaces(
    bag: SmallBag, tmp_path: Path, prefix: str, scan_frame: str, child: str, tf: str, scans: str
) -> None:
    bag.drive(topic=scans.replace("scan", "odom"), child=child)
    bag.transforms([link(f"{prefix}base_link", f"{prefix}laser", 0.2)], topic=tf)
    assert_lidar(read_back(bag.scan(topic=scans, frame=scan_frame), tmp_path), 0.2, 0.0, 0.0)


def two_robots(bag: SmallBag) -> SmallBag:
    """Two robots with the same frames, whose lidars sit differently, the second one with more scans."""
    for number, robot in enumerate(("robot1", "robot2"), start=1):
        bag.drive(topic=f"/{robot}/odom")
        bag.transforms([link("base_link", "laser", 0.1 * number)], topic=f"/{robot}/tf_static")
        for step in range(number):
            bag.scan(1.0 + step, topic=f"/{robot}/scan")
    return bag


@pytest.mark.parametrize(("topic", "x"), [("/robot1/scan", 0.1), ("robot2/scan", 0.2), (None, 0.2)])
def test_the_namespace_of_the_scans_tells_the_robot(bag: SmallBag, tmp_path: Path, topic: str | None, x: float) -> None:
    assert_lidar(read_back(two_robots(bag), tmp_path, scan_topic=topic), x, 0.0, 0.0)


def test_two_robots_share_a_topic_of_transforms(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive(topic="/robot2/odom").scan(topic="/robot2/scan")
    bag.transforms([link(f"robot{n}/base_link", f"robot{n}/laser", 0.1 * n) for n in (1, 2)])
    assert_lidar(read_back(bag, tmp_path), 0.2, 0.0, 0.0)


def test_the_old_tf_message_of_ros_1_is_read(tmp_path: Path) -> None:
    bag = SmallBag("ros1").drive().transforms([link("base_link", "laser", 0.2)], topic="tf", message_type=OLD_TF)
    assert_lidar(read_back(bag.scan(), tmp_path), 0.2, 0.0, 0.0)


@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run"])
@pytest.mark.parametrize("prefix", ["robot1/", "robot1_"])
def test_a_recording_of_a_robot_with_namespace_and_prefix_is_read_again(tmp_path: Path, name: str, prefix: str) -> None:
    bus, names = Bus(), load_names(namespace="robot1", frame_prefix=prefix)
    topics, frames = names.topics, names.frames
    mount = StampedTransform(frames.base_link, frames.laser, 0.0, Pose(0.1, 0.2, 0.3))
    scan = Scan(1.0, np.array([1.0, 2.0, 3.0]), -0.5, 0.5, 0.25, 12.0)
    with BagWriter(tmp_path / name) as writer:
        recorded = RecordedTransport(bus.node(), writer, names)
        for topic in (topics.tf_static, topics.odom, topics.scan):
            recorded.subscribe(topic, lambda message: None)
        bus.publish(topics.tf_static, TFMessage((encode_transform(mount, 0.3),)))
        for time in (0.0, 2.0):
            odometry = Odometry(time, Pose(time), Velocity())
            bus.publish(topics.odom, encode_odometry(odometry, frames.odom, frames.base_link, np.zeros(36)))
        bus.publish(topics.scan, encode_laser_scan(scan, frames.laser))
    log = read_bag(tmp_path / name)
    assert_lidar(log, 0.1, 0.2, 0.3)
    assert log.scans[0].ranges.tolist() == [1.0, 2.0, 3.0]
    assert log.scan_odometry[0] is not None
    assert log.scan_odometry[0].pose.x == pytest.approx(1.0)


# ---- transforms that change


def test_a_constant_transform_on_tf_is_followed(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms([link("mast", "laser", 0.1)])
    for time in range(10):
        bag.transforms([link("odom", "base_link", 0.5 * time), link("base_link", "mast", 0.2)], time, "/tf")
    assert_lidar(read_back(bag.scan(), tmp_path), 0.3, 0.0, 0.0)


@pytest.mark.parametrize("turn", [quaternion(yaw=0.5), quaternion(pitch=0.5)], ids=["turning", "nodding"])
def test_a_lidar_that_moves_on_the_robot_is_refused(
    bag: SmallBag, tmp_path: Path, turn: tuple[float, float, float, float]
) -> None:
    bag.drive().transforms([link("mast", "laser", 0.1)])
    bag.transforms([link("base_link", "mast", 0.2)], 0.0, "/tf")
    bag.transforms([link("base_link", "mast", 0.2, rotation=turn)], 1.0, "/tf")
    with pytest.raises(InputError, match=r"frame 'laser'.*the transform base_link → mast moves by 0\.00 m and 29°"):
        read_back(bag.scan(), tmp_path)


def test_transforms_that_contradict_each_other_are_refused(bag: SmallBag, tmp_path: Path) -> None:
    links = [link("base_link", "laser", 0.2), link("base_link", "mast", 0.5), link("mast", "laser", 0.5)]
    with pytest.raises(InputError, match="contradicts the others"):
        read_back(bag.drive().transforms(links).scan(), tmp_path)


# ---- tilt


def ranges_to_target(mount: Link) -> tuple[float, float]:
    """Direction in the lidar's frame and range of `TARGET`, from the definition of a quaternion's rotation matrix."""
    _, _, (tx, ty, _), (x, y, z, w) = mount
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    seen = rotation.T @ np.array([TARGET[0] - tx, TARGET[1] - ty, 0.0])
    return math.atan2(seen[1], seen[0]), math.hypot(seen[0], seen[1])


@pytest.mark.parametrize(
    "turn",
    [
        quaternion(),
        quaternion(roll=math.pi),
        quaternion(pitch=math.pi),
        quaternion(roll=math.pi, yaw=math.pi / 2),
        quaternion(roll=math.pi, yaw=-2.5),
        quaternion(pitch=math.pi, yaw=0.7),
        quaternion(roll=math.pi, pitch=math.pi, yaw=0.3),
    ],
)
def test_a_lidar_upside_down_sees_what_is_there(bag: SmallBag, tmp_path: Path, turn: tuple[float, ...]) -> None:
    mount = link("base_link", "laser", 0.3, -0.2, 0.4, turn)  # type: ignore[arg-type]
    angle, distance = ranges_to_target(mount)
    bag.drive().transforms([mount])
    log = read_back(
        bag.scan(angle_min=angle - 0.1, angle_increment=0.1, ranges=[np.nan, distance, np.nan, np.nan]), tmp_path
    )
    assert log.scans[0].angle_increment > 0.0
    np.testing.assert_allclose(log.lidar.transform(log.scans[0].points()), [TARGET], atol=1e-6)


def test_a_drive_is_the_same_with_the_lidar_upside_down(tmp_path: Path) -> None:
    """In a namespace, over a reversed link, and with range_max less 0.1 mm where a beam meets nothing."""
    log = read_bag(record_drive(tmp_path).ros1)
    to_mast = link("robot1/base_link", "robot1/mast", log.lidar.x, log.lidar.y, 0.3, quaternion(yaw=log.lidar.theta))
    to_laser = link("robot1/laser", "robot1/mast", rotation=quaternion(roll=math.pi))
    bag = SmallBag("mcap").transforms([to_mast, to_laser], topic="/robot1/tf_static")
    for time, pose in zip(log.odometry.times.tolist(), log.odometry.poses.tolist(), strict=True):
        names = {"topic": "/robot1/odom", "frame": "robot1/odom", "child": "robot1/base_link"}
        bag.odometry(time, pose[0], pose[2], y=pose[1], **names)
    for scan in log.scans:
        turned = scan.mirrored()
        ranges = np.where(np.isinf(turned.ranges), scan.range_max - 1e-4, turned.ranges)
        fields = {name: getattr(turned, name) for name in ("angle_min", "angle_increment", "range_min", "range_max")}
        bag.scan(scan.time, "/robot1/scan", ranges=ranges, **fields)
    again = read_back(bag, tmp_path / "again")
    assert_lidar(again, log.lidar.x, log.lidar.y, log.lidar.theta)
    np.testing.assert_allclose(again.odometry.poses, log.odometry.poses, atol=1e-9)
    for scan, other in zip(log.scans, again.scans, strict=True):
        np.testing.assert_array_equal(scan.ranges, other.ranges)
        np.testing.assert_allclose(scan.angles, other.angles, atol=1e-5)


@pytest.mark.parametrize(
    ("turn", "degrees"),
    [
        (quaternion(roll=0.3), 17),
        (quaternion(pitch=-math.radians(30)), 30),
        (quaternion(roll=math.pi / 2), 90),
        (quaternion(roll=math.pi - 0.3), 163),
    ],
)
def test_a_tilted_lidar_is_refused(bag: SmallBag, tmp_path: Path, turn: tuple[float, ...], degrees: int) -> None:
    bag.drive().transforms([link("base_link", "laser", rotation=turn)]).scan()  # type: ignore[arg-type]
    with pytest.raises(
        InputError, match=f"frame 'laser'.*it is tilted by {degrees}°, and only a level.*--lidar x,y,theta"
    ):
        read_back(bag, tmp_path)


def test_a_lidar_that_is_tilted_a_little_is_level(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms([link("base_link", "laser", 0.2, rotation=quaternion(roll=0.1))]).scan()
    log = read_back(bag, tmp_path)
    assert log.lidar.x == pytest.approx(0.2)
    assert log.lidar.theta == pytest.approx(0.0)


# ---- unknown and stated mounts


def test_an_unknown_mount_is_refused_with_the_option_that_states_it(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms([link("base_link", "camera"), link("camera", "lens")]).scan()
    with pytest.raises(InputError) as caught:
        read_back(bag, tmp_path)
    assert "frame 'laser': where the lidar sits on base_link is unknown" in str(caught.value)
    assert str(caught.value).endswith("; frames of the transforms: base_link, camera, lens")
    assert "--lidar x,y,theta states it (m, m, degrees)" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_bag_with_odometry_and_no_transforms_is_refused(bag: SmallBag, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--lidar x,y,theta states it .*; frames of the transforms: none"):
        read_back(bag.drive().scan(), tmp_path)


def test_without_odometry_the_lidar_is_the_robot(bag: SmallBag, tmp_path: Path) -> None:
    log = read_back(bag.scan(), tmp_path)
    assert_lidar(log, 0.0, 0.0, 0.0)
    assert "no transform says where the lidar sits on the robot, so its frame is taken for the robot's" in log.notes


@pytest.mark.parametrize("lenient", [False, True])
def test_without_odometry_a_broken_transform_to_the_lidar_is_still_named(
    bag: SmallBag, tmp_path: Path, lenient: bool
) -> None:
    bag.transforms([link("base_link", "laser", rotation=(0.0, 0.0, 0.0, 0.0))]).scan()
    with pytest.raises(InputError, match=r"/tf_static, message 1: has the orientation \(0, 0, 0, 0\), which is not"):
        read_back(bag, tmp_path, lenient=lenient)


def test_broken_transforms_of_other_frames_do_not_matter(bag: SmallBag, tmp_path: Path) -> None:
    links = [link("base_link", "camera", rotation=(0.0, 0.0, 0.0, 0.0)), link("base_link", "laser", 0.2)]
    log = read_back(bag.drive().transforms(links).scan(), tmp_path)
    assert_lidar(log, 0.2, 0.0, 0.0)
    assert log.skipped == ()


def test_the_mount_that_is_stated_counts(bag: SmallBag, tmp_path: Path) -> None:
    log = read_back(bag.drive().scan(), tmp_path, lidar=Pose(0.2, 0.0, math.pi))
    assert log.lidar == Pose(0.2, 0.0, math.pi)
    assert not [note for note in log.notes if "--lidar" in note]


def test_transforms_that_disagree_with_the_stated_mount_are_noted(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms([link("base_link", "laser", 0.1, 0.0, 0.0, quaternion(roll=math.pi))]).scan()
    log = read_back(bag, tmp_path, lidar=Pose(0.2, 0.0, 0.0))
    assert log.lidar == Pose(0.2, 0.0, 0.0)
    assert log.scans[0].ranges.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    expected = (
        "the lidar is at 0.200,0.000,0.0 as --lidar states; the transforms have it at 0.100,0.000,0.0 upside down"
    )
    assert expected in log.notes


def test_the_stated_mount_holds_whatever_is_wrong_with_the_transforms(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms([link("base_link", "laser", rotation=quaternion(roll=0.5))]).scan()
    assert read_back(bag, tmp_path, lidar=Pose(0.2)).lidar == Pose(0.2)


# ---- parts of a split recording


def parts(kind: str, folder: Path, write: Callable[[SmallBag, Path, str], Path] = SmallBag.write_file) -> list[Path]:
    """Two parts of a recording; only the first one has the transforms."""
    first = SmallBag(kind).transforms([link("base_link", "laser", 0.2)])
    second = SmallBag(kind)
    for step in range(5):
        first.odometry(step, 0.5 * step).scan(step + 0.5)
        second.odometry(5.0 + step, 2.5 + 0.5 * step).scan(5.5 + step)
    first.odometry(5.0, 2.5)
    second.odometry(10.0, 5.0)
    return [write(part, folder, f"run_{number}") for number, part in enumerate((first, second))]


@pytest.mark.parametrize("kind", KINDS)
def test_the_second_part_of_a_recording_takes_the_transforms_of_the_first(tmp_path: Path, kind: str) -> None:
    _, second = parts(kind, tmp_path)
    log = read_bag(second)
    assert [scan.time for scan in log.scans] == [5.5, 6.5, 7.5, 8.5, 9.5]
    assert_lidar(log, 0.2, 0.0, 0.0)
    assert [note for note in log.notes if "other files of the recording, as run_0." in note]


@pytest.mark.parametrize("kind", KINDS)
def test_the_second_part_alone_is_refused(tmp_path: Path, kind: str) -> None:
    first, second = parts(kind, tmp_path)
    first.unlink()
    with pytest.raises(InputError, match=UNKNOWN):
        read_bag(second)


@pytest.mark.parametrize("kind", KINDS)
def test_a_folder_of_parts_is_one_recording(tmp_path: Path, kind: str) -> None:
    parts(kind, tmp_path)
    log = read_bag(tmp_path)
    assert [scan.time for scan in log.scans] == [step + 0.5 for step in range(10)]
    assert_lidar(log, 0.2, 0.0, 0.0)
