"""Recorded bags of ROS 1 and ROS 2: their contents, other readers, interrupted recordings, recorded transports."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.highlevel import AnyReader

from wherry.errors import InputError
from wherry.floorplan.world_files import find_world
from wherry.logs.lidar_log import LidarLog
from wherry.robot import Odometry, Scan, Velocity
from wherry.ros import messages as ros
from wherry.ros.bags.log_recorder import LogRecorder
from wherry.ros.bags.reading import is_bag, read_bag
from wherry.ros.bags.recorded_transport import RecordedTransport
from wherry.ros.bags.run_recorder import RunRecorder
from wherry.ros.bags.writer import BagWriter
from wherry.ros.encoding import encode_header
from wherry.ros.message_fields import Message, fields_of
from wherry.ros.messages import message_types
from wherry.ros.names import load_names
from wherry.ros.topics import QosProfile, Topic
from wherry.simulation import build
from wherry.simulation.model import BODY
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.space.trajectory import Trajectory
from wherry.trace.records import MapUpdate, Narration, Phase, RobotSnapshot, StepTaken

NAMES = ("run.bag", "run.mcap", "run")
ROS2_ONLY = {"texture_resource", "texture", "uv_coordinates", "mesh_file", "structure_needs_at_least_one_member"}
TOPICS = load_names().topics


def drive(robot: Any, seconds: float) -> list[Scan | Odometry]:
    """Drive in a circle; return the measurements."""
    measured = [robot.receive()]
    while measured[-1].time < seconds:
        robot.command(Velocity(0.2, 0.5))
        measured.append(robot.receive())
    return measured


def record_drive(path: Path, seconds: float = 2.0) -> list[Scan | Odometry]:
    """Record a drive of some seconds; return the measurements."""
    simulation = build(find_world("taxi"), np.random.default_rng(0))
    with BagWriter(path) as bag:
        recording = RunRecorder(bag, laser_height=0.15)
        measured = drive(recording.robot(simulation.robot), seconds)
        recording.write_map(OccupancyGrid(np.full((4, 3), 0.5, np.float32), 0.05), seconds)
    return measured


def count(measured: list[Scan | Odometry]) -> int:
    """Number of messages in a bag of a drive: one transform per odometry, one command per measurement but the last."""
    both = sum(1 + isinstance(item, Odometry) for item in measured)
    return both + len(measured) - 1 + len(("/tf_static", "/map"))


@pytest.fixture(scope="module", params=NAMES)
def bag_of_a_drive(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any]]:
    """A bag and the measurements that were recorded in it."""
    path = tmp_path_factory.mktemp("bags") / request.param
    return path, record_drive(path)


def messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Topic, time in ns, and content of all messages of a bag, in order of time."""
    with AnyReader([path]) as reader:
        for connection, stamp, raw in reader.messages():
            yield connection.topic, stamp, reader.deserialize(raw, connection.msgtype)


# ---- contents


def test_a_bag_is_read_as_a_log_of_the_measurements(bag_of_a_drive: tuple[Path, list[Any]]) -> None:
    path, measured = bag_of_a_drive
    assert is_bag(path)
    log = read_bag(path)
    scans = [item for item in measured if isinstance(item, Scan)]
    odometry = [item for item in measured if isinstance(item, Odometry)]
    assert [scan.time for scan in log.scans] == [scan.time for scan in scans]
    for found, true in zip(log.scans, scans, strict=True):
        assert_array_equal(found.ranges, true.ranges.astype(np.float32))
        assert (found.angle_min, found.range_max) == (np.float32(true.angle_min), np.float32(true.range_max))
        assert found.angle_increment == np.float32(true.angle_increment)
    assert_array_equal(log.odometry.times, [item.time for item in odometry])
    assert_allclose(log.odometry.poses, [item.pose.as_array() for item in odometry], rtol=0, atol=1e-12)
    assert log.lidar == BODY.lidar
    assert log.skipped == ()


