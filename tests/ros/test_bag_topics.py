"""Which topics and files of a recording are read: by stated rules, and what was chosen is said."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from wherry.errors import InputError
from wherry.logs.lidar_log import LidarLog
from wherry.ros.bags.reading import is_bag, read_bag

pytest.importorskip("rosbags", reason="the rosbags package is not installed")
from rosbags import rosbag2

from wherry_testing.recorded_bags import KINDS, LASER_SCAN, ODOMETRY, SmallBag, header, link, read_back

MOUNT = [link("base_link", "laser", 0.2)]
ROS2_KINDS = [kind for kind in KINDS if kind != "ros1"]


@pytest.fixture(params=KINDS)
def bag(request: pytest.FixtureRequest) -> SmallBag:
    return SmallBag(request.param)


def times(log: LidarLog) -> list[float]:
    return [scan.time for scan in log.scans]


# ---- topics of scans


def test_of_several_scan_topics_scan_is_read_and_said(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms(MOUNT).scan(1.0).scan(2.0, topic="/rear").scan(3.0, topic="/rear")
    log = read_back(bag, tmp_path)
    assert times(log) == [1.0]
    assert "scans are taken from /scan (1 message), not from /rear (2 messages); --scan-topic chooses" in log.notes


def test_an_empty_scan_topic_does_not_hide_another(bag: SmallBag, tmp_path: Path) -> None:
    log = read_back(bag.drive().transforms(MOUNT).declare("/scan", LASER_SCAN).scan(topic="/front/laser"), tmp_path)
    assert times(log) == [1.0]


def test_without_a_topic_named_scan_the_one_with_most_messages_is_read(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms(MOUNT).scan(1.0, topic="/a").scan(2.0, topic="/b").scan(3.0, topic="/b")
    assert times(read_back(bag, tmp_path)) == [2.0, 3.0]


def test_base_scan_is_preferred_to_a_topic_with_more_messages(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms(MOUNT).scan(1.0, topic="/base_scan").scan(2.0, topic="/a_tilt_scan")
    assert times(read_back(bag.scan(3.0, topic="/a_tilt_scan"), tmp_path)) == [1.0]


@pytest.mark.parametrize("name", ["/rear", "rear"])
def test_the_scan_topic_that_is_named_is_read(bag: SmallBag, tmp_path: Path, name: str) -> None:
    log = read_back(bag.drive().transforms(MOUNT).scan(1.0).scan(2.0, topic="/rear"), tmp_path, scan_topic=name)
    assert times(log) == [2.0]
    assert log.notes == ()


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("/missing", r"--scan-topic /missing: is not in the bag; topics of LaserScan messages: /scan \(1 message\)"),
        ("/odom", r"--scan-topic /odom: is of nav_msgs/msg/Odometry; topics of LaserScan"),
        ("/rear", r"--scan-topic /rear: has no messages; topics of LaserScan"),
    ],
)
def test_a_named_topic_without_scans_is_refused(bag: SmallBag, tmp_path: Path, name: str, reason: str) -> None:
    bag.drive().transforms(MOUNT).scan().declare("/rear", LASER_SCAN)
    with pytest.raises(InputError, match=reason):
        read_back(bag, tmp_path, scan_topic=name)


@pytest.mark.parametrize(
    ("message_type", "hint"),
    [
        ("sensor_msgs/msg/PointCloud2", "PointCloud2, and pointcloud_to_laserscan makes LaserScan messages of it"),
        ("sensor_msgs/msg/MultiEchoLaserScan", "MultiEchoLaserScan, and laser_proc makes LaserScan messages"),
    ],
)
def test_a_bag_of_another_sensor_says_what_makes_scans_of_it(
    bag: SmallBag, tmp_path: Path, message_type: str, hint: str
) -> None:
    fields = {"header": header(0.0, "laser"), "height": 0, "width": 0, "fields": [], "is_bigendian": False}
    fields |= {"point_step": 0, "row_step": 0, "data": np.zeros(0, np.uint8), "is_dense": True}
    limits = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
    fields |= dict.fromkeys(limits, 0.0) | {"ranges": [], "intensities": []}
    content = type("Content", (), fields)()
    with pytest.raises(InputError, match=f"has no usable LaserScan messages; its /points is of {hint}"):
        read_back(bag.drive().add("/points", message_type, 0.0, content), tmp_path)


def test_scans_of_two_lidars_on_one_topic_are_those_of_the_busier_one(bag: SmallBag, tmp_path: Path) -> None:
    bag.drive().transforms([*MOUNT, link("base_link", "rear", -0.2)])
    log = read_back(bag.scan(1.0).scan(2.0, frame="rear").scan(3.0), tmp_path)
    assert times(log) == [1.0, 3.0]
    assert log.lidar.x == pytest.approx(0.2)
    assert "/scan has scans in the frames 'laser' (2), 'rear' (1); those in 'laser' are used" in log.notes


# ---- topics of odometry


def test_empty_odometry_does_not_hide_transforms(bag: SmallBag, tmp_path: Path) -> None:
    bag.declare("/odom", ODOMETRY).transforms(MOUNT).scan(2.0)
    for time in range(5):
        bag.transforms([link("odom", "base_link", 0.5 * time)], time, "/tf")
    log = read_back(bag, tmp_path)
    assert log.scan_odometry[0] is not None
    assert log.scan_odometry[0].pose.x == pytest.approx(1.0)
    assert "odometry is taken from the transforms odom → base_link" in log.notes
    assert "/odom (0 messages) is empty and was not read; --odom-topic chooses odometry" in log.notes


@pytest.mark.parametrize(
    ("option", "x"), [(None, 1.0), ("/wheels/odometry", 3.0), ("/tf", 5.0), ("tf", 5.0), ("/filtered", 7.0)]
)
def test_of_several_sources_of_odometry_the_one_named_is_read(
    bag: SmallBag, tmp_path: Path, option: str | None, x: float
) -> None:
    bag.transforms(MOUNT).scan(5.0)
    for time in (0.0, 10.0):
        bag.odometry(time, 1.0).odometry(time, 3.0, topic="/wheels/odometry").odometry(time, 7.0, topic="/filtered")
        bag.transforms([link("odom", "base_link", 5.0)], time, "/tf")
    log = read_back(bag, tmp_path, odometry_topic=option)
    assert log.scan_odometry[0] is not None
    assert log.scan_odometry[0].pose.x == pytest.approx(x)
    noted = [note for note in log.notes if note.startswith("odometry is taken from /odom (2 messages), not from")]
    assert len(noted) == (option is None)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("/missing", r"--odom-topic /missing: is not in the bag; topics of Odometry or TFMessage messages: /odom"),
        ("/scan", "--odom-topic /scan: is of sensor_msgs/msg/LaserScan; topics of Odometry"),
        ("/tf_static", "--odom-topic /tf_static: has no transform of the robot in a frame odom"),
    ],
)
def test_a_named_topic_without_odometry_is_refused(bag: SmallBag, tmp_path: Path, name: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        read_back(bag.drive().transforms(MOUNT).scan(), tmp_path, odometry_topic=name)


@pytest.mark.parametrize("lenient", [False, True])
def test_odometry_of_zero_quaternions_alone_is_refused(bag: SmallBag, tmp_path: Path, lenient: bool) -> None:
    for time in range(5):
        bag.odometry(time, orientation=(0.0, 0.0, 0.0, 0.0))
    expected = r"/odom, message 1: has the orientation \(0, 0, 0, 0\), which is not a unit quaternion"
    with pytest.raises(InputError, match=expected) as caught:
        read_back(bag.transforms(MOUNT).scan(), tmp_path, lenient=lenient)
    assert len(str(caught.value).partition("run")[2]) < 300
    if lenient:
        assert "none of its 5 messages can be used" in str(caught.value)
        assert "--odom-topic chooses another" in str(caught.value)


def test_transforms_of_zero_quaternions_give_no_odometry(bag: SmallBag, tmp_path: Path) -> None:
    bag.transforms(MOUNT).scan().transforms([link("odom", "base_link", rotation=(0.0, 0.0, 0.0, 0.0))], 0.0, "/tf")
    with pytest.raises(InputError, match="/tf, message 1: has the orientation"):
        read_back(bag, tmp_path)
    with pytest.raises(InputError, match=r"odom → base_link: no transform can be used \(the first: /tf, message 1"):
        read_back(bag, tmp_path / "again", lenient=True)


def test_odometry_of_an_unusual_name_is_said(bag: SmallBag, tmp_path: Path) -> None:
    log = read_back(bag.drive(topic="/ground_truth").transforms(MOUNT).scan(), tmp_path)
    assert log.notes == ("odometry is taken from /ground_truth (11 messages); --odom-topic chooses",)


def test_odometry_of_another_robot_is_not_read(bag: SmallBag, tmp_path: Path) -> None:
    bag.scan(topic="/robot1/scan").scan(topic="/robot2/scan").scan(2.0, topic="/robot2/scan").drive(
        topic="/robot1/odom"
    )
    log = read_back(bag, tmp_path)
    assert len(log.scans) == 2
    assert log.scan_odometry == (None, None)
    assert "/robot1/odom (11 messages) is another robot's and was not read; --odom-topic chooses odometry" in log.notes


# ---- types of other packages


@pytest.mark.parametrize("definition", ["?? this is not a definition", "other_msgs/Unknown field\n", ""])
def test_a_type_that_cannot_be_parsed_does_not_matter(bag: SmallBag, tmp_path: Path, definition: str) -> None:
    bag.drive().transforms(MOUNT).scan().define("/odd", "odd_msgs/msg/Odd", definition)
    assert times(read_back(bag, tmp_path)) == [1.0]


@pytest.mark.parametrize("kind", ["ros1", "sqlite"])  # MCAP has no hashes
def test_a_type_of_ros_that_is_defined_otherwise_is_refused(tmp_path: Path, kind: str) -> None:
    bag = SmallBag(kind).drive().transforms(MOUNT).define("/scan", LASER_SCAN, "float32 angle\n")
    with pytest.raises(InputError, match="/scan: its sensor_msgs/msg/LaserScan is defined otherwise than that of ROS"):
        read_back(bag, tmp_path)


# ---- files


@pytest.mark.parametrize("kind", ROS2_KINDS)
def test_a_file_beside_the_metadata_of_another_bag_is_read_itself(tmp_path: Path, kind: str) -> None:
    folder = SmallBag(kind).drive().transforms(MOUNT).scan(1.0).write(tmp_path / "run")
    other = SmallBag(kind).drive().transforms(MOUNT).scan(7.0).write_file(folder, "other")
    assert times(read_bag(other)) == [7.0]
    assert times(read_bag(folder)) == [1.0]


@pytest.mark.parametrize("kind", ROS2_KINDS)
def test_a_folder_without_metadata_is_read(tmp_path: Path, kind: str) -> None:
    folder = SmallBag(kind).drive().transforms(MOUNT).scan(1.0).write(tmp_path / "run")
    (folder / "metadata.yaml").unlink()
    assert is_bag(folder)
    assert times(read_bag(folder)) == [1.0]


@pytest.mark.parametrize("content", ["", "rosbag2_bagfile_information: [", "a: 1", "- 1", "\ufeffa: 1"])
def test_metadata_that_cannot_be_read_is_not_used(tmp_path: Path, content: str) -> None:
    folder = SmallBag("mcap").drive().transforms(MOUNT).scan(1.0).write(tmp_path / "run")
    (folder / "metadata.yaml").write_text(content)
    log = read_bag(folder)
    assert times(log) == [1.0]
    assert "metadata.yaml cannot be read and was not used" in log.notes


def test_metadata_that_would_fill_the_memory_is_not_used(tmp_path: Path) -> None:
    folder = SmallBag("mcap").drive().transforms(MOUNT).scan(1.0).write(tmp_path / "run")
    layers = "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 30))
    files = "rosbag2_bagfile_information: {relative_file_paths: [*a29]}\n"
    (folder / "metadata.yaml").write_text(f"a0: &a0 [x]\n{layers}{files}")
    assert times(read_bag(folder)) == [1.0]
    (folder / "metadata.yaml").write_bytes(b"#" * 3_000_000)
    assert "metadata.yaml is too large and was not used" in read_bag(folder).notes


@pytest.mark.parametrize("kind", ROS2_KINDS)
def test_an_empty_storage_identifier_does_not_matter(tmp_path: Path, kind: str) -> None:
    folder = SmallBag(kind).drive().transforms(MOUNT).scan(1.0).write(tmp_path / "run")
    path = folder / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    document["rosbag2_bagfile_information"]["storage_identifier"] = ""
    path.write_text(yaml.safe_dump(document))
    assert times(read_bag(folder)) == [1.0]


def test_metadata_of_files_that_are_gone_is_not_used(tmp_path: Path) -> None:
    folder = SmallBag("mcap").drive().transforms(MOUNT).scan(1.0).write(tmp_path / "run")
    (folder / "run.mcap").rename(folder / "renamed.mcap")
    log = read_bag(folder)
    assert times(log) == [1.0]
    assert "metadata.yaml lists run.mcap, which the folder does not hold" in log.notes


@pytest.mark.parametrize("kind", KINDS)
def test_a_folder_of_two_recordings_is_refused(tmp_path: Path, kind: str) -> None:
    for name in ("monday", "tuesday"):
        SmallBag(kind).drive().transforms(MOUNT).scan().write_file(tmp_path, name)
    with pytest.raises(InputError, match=r"holds several recordings; name one of monday\.\w+, tuesday\.\w+"):
        read_bag(tmp_path)


def test_parts_named_by_date_are_one_recording(tmp_path: Path) -> None:
    for number, name in enumerate(("2024-05-01-10-00-00_0", "2024-05-01-10-05-00_1")):
        SmallBag("ros1").drive().transforms(MOUNT).scan(1.0 + number).write_file(tmp_path, name)
    assert times(read_bag(tmp_path)) == [1.0, 2.0]


def test_parts_are_read_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for number in (9, 10, 11):
        SmallBag("mcap").drive().transforms(MOUNT).scan(number - 8.0).write_file(tmp_path, f"run_{number}")
    assert times(read_bag(tmp_path)) == [1.0, 2.0, 3.0]


def test_a_folder_without_bags_is_none(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("")
    assert not is_bag(tmp_path)
    with pytest.raises(InputError, match=r"holds no \.bag, \.mcap or \.db3 file"):
        read_bag(tmp_path)


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
@pytest.mark.parametrize("kind", ROS2_KINDS)
def test_compressed_bags_are_read(tmp_path: Path, kind: str, mode: str) -> None:
    options = {"mode": rosbag2.CompressionMode[mode], "fmt": rosbag2.CompressionFormat.ZSTD}
    folder = SmallBag(kind).drive().transforms(MOUNT).scan(1.0).write(tmp_path / "run", **options)
    assert times(read_bag(folder)) == [1.0]
    (file,) = (entry for entry in folder.iterdir() if entry.name != "metadata.yaml")
    assert is_bag(file)
    assert times(read_bag(file)) == [1.0]


def test_a_damaged_compressed_file_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "run.db3.zstd"
    path.write_bytes(b"nonsense")
    with pytest.raises(InputError, match="is not a bag that can be read") as caught:
        read_bag(path)
    assert "\n" not in str(caught.value)
    assert math.isfinite(len(str(caught.value)))
