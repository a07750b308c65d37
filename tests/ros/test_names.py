"""Names of topics and frames, and bodies of robots, read from YAML files and options."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.ros import names as names_module
from wherry.ros.body_files import default_body_text, load_body
from wherry.ros.names import Topics, load_names
from wherry.simulation.model import BODY
from wherry.space.pose import Pose
from wherry_testing.invalid_files import assert_file_is_rejected


def test_the_defaults_are_the_conventions_of_ros() -> None:
    names = load_names()
    found = {entry.name: getattr(names.topics, entry.name).name for entry in fields(Topics)}
    for key in ("scan", "odom", "tf", "tf_static", "clock", "joint_states", "cmd_vel", "map", "amcl_pose", "plan"):
        assert found[key] == f"/{key}"
    assert (names.frames.map, names.frames.odom, names.frames.base_link) == ("map", "odom", "base_link")


def test_a_namespace_prefixes_relative_names_only() -> None:
    topics = load_names(namespace="/robot1/").topics
    assert topics.scan.name == "/robot1/scan"
    assert topics.latch_state.name == "/robot1/latch/state"
    assert topics.tf.name == "/tf"
    assert topics.clock.name == "/clock"


def test_a_frame_prefix_applies_to_every_frame_but_the_map() -> None:
    frames = load_names(frame_prefix="robot1/").frames
    assert frames.base_link == "robot1/base_link"
    assert frames.odom == "robot1/odom"
    assert frames.map == "map"


def test_remapped_names_are_resolved_like_others() -> None:
    topics = load_names(namespace="a", remappings=["scan:=front/scan", "cmd_vel:=/teleop"]).topics
    assert topics.scan.name == "/a/front/scan"
    assert topics.cmd_vel.name == topics.cmd_vel_stamped.name == "/teleop"


def test_options_take_precedence_over_the_file(tmp_path: Path) -> None:
    path = tmp_path / "names.yaml"
    path.write_text(
        "namespace: file\nframe_prefix: f/\ntopics: {scan: laser_scan, odom: /wheels}\n"
        "frames: {laser: lidar_link}\nrates: {clock: 50}\n"
    )
    names = load_names(path, namespace="option", remappings=["scan:=other"])
    assert names.topics.scan.name == "/option/other"
    assert names.topics.odom.name == "/wheels"
    assert names.frames.laser == "f/lidar_link"
    assert names.rates.clock == 50.0


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("topics: {scam: x}", "topics.scam"),
        ("topic: {scan: x}", "topic"),
        ("topics: {scan: 'with space'}", "topics.scan"),
        ("topics: {scan: 1}", "topics.scan"),
        ("topics: [scan]", "topics"),
        ("frames: {laser: ''}", "frames.laser"),
        ("rates: {clock: 0}", "rates.clock"),
        ("rates: {clock: .nan}", "rates.clock"),
        ("rates: {clock: fast}", "rates.clock"),
        ("namespace: '9lives'", "namespace"),
        ("namespace: 7", "namespace"),
        ("- scan", ""),
        ("frame_prefix: 'a b'", "frame_prefix"),
        ("a: [", "line 1"),
    ],
)
def test_invalid_files_are_refused(text: str, field: str, tmp_path: Path) -> None:
    assert_file_is_rejected(load_names, tmp_path / "names.yaml", text, field)


def test_the_example_of_the_documentation_is_valid(tmp_path: Path) -> None:
    assert names_module.__doc__ is not None
    path = tmp_path / "names.yaml"
    path.write_text(names_module.__doc__.partition("\n\n")[2])
    names = load_names(path)
    assert names.topics.scan.name == "/robot1/front/scan"
    assert names.frames.laser == "robot1/lidar_link"
    assert names.rates.diagnostics == 2.0


@pytest.mark.parametrize("remapping", ["scan", "scam:=x", "scan:=", "scan:=a b"])
def test_invalid_remappings_are_refused(remapping: str) -> None:
    with pytest.raises(InputError, match="--remap"):
        load_names(remappings=[remapping])


def test_the_default_body_is_that_of_the_simulator() -> None:
    assert load_body().body(BODY.lidar) == BODY


def test_a_body_file_may_give_the_pose_of_the_lidar(tmp_path: Path) -> None:
    path = tmp_path / "body.yaml"
    path.write_text(default_body_text() + "lidar: {x: 0.1, y: 0, theta: 3}\n")
    assert load_body(path).body(Pose()).lidar == Pose(0.1, 0.0, 3.0)


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("radius: 0.20 ", "radius: -1 ", "radius"),
        ("radius: 0.20 ", "radius: .inf ", "radius"),
        ("radius: 0.20 ", "radius: yes ", "radius"),
        ("box_radius: 0.10 ", "box_radius: 0.3 ", "box_radius"),
        ("max_linear: 0.6", "", "max_linear"),
        ("max_linear: 0.6", "max_linear: 0.6\nmax_lienar: 0.6", "max_lienar"),
        ("max_linear: 0.6", "max_linear: 0.6\nlidar: {x: 1, y: 0}", "lidar.theta"),
    ],
)
def test_invalid_bodies_are_refused(old: str, new: str, field: str, tmp_path: Path) -> None:
    assert old in default_body_text()
    text = default_body_text().replace(old, new, 1)
    assert_file_is_rejected(load_body, tmp_path / "body.yaml", text, field)