def test_topics_have_their_default_names(bag_of_a_drive: tuple[Path, list[Any]]) -> None:
    path, measured = bag_of_a_drive
    counts = Counter(topic for topic, _, _ in messages(path))
    scans, odometry = (sum(isinstance(item, kind) for item in measured) for kind in (Scan, Odometry))
    assert counts == {
        "/tf_static": 1,
        "/tf": odometry,
        "/odom": odometry,
        "/scan": scans,
        "/cmd_vel": len(measured) - 1,
        "/map": 1,
    }


def test_stamps_are_times_of_the_robots_clock_and_transforms_precede_scans(
    bag_of_a_drive: tuple[Path, list[Any]],
) -> None:
    path, _ = bag_of_a_drive
    latest: dict[str, int] = {}
    for topic, stamp, message in messages(path):
        header = message.transforms[0].header if topic.startswith("/tf") else getattr(message, "header", None)
        if header is not None:
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == stamp
        if topic == "/scan":
            assert latest["/tf"] == latest["/odom"] == stamp
            assert "/tf_static" in latest
        latest[topic] = stamp


def example(message_type: type[Message], seed: int) -> Any:
    """A message with a different value in every field."""
    rng = np.random.default_rng(seed)
    values: dict[str, Any] = {}
    for index, field in enumerate(fields_of(message_type)):
        if not isinstance(field.type, str):
            parts = tuple(example(field.type, seed * 7 + index + part) for part in range(2))
            values[field.name] = parts[0] if field.length is None else parts
        elif field.type == "string":
            values[field.name] = f"{field.name}ä{seed}" if field.length is None else ("a", "bä")
        elif field.type == "bool":
            values[field.name] = True
        elif field.length is None:
            number = int(rng.integers(1, 99))
            values[field.name] = float(number) if field.type.startswith("float") else number
        else:
            values[field.name] = rng.integers(1, 99, field.length or 3).astype(field.type)
    return message_type(**values)


def assert_same(found: Any, true: Any, *, ros1: bool) -> None:
    """Compare all fields of a message at every depth."""
    if isinstance(true, Message):
        for field in fields_of(type(true)):
            if not (ros1 and field.name in ROS2_ONLY):
                assert_same(getattr(found, field.name), getattr(true, field.name), ros1=ros1)
    elif isinstance(true, tuple):
        assert len(found) == len(true)
        for one, other in zip(found, true, strict=True):
            assert_same(one, other, ros1=ros1)
    elif isinstance(true, np.ndarray):
        assert_array_equal(found, true)
    else:
        assert found == true


@pytest.mark.parametrize("name", NAMES)
def test_every_field_of_every_message_survives_the_round_trip(tmp_path: Path, name: str) -> None:
    known = {key: kind for key, kind in message_types().items() if not key.startswith("builtin_interfaces")}
    ros1 = name.endswith(".bag")
    if ros1:
        known = {key: kind for key, kind in known.items() if kind not in (ros.MeshFile, ros.UVCoordinate)}
    true = {f"/t{number}": example(kind, number) for number, kind in enumerate(known.values())}
    with BagWriter(tmp_path / name) as bag:
        for topic, message in true.items():
            bag.write(Topic(topic, type(message)), message, 3.25)
    found = {topic: message for topic, _, message in messages(tmp_path / name)}
    assert found.keys() == true.keys()
    for topic, message in true.items():
        assert_same(found[topic], message, ros1=ros1)


def test_headers_of_ros1_have_sequence_numbers(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run.bag") as bag:
        for _ in range(3):
            header = encode_header(1.0, "map")
            bag.write(TOPICS.plan, ros.Path(header, (ros.PoseStamped(header),)), 1.0)
    numbers = [(path.header.seq, path.poses[0].header.seq) for _, _, path in messages(tmp_path / "run.bag")]
    assert numbers == [(0, 0), (1, 1), (2, 2)]


@pytest.mark.parametrize("name", NAMES)
def test_latched_topics_are_marked(tmp_path: Path, name: str) -> None:
    with BagWriter(tmp_path / name) as bag:
        bag.write(Topic("/map", ros.String, QosProfile.LATCHED), ros.String("m"), 0.0)
        bag.write(Topic("/scan", ros.String, QosProfile.SENSOR), ros.String("s"), 0.0)
    with AnyReader([tmp_path / name]) as reader:
        extras = {connection.topic: connection.ext for connection in reader.connections}
    if name.endswith(".bag"):
        assert (extras["/map"].latching, extras["/scan"].latching) == (1, 0)
    else:
        qos = {topic: extra.offered_qos_profiles[0] for topic, extra in extras.items()}
        assert (qos["/map"].durability.name, qos["/map"].reliability.name) == ("TRANSIENT_LOCAL", "RELIABLE")
        assert (qos["/scan"].durability.name, qos["/scan"].reliability.name) == ("VOLATILE", "BEST_EFFORT")


def test_recording_does_not_change_the_run(bag_of_a_drive: tuple[Path, list[Any]]) -> None:
    simulation = build(find_world("taxi"), np.random.default_rng(0))
    for plain, recorded in zip(drive(simulation.robot, 2.0), bag_of_a_drive[1], strict=True):
        assert type(plain) is type(recorded)
        assert plain.time == recorded.time
        if isinstance(plain, Scan):
            assert_array_equal(plain.ranges, recorded.ranges)
        else:
            assert plain == recorded


# ---- estimates


def test_estimates_are_recorded(tmp_path: Path) -> None:
    none = np.empty((0, 2), np.float32)
    cloud = np.array([[1.0, 2.0, 3.1], [1.2, 2.0, -3.1]], np.float32)
    grid = OccupancyGrid(np.array([[0.0, 0.5], [1.0, 0.0]], np.float32), 0.1, Pose(-1.0, 2.0, 0.0))
    odometry = Odometry(4.0, Pose(1.0, 0.0, np.pi / 2), Velocity())
    seen = RobotSnapshot(
        4.0, Pose(1.1, 2.0, np.pi), Pose(), none, cloud, np.eye(2, dtype=np.float32), none, has_load=False
    )
    with BagWriter(tmp_path / "run.mcap") as bag:
        recording = RunRecorder(bag)
        recording.write_measurement(odometry, Pose())
        for record in (
            seen,
            MapUpdate(4.0, grid, 0.5, 1.0),
            MapUpdate(6.0, grid, 0.6, 1.0),  # within MAP_PERIOD of the last one
            MapUpdate(9.5, grid, 0.7, 1.0),
            MapUpdate(9.6, grid, 1.0, 0.0),  # the complete map is always recorded
            StepTaken(
                10.0, "1", "N", is_learning=True, has_effect=True, unknown_pairs=0, delivered=0, remaining=1, plan=none
            ),
            Narration(10.0, Phase.DONE, "not a ROS message"),
        ):
            recording(record)
    found: dict[str, list[Any]] = {}
    for topic, stamp, message in messages(tmp_path / "run.mcap"):
        found.setdefault(topic, []).append((stamp / 1e9, message))
    assert [time for time, _ in found["/map"]] == [4.0, 9.5, 9.6]
    map_message = found["/map"][0][1]
    assert_array_equal(map_message.data, [0, -1, 100, 0])
    assert (map_message.info.width, map_message.info.height, map_message.info.origin.position.x) == (2, 2, -1.0)
    links = {(t.header.frame_id, t.child_frame_id): t.transform for _, m in found["/tf"] for t in m.transforms}
    correction = seen.pose @ odometry.pose.inverse
    shift = links["map", "odom"].translation
    assert (shift.x, shift.y) == pytest.approx((correction.x, correction.y))
    assert len(found["/particlecloud"][0][1].poses) == 2
    estimate = found["/amcl_pose"][0][1].pose
    assert_allclose(estimate.covariance.reshape(6, 6)[0, 0], 0.01, atol=1e-6)
    assert_allclose(estimate.covariance.reshape(6, 6)[5, 5], (np.pi - 3.1) ** 2, atol=1e-6)  # across the jump at ±π
    assert len(found["/predicted_path"][0][1].poses) == 2
    assert found["/plan"][0][1].poses == []


def test_latch_states_are_recorded(tmp_path: Path) -> None:
    simulation = build(find_world("taxi"), np.random.default_rng(0))
    with BagWriter(tmp_path / "run.bag") as bag:
        robot = RunRecorder(bag).robot(simulation.robot)
        drive(robot, 0.1)
        assert robot.close_latch() is False
        assert robot.open_latch() is True
        assert robot.body == BODY
    states = [message for topic, _, message in messages(tmp_path / "run.bag") if topic == "/latch/state"]
    assert [list(state.position[:1]) for state in states] == [[0.0], [0.0]]


def test_a_log_is_recorded_with_its_estimates(tmp_path: Path) -> None:
    times = np.array([100.0, 101.0, 102.0, 103.0])
    poses = np.column_stack([np.arange(4.0), np.zeros(4), np.zeros(4)])
    scans = tuple(Scan(t, np.full(5, 2.0), -1.0, 0.5, 0.1, 10.0) for t in (101.0, 102.0))
    none = (None, None)
    log = LidarLog(scans, none, Trajectory(times, poses), Pose(0.1), ())
    with BagWriter(tmp_path / "run") as bag:
        recording = LogRecorder(bag, log)
        recording.write_scan(0, Pose(5.0), np.empty((0, 3)))
        recording.write_scan(1, Pose(6.0), np.zeros((3, 3)))
    again = read_bag(tmp_path / "run")
    assert [scan.time for scan in again.scans] == [101.0, 102.0]
    assert_array_equal(again.odometry.times, times)
    assert again.lidar == Pose(0.1)
    counts = Counter(topic for topic, _, _ in messages(tmp_path / "run"))
    assert (counts["/particlecloud"], counts["/tf"]) == (1, 6)


# ---- other readers


def require_rosbag() -> None:
    if shutil.which("rosbag") is None:
        if os.environ.get("CI") == "true":
            pytest.fail("rosbag is not installed")
        pytest.skip("rosbag is not installed: apt install python3-rosbag")


def test_debians_rosbag_reads_our_bags(tmp_path: Path) -> None:
    require_rosbag()
    path = tmp_path / "run.bag"
    measured = record_drive(path)
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    shown = subprocess.run(
        ["rosbag", "info", "--yaml", str(path)], capture_output=True, text=True, timeout=60, check=True, env=environment
    )
    info = yaml.safe_load(shown.stdout)
    assert (info["indexed"], info["duration"], info["messages"]) == (True, pytest.approx(2.0), count(measured))
    topics = {entry["topic"]: (entry["type"], entry["messages"]) for entry in info["topics"]}
    assert topics["/scan"] == ("sensor_msgs/LaserScan", sum(isinstance(item, Scan) for item in measured))
    assert topics["/tf"][0] == topics["/tf_static"][0] == "tf2_msgs/TFMessage"
    sums = {entry["type"]: entry["md5"] for entry in info["types"]}
    assert sums["tf2_msgs/TFMessage"] == "94810edda583a504dfda3829e70d7eec"  # as in ROS
    assert sums["sensor_msgs/LaserScan"] == "90c7ef2dc6895d81024acba2ac42f369"


def test_rosbag_reindex_keeps_a_complete_bag_intact(tmp_path: Path) -> None:
    """It rewrites the first record in place, which therefore must have the length that rosbag gives it."""
    require_rosbag()
    path = tmp_path / "run.bag"
    measured = record_drive(path)
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    subprocess.run(["rosbag", "reindex", str(path)], capture_output=True, timeout=60, check=True, env=environment)
    assert (tmp_path / "run.orig.bag").exists()
    assert sum(1 for _ in messages(path)) == count(measured)


def test_the_mcap_library_reads_our_bags(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    measured = record_drive(path)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        found = [message for *_, message in reader.iter_decoded_messages(topics=["/scan"])]
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == count(measured)
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}  # as Foxglove expects
    assert all(schema.data for schema in summary.schemas.values())
    scans = [item for item in measured if isinstance(item, Scan)]
    assert len(found) == len(scans)
    for message, scan in zip(found, scans, strict=True):
        assert message.header.frame_id == "laser"
        assert_array_equal(np.array(message.ranges, np.float32), scan.ranges.astype(np.float32))


def test_the_folder_of_a_ros2_bag_has_rosbag2s_layout(tmp_path: Path) -> None:
    measured = record_drive(tmp_path / "run")
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["metadata.yaml", "run.db3"]
    metadata = yaml.safe_load((tmp_path / "run" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (metadata["storage_identifier"], metadata["message_count"]) == ("sqlite3", count(measured))
    assert metadata["relative_file_paths"] == ["run.db3"]


# ---- reproducibility


@pytest.mark.parametrize("name", ["run.bag", "run.mcap"])
def test_equal_runs_give_equal_bytes(tmp_path: Path, name: str) -> None:
    for folder in ("one", "two"):
        record_drive(tmp_path / folder / name)
    assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


# ---- interrupted recordings and existing files


@pytest.mark.parametrize("name", NAMES)
def test_an_interrupted_recording_is_a_complete_bag(tmp_path: Path, name: str) -> None:
    simulation = build(find_world("taxi"), np.random.default_rng(0))
    path = tmp_path / name
    with pytest.raises(KeyboardInterrupt), BagWriter(path) as bag:  # noqa: PT012
        drive(RunRecorder(bag).robot(simulation.robot), 1.0)
        assert not path.exists()
        assert path.with_name(path.name + ".active").exists()
        raise KeyboardInterrupt
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    assert [scan.time for scan in read_bag(path).scans] == [number / 10 for number in range(10)]


@pytest.mark.parametrize("name", NAMES)
def test_a_killed_recording_keeps_the_suffix_of_unfinished_bags(tmp_path: Path, name: str) -> None:
    program = (
        "import sys, time; from wherry.ros.bags.writer import BagWriter; from wherry.ros import messages as ros; "
        "from wherry.ros.topics import Topic; bag = BagWriter(sys.argv[1]); "
        "bag.write(Topic('/said', ros.String), ros.String('x'), 0.0); print('ready', flush=True); time.sleep(60)"
    )
    path = tmp_path / name
    with subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGKILL)
    assert not path.exists()
    unfinished = path.with_name(path.name + ".active")
    assert unfinished.exists()
    hint = {"run.bag": "rosbag reindex", "run.mcap": "mcap recover", "run": "ros2 bag reindex"}[name]
    with pytest.raises(InputError, match=f"cut off; .*{hint}"):
        read_bag(unfinished)
    with pytest.raises(InputError, match="cut off"):
        BagWriter(path)


def kill_while_recording(path: Path) -> Path:
    """Kill a process that has recorded 3.9 s of driving; return the path of the unfinished bag."""
    program = (
        "import sys; import numpy as np; from test_recording import drive; "
        "from wherry.floorplan.world_files import find_world; "
        "from wherry.ros.bags.run_recorder import RunRecorder; from wherry.ros.bags.writer import BagWriter; "
        "from wherry.simulation import build; "
        "robot = RunRecorder(BagWriter(sys.argv[1])).robot(build(find_world('taxi'), np.random.default_rng(0)).robot); "
        "drive(robot, 3.9); print('ready', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", program, str(path)]
    pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "cwd": Path(__file__).parent}
    with subprocess.Popen(command, **pipes) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        process.kill()
    return path.with_name(path.name + ".active")


def check_recovered(times: list[float]) -> None:
    """Check that all scans are there but those of the last second."""
    assert times == [number / 10 for number in range(len(times))]
    assert len(times) >= 29


def test_rosbag_reindex_recovers_a_killed_recording(tmp_path: Path) -> None:
    require_rosbag()
    unfinished = kill_while_recording(tmp_path / "run.bag")
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    subprocess.run(["rosbag", "reindex", str(unfinished)], capture_output=True, timeout=60, check=True, env=environment)
    unfinished.rename(tmp_path / "run.bag")
    check_recovered([scan.time for scan in read_bag(tmp_path / "run.bag").scans])


def test_mcap_reads_a_killed_recording(tmp_path: Path) -> None:
    file = kill_while_recording(tmp_path / "run.mcap") / "run" / "run.mcap"
    times = []
    with file.open("rb") as stream, pytest.raises(EndOfFile):  # noqa: PT012 - the messages before the error count
        for _, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
            if channel.topic == "/scan":
                times.append(message.log_time / 1e9)
    check_recovered(times)


def test_the_sqlite_file_of_a_killed_recording_is_read_directly(tmp_path: Path) -> None:
    file = kill_while_recording(tmp_path / "run") / "run" / "run.db3"
    check_recovered([scan.time for scan in read_bag(file).scans])


@pytest.mark.parametrize("name", NAMES)
def test_existing_files_are_not_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("thesis")
    with pytest.raises(InputError, match="exists already"):
        BagWriter(tmp_path / name)
    assert (tmp_path / name).read_text() == "thesis"


@pytest.mark.parametrize("name", ["run.txt", "run.db3", "run.bag.gz"])
def test_a_suffix_that_is_not_of_a_bag_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"\.bag \(ROS 1\), \.mcap"):
        BagWriter(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_parent_folder_that_is_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        BagWriter(tmp_path / "file" / "run.bag")


def test_a_closed_bag_accepts_no_messages(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "run.bag")
    bag.close()
    bag.close()
    with pytest.raises(ValueError, match="closed"):
        bag.write(TOPICS.latch_state, ros.JointState(), 0.0)


def test_a_full_disk_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with BagWriter(tmp_path / "run.bag") as bag:
        monkeypatch.setattr(bag._bag, "write", full)
        with pytest.raises(InputError, match=r"run\.bag\.active.*No space left"):
            bag.write(TOPICS.cmd_vel, ros.Twist(), 0.0)


def test_without_rosbags_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.partition(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "rosbags", None)
    for name in NAMES:
        with pytest.raises(InputError, match=r"pip install 'wherry\[bags\]'"):
            BagWriter(tmp_path / name)
    (tmp_path / "some.bag").write_bytes(b"")
    with pytest.raises(InputError, match=r"pip install 'wherry\[bags\]'"):
        read_bag(tmp_path / "some.bag")


@pytest.mark.parametrize("name", NAMES)
def test_threads_may_write_concurrently(tmp_path: Path, name: str) -> None:
    with BagWriter(tmp_path / name) as bag, ThreadPoolExecutor(4) as pool:
        for worker in range(4):
            topic = Topic(f"/t{worker}", ros.String)
            for number in range(50):
                pool.submit(bag.write, topic, ros.String(str(number)), time.monotonic())
    assert Counter(topic for topic, _, _ in messages(tmp_path / name)) == {f"/t{worker}": 50 for worker in range(4)}


@pytest.mark.parametrize("name", ["run#1", "50%41", "why?"])
def test_a_folder_with_a_name_that_sqlite_takes_for_another_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="has a #, \\? or % in it"):
        BagWriter(tmp_path / name)
    assert not list(tmp_path.iterdir())


# ---- recorded transports


class LoopbackTransport:
    """A transport that receives its own messages, as rospy does."""

    ros_version = 1

    def __init__(self) -> None:
        self.callbacks: dict[str, list[Any]] = {}
        self.advertised: list[str] = []
        self.is_closed = False
        self.has_sim_time = False

    def __enter__(self) -> LoopbackTransport:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def advertise(self, topic: Topic[Any]) -> None:
        self.advertised.append(topic.name)

    def publish(self, topic: Topic[Any], message: Any) -> None:
        for callback in self.callbacks.get(topic.name, []):
            callback(message)

    def subscribe(self, topic: Topic[Any], callback: Any) -> None:
        self.callbacks.setdefault(topic.name, []).append(callback)

    def count_publishers(self, topic: Topic[Any]) -> int:
        return 3

    def count_subscribers(self, topic: Topic[Any]) -> int:
        return 4

    def is_connected(self) -> bool:
        return True

    def announce_sim_time(self) -> None:
        self.has_sim_time = True

    def publish_robot_description(self, topic: Topic[Any], urdf: str) -> None:
        self.publish(topic, ros.String(urdf))

    def close(self) -> None:
        self.is_closed = True


def test_messages_of_a_transport_are_recorded_once_at_times_of_the_robots_clock(tmp_path: Path) -> None:
    inner, received = LoopbackTransport(), []
    with BagWriter(tmp_path / "run.bag") as bag, RecordedTransport(inner, bag, load_names()) as transport:
        transport.subscribe(TOPICS.scan, received.append)
        transport.subscribe(TOPICS.odom, received.append)
        transport.subscribe(TOPICS.tf_static, received.append)
        inner.publish(TOPICS.tf_static, ros.TFMessage())  # latched: it arrives before the clock is known
        inner.publish(TOPICS.odom, ros.Odometry(encode_header(1e9, "odom")))
        inner.publish(TOPICS.tf, ros.TFMessage())  # only the recording subscribes to it
        transport.publish(TOPICS.tf, ros.TFMessage())  # received back
        transport.publish(TOPICS.plan, ros.Path())  # not received back
        inner.publish(TOPICS.scan, ros.LaserScan(encode_header(1e9 + 0.5, "laser")))
        transport.publish(TOPICS.cmd_vel, ros.Twist())
        transport.publish(TOPICS.cmd_vel_stamped, ros.TwistStamped())  # another type on the same topic
        inner.publish(TOPICS.odom, ros.Odometry(encode_header(1e9 - 7.0, "odom")))  # the clock jumps back
        transport.stop_recording()
    inner.publish(TOPICS.scan, ros.LaserScan(encode_header(1e9 + 9.0, "laser")))  # received after recording has stopped
    assert inner.is_closed
    assert [type(message) for message in received] == [
        ros.TFMessage,
        ros.Odometry,
        ros.LaserScan,
        ros.Odometry,
        ros.LaserScan,
    ]
    found = [(topic, stamp / 1e9 - 1e9) for topic, stamp, _ in messages(tmp_path / "run.bag")]
    first = {"/tf_static": 1, "/odom": 1, "/tf": 2, "/plan": 1}
    assert Counter(topic for topic, time in found if time == 0.0) == first
    assert Counter(topic for topic, time in found if time == 0.5) == {"/scan": 1, "/cmd_vel": 2, "/odom": 1}


def test_a_message_with_an_impossible_stamp_is_recorded_and_does_not_set_the_clock(tmp_path: Path) -> None:
    inner, received = LoopbackTransport(), []
    broken = ros.Odometry(ros.Header(ros.Time(-7, 5), "odom"))
    with BagWriter(tmp_path / "run.mcap") as bag, RecordedTransport(inner, bag, load_names()) as transport:
        transport.subscribe(TOPICS.odom, received.append)
        inner.publish(TOPICS.odom, broken)
        inner.publish(TOPICS.odom, ros.Odometry(encode_header(3.0, "odom")))
        inner.publish(TOPICS.odom, broken)
    assert len(received) == 3
    assert [stamp / 1e9 for _, stamp, _ in messages(tmp_path / "run.mcap")] == [3.0, 3.0, 3.0]


def test_a_recorded_transport_delegates_to_the_transport_that_it_wraps(tmp_path: Path) -> None:
    inner = LoopbackTransport()
    with BagWriter(tmp_path / "run.bag") as bag:
        transport = RecordedTransport(inner, bag, load_names())
        transport.advertise(TOPICS.plan)
        answers = (
            transport.ros_version,
            transport.count_publishers(TOPICS.scan),
            transport.count_subscribers(TOPICS.scan),
        )
        assert answers == (1, 3, 4)
        assert transport.is_connected()
        transport.announce_sim_time()
        transport.publish_robot_description(TOPICS.robot_description, "<robot/>")
        assert inner.has_sim_time
        assert inner.advertised == ["/plan"]


def test_a_full_disk_stops_publishing_but_not_callbacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    inner, received = LoopbackTransport(), []
    with BagWriter(tmp_path / "run.bag") as bag:
        transport = RecordedTransport(inner, bag, load_names())
        transport.subscribe(TOPICS.odom, received.append)
        monkeypatch.setattr(bag._bag, "write", full)
        inner.publish(TOPICS.odom, ros.Odometry())
        assert len(received) == 1
        with pytest.raises(InputError, match="No space left"):
            transport.publish(TOPICS.plan, ros.Path())
