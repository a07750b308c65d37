"""Exported worlds compared with the simulator's compiled model, and checked by Gazebo's own parser."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from wherry.errors import InputError
from wherry.floorplan.generation import place_boxes
from wherry.floorplan.plan import Cell
from wherry.floorplan.world_files import built_in_worlds, find_world, format_world
from wherry.gazebo.export import MARKER_FILE, GazeboExportSettings, bridge_config, export_files, export_world
from wherry.gazebo.robot_model import TREAD_WIDTH
from wherry.gazebo.sdf import FORTRESS, GENERATIONS
from wherry.simulation import build
from wherry.simulation.drive import TRACK_WIDTH, WHEEL_RADIUS
from wherry.simulation.lidar import LidarSpecification
from wherry.simulation.model import BODY

WORLD_FILES = ("world.sdf", "classic.world")
SHAPES = mujoco.mjtGeom
KINDS = {int(SHAPES.mjGEOM_BOX): "box", int(SHAPES.mjGEOM_CYLINDER): "cylinder", int(SHAPES.mjGEOM_SPHERE): "sphere"}
EXACT = {"rtol": 0, "atol": 1e-9}


def parsed(text: str) -> ET.Element:
    return ET.fromstring(text)  # noqa: S314 - this package's own file


@pytest.fixture(scope="module", params=["rooms", "taxi10"])
def exported(request: pytest.FixtureRequest) -> tuple[dict[str, ET.Element], mujoco.MjModel]:
    """A world's files, and the simulator's model of it."""
    plan = find_world(request.param)
    plan = place_boxes(plan, 3, np.random.default_rng(2))
    files = export_files(plan, np.random.default_rng(5), FORTRESS)
    worlds = {name: parsed(files[name]).find("world") for name in WORLD_FILES}
    return worlds, build(plan, np.random.default_rng(5)).physics.model


@pytest.fixture(params=WORLD_FILES)
def world(request: pytest.FixtureRequest, exported: tuple[dict[str, ET.Element], Any]) -> ET.Element:
    return exported[0][request.param]


@pytest.fixture
def model(exported: tuple[Any, mujoco.MjModel]) -> mujoco.MjModel:
    return exported[1]


def numbers(element: ET.Element | None, default: str = "0 0 0 0 0 0") -> np.ndarray:
    return np.array([float(word) for word in (default if element is None else element.text).split()])


def sizes(shape: ET.Element) -> tuple[str, np.ndarray]:
    """A shape's kind, and its half lengths as in MuJoCo, m."""
    geometry = shape.find("geometry")[0]
    if geometry.tag == "box":
        return "box", numbers(geometry.find("size")) / 2
    radius = float(geometry.findtext("radius"))
    if geometry.tag == "sphere":
        return "sphere", np.array([radius])
    return "cylinder", np.array([radius, float(geometry.findtext("length")) / 2])


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix [3, 3] about fixed x, then y, then z, rad, as SDF defines it."""
    quaternion, matrix = np.empty(4), np.empty(9)
    mujoco.mju_euler2Quat(quaternion, [roll, pitch, yaw], "XYZ")
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def matrix_of(quaternion: np.ndarray) -> np.ndarray:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, np.array(quaternion, dtype=float))
    return matrix.reshape(3, 3)


def friction(shape: ET.Element) -> float:
    """A collision's coefficient; 1 is SDF's own default."""
    ode = shape.find("surface/friction/ode")
    if ode is None:
        return 1.0
    assert ode.findtext("mu") == ode.findtext("mu2")
    return float(ode.findtext("mu"))


def test_walls_obstacles_and_paint_match_the_simulator(world: ET.Element, model: mujoco.MjModel) -> None:
    link = world.find("model[@name='building']/link")
    shapes = {shape.get("name"): shape for shape in link.findall("collision")}
    fixed = [model.geom(index).name for index in range(model.ngeom) if model.geom_bodyid[index] == 0]
    assert {name.replace(" ", "_") for name in fixed if name.startswith(("wall", "obstacle"))} == set(shapes)
    visuals = {shape.get("name"): shape for shape in link.findall("visual")}
    for name in fixed:
        if name == "floor":
            continue
        visual, geom = visuals[name.replace(" ", "_") + "_visual"], model.geom(name)
        for shape in (visual, shapes.get(name.replace(" ", "_"), visual)):
            assert_allclose(numbers(shape.find("pose")), [*geom.pos, 0, 0, 0], **EXACT)
            assert_allclose(sizes(shape)[1], geom.size, **EXACT)
        assert_allclose(numbers(visual.find("material/diffuse")), geom.rgba, atol=1e-6)
    assert world.findtext("model[@name='building']/static") == "true"


def test_floor_extends_beyond_the_building_at_height_zero(world: ET.Element, model: mujoco.MjModel) -> None:
    floor = world.find("model[@name='floor']")
    assert floor.findtext("static") == "true"
    pose, size = numbers(floor.find("pose")), numbers(floor.find(".//collision//size"))
    walls = [model.geom(index) for index in range(model.ngeom) if model.geom(index).name.startswith("wall ")]
    low = np.min([wall.pos[:2] - wall.size[:2] for wall in walls], axis=0)
    high = np.max([wall.pos[:2] + wall.size[:2] for wall in walls], axis=0)
    assert pose[2] == model.geom("floor").pos[2] == 0
    assert (pose[:2] - size / 2 < low).all()
    assert (pose[:2] + size / 2 > high).all()
    assert_allclose(numbers(world.find("gravity")), model.opt.gravity, **EXACT)


def test_boxes_match_the_simulator(world: ET.Element, model: mujoco.MjModel) -> None:
    found = [element for element in world.findall("model") if element.get("name").startswith("box_")]
    assert len(found) == 3
    for index, element in enumerate(found):
        body, geom = model.body(f"box {index}"), model.geom(f"box {index}")
        assert_allclose(numbers(element.find("pose")), [*body.pos, 0, 0, 0], **EXACT)
        link = element.find("link")
        for kind in ("collision", "visual"):
            shape, measures = sizes(link.find(kind))
            assert shape == KINDS[int(geom.type[0])]
            assert_allclose(measures, geom.size[:2], **EXACT)
        assert float(link.findtext("inertial/mass")) == body.mass[0]
        inertia = [float(link.findtext(f"inertial/inertia/{axis}")) for axis in ("ixx", "iyy", "izz")]
        assert_allclose(inertia, body.inertia, **EXACT)


def test_links_have_the_simulators_poses_and_inertias(world: ET.Element, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    robot = world.find("model[@name='wherry']")
    place = numbers(robot.find("pose"))
    names = {model.body(index).name for index in range(model.nbody)}
    links = {f"robot/{link.get('name')}": link for link in robot.findall("link")}
    assert set(links) == {name for name in names if name.startswith("robot/")} - {"robot/base_footprint"}
    for name, link in links.items():
        pose = numbers(link.find("pose"))
        assert_allclose(place[:3] + rotation(*place[3:]) @ pose[:3], data.body(name).xpos, atol=1e-9)
        assert_allclose(rotation(*place[3:]) @ rotation(*pose[3:]), data.body(name).xmat.reshape(3, 3), atol=1e-9)
        body = model.body(name)
        assert float(link.findtext("inertial/mass")) == body.mass[0]
        assert_allclose(numbers(link.find("inertial/pose"))[:3], body.ipos, **EXACT)
        moments = np.diag([float(link.findtext(f"inertial/inertia/{axis}")) for axis in ("ixx", "iyy", "izz")])
        axes = matrix_of(body.iquat)
        assert_allclose(axes @ np.diag(body.inertia) @ axes.T, moments, atol=1e-9)
    assert model.body("robot/base_footprint").mass[0] == 0


def test_collisions_of_the_robot_match_the_simulator(world: ET.Element, model: mujoco.MjModel) -> None:
    names = set()
    for link in world.findall("model[@name='wherry']/link"):
        for shape in link.findall("collision"):
            geom = model.geom(f"robot/{shape.get('name')}")
            names.add(geom.name)
            pose = numbers(shape.find("pose"))
            assert model.body(int(geom.bodyid[0])).name == f"robot/{link.get('name')}"
            assert_allclose(pose[:3], geom.pos, **EXACT)
            kind, measures = sizes(shape)
            if geom.type[0] == SHAPES.mjGEOM_ELLIPSOID:  # a wheel, which is a thin disc in Gazebo
                assert_allclose([measures[0]] * 2, geom.size[:2], **EXACT)
                assert measures[1] == TREAD_WIDTH / 2 < geom.size[2]
            else:
                assert kind == KINDS[int(geom.type[0])]
                assert_allclose(measures, geom.size[: len(measures)], **EXACT)
            assert_allclose(np.abs(rotation(*pose[3:])), np.abs(matrix_of(geom.quat)), atol=1e-9)
    touching = {
        geom.name for geom in map(model.geom, range(model.ngeom)) if geom.name.startswith("robot/") and geom.contype
    }
    assert names == touching


def test_wheels_clear_the_prongs(world: ET.Element) -> None:
    """With <self_collide>, links without a common joint collide in Gazebo, unlike in the simulator."""
    robot = world.find("model[@name='wherry']")
    assert robot.findtext("self_collide") == "true"
    for side, sign in (("left", 1), ("right", -1)):
        prong, wheel = (robot.find(f"link[@name='{side}_{part}']") for part in ("prong", "wheel"))
        outer = sign * numbers(prong.find("pose"))[1] + sizes(prong.find("collision"))[1][1]
        inner = sign * numbers(wheel.find("pose"))[1] - sizes(wheel.find("collision"))[1][1]
        assert inner - outer > 0.005


def test_visuals_of_the_robot_match_the_simulator(world: ET.Element, model: mujoco.MjModel) -> None:
    shapes = [shape for link in world.findall("model[@name='wherry']/link") for shape in link.findall("visual")]
    assert len(shapes) == sum(
        model.geom(i).name.endswith("_visual") for i in range(model.ngeom) if "robot/" in model.geom(i).name
    )
    for shape in shapes:
        geom = model.geom(f"robot/{shape.get('name')}")
        kind, measures = sizes(shape)
        assert kind == KINDS[int(geom.type[0])]
        assert_allclose(measures, geom.size[: len(measures)], **EXACT)
        assert_allclose(numbers(shape.find("material/diffuse")), geom.rgba, atol=1e-6)


def test_friction_of_every_pair_with_the_floor_matches_the_simulator(world: ET.Element, model: mujoco.MjModel) -> None:
    """Gazebo uses the smaller coefficient of a pair, MuJoCo that of the higher priority, or else the larger."""
    gazebo = {"floor": friction(world.find("model[@name='floor']//collision"))}
    gazebo["box 0"] = friction(world.find("model[@name='box_0']//collision"))
    for name in ("left_wheel", "right_wheel", "caster"):
        gazebo[f"robot/{name}"] = friction(world.find(f"model[@name='wherry']//collision[@name='{name}']"))
    for name in gazebo.keys() - {"floor"}:
        geom, floor = model.geom(name), model.geom("floor")
        used = geom.friction[0] if geom.priority > floor.priority else max(geom.friction[0], floor.friction[0])
        if geom.condim[0] == 1 and geom.priority > floor.priority:
            used = 0.0
        assert min(gazebo[name], gazebo["floor"]) == used, name


def test_joints_have_the_simulators_axes_and_torques(world: ET.Element, model: mujoco.MjModel) -> None:
    robot = world.find("model[@name='wherry']")
    joints = {joint.get("name"): joint for joint in robot.findall("joint")}
    moving = {name for name, joint in joints.items() if joint.get("type") == "revolute"}
    assert moving == {"left_wheel_joint", "right_wheel_joint"}
    for side in ("left", "right"):
        joint, simulated = joints[f"{side}_wheel_joint"], model.joint(f"robot/{side}_wheel_joint")
        assert (joint.findtext("parent"), joint.findtext("child")) == ("base_link", f"{side}_wheel")
        assert_allclose(numbers(joint.find("axis/xyz")), simulated.axis, **EXACT)
        assert float(joint.findtext("axis/limit/effort")) == model.actuator(f"{side}_motor").forcerange[1]
        assert float(joint.findtext("axis/dynamics/damping")) == simulated.damping[0] == 0
    links = {link.get("name") for link in robot.findall("link")}
    assert {joint.findtext("child") for joint in joints.values()} == links - {"base_link"}
    assert robot.find("link").get("name") == "base_link"  # the first link is the canonical one


def test_lidar_matches_the_simulator(world: ET.Element) -> None:
    sensor = world.find("model[@name='wherry']/link[@name='laser']/sensor")
    lidar = LidarSpecification()
    scan = sensor.find(".//horizontal")
    samples, low, high = (float(scan.findtext(name)) for name in ("samples", "min_angle", "max_angle"))
    robot = build(find_world("small"), np.random.default_rng(0)).robot
    robot.receive()  # odometry comes first
    expected = robot.receive().angles
    assert samples == lidar.beams == len(expected)
    assert_allclose(np.linspace(low, high, int(samples)), expected, atol=1e-9)
    assert (float(sensor.findtext(".//range/min")), float(sensor.findtext(".//range/max"))) == (
        lidar.range_min,
        lidar.range_max,
    )
    assert float(sensor.findtext(".//noise/stddev")) == lidar.noise
    assert float(sensor.findtext("update_rate")) == lidar.rate


def test_lidar_does_not_see_its_own_housing(exported: tuple[dict[str, ET.Element], Any]) -> None:
    laser = exported[0]["world.sdf"].find("model[@name='wherry']/link[@name='laser']")
    mask = int(laser.findtext("sensor/lidar/visibility_mask"))
    assert not mask & int(laser.findtext("visual/visibility_flags"))
    assert mask & 1


def plugin(world: ET.Element, name: str) -> ET.Element:
    return next(element for element in world.iter("plugin") if name in element.get("filename"))


def test_drive_of_gazebo_sim_has_the_robots_parameters(exported: tuple[dict[str, ET.Element], Any]) -> None:
    drive = plugin(exported[0]["world.sdf"], "ignition-gazebo-diff-drive-system")
    assert drive.get("name") == "ignition::gazebo::systems::DiffDrive"
    wheels = {"wheel_separation": TRACK_WIDTH, "wheel_radius": WHEEL_RADIUS, "odom_publish_frequency": 20}
    limits = {
        "max_linear_velocity": BODY.max_linear,
        "max_angular_velocity": BODY.max_angular,
        "max_linear_acceleration": BODY.max_linear_acceleration,
        "max_angular_acceleration": BODY.max_angular_acceleration,
    }
    for name, value in (wheels | limits).items():
        assert float(drive.findtext(name)) == value
    for name, value in limits.items():
        assert float(drive.findtext(name.replace("max", "min"))) == -value
    names = {
        "topic": "/cmd_vel",
        "odom_topic": "/odom",
        "tf_topic": "/tf",
        "frame_id": "odom",
        "child_frame_id": "base_link",
    }
    assert {name: drive.findtext(name) for name in names} == names


def test_drive_of_classic_gazebo_has_the_robots_parameters(exported: tuple[dict[str, ET.Element], Any]) -> None:
    drive = plugin(exported[0]["classic.world"], "libgazebo_ros_diff_drive.so")
    assert float(drive.findtext("wheelSeparation")) == TRACK_WIDTH
    assert float(drive.findtext("wheelDiameter")) == 2 * WHEEL_RADIUS
    names = {
        "commandTopic": "/cmd_vel",
        "odometryTopic": "/odom",
        "odometryFrame": "odom",
        "robotBaseFrame": "base_link",
        "odometrySource": "encoder",
    }
    assert {name: drive.findtext(name) for name in names} == names
    laser = plugin(exported[0]["classic.world"], "libgazebo_ros_laser.so")
    assert (laser.findtext("topicName"), laser.findtext("frameName")) == ("/scan", "laser")


def test_each_box_has_a_joint_that_the_world_opens_at_first(exported: tuple[dict[str, ET.Element], Any]) -> None:
    world = exported[0]["world.sdf"]
    latches = [element for element in world.iter("plugin") if "detachable-joint" in element.get("filename")]
    assert [latch.findtext("child_model") for latch in latches] == ["box_0", "box_1", "box_2"]
    for latch in latches:
        box = world.find(f"model[@name='{latch.findtext('child_model')}']")
        assert box.find(f"link[@name='{latch.findtext('child_link')}']") is not None
        assert world.find(f"model[@name='wherry']/link[@name='{latch.findtext('parent_link')}']") is not None
        assert latch.findtext("initial_attach") == "false"
    openers = [element for element in world.findall("plugin") if element.find("input/match") is not None]
    for opener in openers:
        assert opener.find("output").get("topic") == latches[0].findtext("detach_topic")
        assert opener.find("input").get("topic") == f"/world/{world.get('name')}/clock"
        assert opener.find("input/match").get("field") == "sim.sec"
    assert [opener.findtext("input/match") for opener in openers] == ["0", "1"]


@pytest.mark.parametrize("generation", GENERATIONS)
def test_names_are_those_of_the_generation(generation: str) -> None:
    plan = place_boxes(find_world("small"), 2, np.random.default_rng(0))
    files = export_files(plan, np.random.default_rng(0), GENERATIONS[generation])
    text = files["world.sdf"] + files["bridge.yaml"]
    assert ("ignition" in text) == (generation == "fortress")
    assert ("gz-sim" in text) == (generation == "harmonic")


def test_bridge_has_exactly_gazebos_topics() -> None:
    plan = place_boxes(find_world("small"), 2, np.random.default_rng(0))
    entries = yaml.safe_load(bridge_config(plan, FORTRESS))
    world = parsed(export_files(plan, np.random.default_rng(0), FORTRESS)["world.sdf"])
    tags = ("topic", "odom_topic", "tf_topic", "attach_topic", "detach_topic", "output_topic")
    topics = {element.text for element in world.find(".//model[@name='wherry']").iter() if element.tag in tags}
    poses = {f"/model/{model}/pose" for model in models_with_pose(world)}
    triggers = {element.get("topic") for element in world.iter("input")}  # the clock, and removals of boxes
    assert {entry["gz_topic_name"] for entry in entries} == topics | poses | triggers
    assert "/world/small/clock" in triggers
    assert {entry["ros_topic_name"] for entry in entries} >= {
        "/scan",
        "/odom",
        "/cmd_vel",
        "/tf",
        "/clock",
        "/joint_states",
    }
    inwards = {entry["ros_topic_name"] for entry in entries if entry["direction"] == "ROS_TO_GZ"}
    latch = {f"/latch/{verb}/box_{box}" for verb in ("close", "take_in") for box in range(2)}
    assert inwards == {"/cmd_vel", "/latch/open", *latch}
    types = {(entry["ros_topic_name"], entry["ros_type_name"], entry["gz_type_name"]) for entry in entries}
    assert ("/model/box_1/pose", "geometry_msgs/msg/PoseStamped", "ignition.msgs.Pose") in types
    assert ("/latch/state/box_1", "std_msgs/msg/String", "ignition.msgs.StringMsg") in types
    assert ("/latch/take_in/box_1", "std_msgs/msg/Empty", "ignition.msgs.Empty") in types


def models_with_pose(world: ET.Element) -> set[str]:
    """Models that publish their own pose, and not their links'."""
    models = set()
    for model in world.iter("model"):
        for element in model.findall("plugin"):
            if "pose-publisher" in element.get("filename"):
                models.add(model.get("name"))
                assert element.findtext("publish_model_pose") == element.findtext("publish_nested_model_pose") == "true"
                assert element.findtext("publish_link_pose") == element.findtext("use_pose_vector_msg") == "false"
    return models


def test_delivered_boxes_are_moved_out_of_the_building(
    exported: tuple[dict[str, ET.Element], Any],
) -> None:
    world = exported[0]["world.sdf"]
    assert models_with_pose(world) == {"wherry", "box_0", "box_1", "box_2"}
    walls = [shape for shape in world.findall("model[@name='building']//collision") if "wall" in shape.get("name")]
    south = min(numbers(wall.find("pose"))[1] - sizes(wall)[1][1] for wall in walls)
    places = []
    for box in range(3):
        (conveyor,) = [
            element
            for element in world.findall("plugin")
            if element.find("input") is not None and element.find("input").get("topic") == f"/latch/take_in/box_{box}"
        ]
        service = conveyor.find("service")
        assert service.get("name") == f"/world/{world.get('name')}/set_pose"
        assert (service.get("reqType"), service.get("repType")) == ("ignition.msgs.Pose", "ignition.msgs.Boolean")
        name, x, y, z = re.fullmatch(
            r"name: '(\w+)', position: \{x: (.+), y: (.+), z: (.+)\}, orientation: \{w: 1\}", service.get("reqMsg")
        ).groups()
        assert name == f"box_{box}"
        assert float(z) == numbers(world.find(f"model[@name='{name}']/pose"))[2]  # on the floor
        places.append((float(x), float(y)))
    assert all(y + 2 * BODY.box_radius < south for _, y in places)
    assert all(math.dist(a, b) > 2 * BODY.box_radius for i, a in enumerate(places) for b in places[:i])


def test_each_frame_of_the_description_has_one_parent() -> None:
    files = export_files(find_world("taxi"), np.random.default_rng(0), FORTRESS)
    urdf = parsed(files["robot.urdf"])
    children = [joint.find("child").get("link") for joint in urdf.iter("joint")]
    assert "base_link" not in children
    assert len(children) == len(set(children)) == len(urdf.findall("link")) - 1
    footprint = next(joint for joint in urdf.iter("joint") if joint.find("child").get("link") == "base_footprint")
    assert float(footprint.find("origin").get("xyz").split()[2]) == -WHEEL_RADIUS


@pytest.mark.parametrize("name", WORLD_FILES)
def test_nothing_overlaps_at_first(name: str) -> None:
    """Robot and boxes are clear of walls and of each other, and boxes stand on the floor."""
    plan = place_boxes(find_world("rooms"), 4, np.random.default_rng(1))
    world = parsed(export_files(plan, np.random.default_rng(1), FORTRESS)[name]).find("world")
    robot = numbers(world.find("model[@name='wherry']/pose"))
    discs = [(robot[:2], BODY.radius)]
    for element in world.findall("model"):
        if element.get("name").startswith("box_"):
            pose, (_, measures) = numbers(element.find("pose")), sizes(element.find("link/collision"))
            assert pose[2] == measures[1]
            discs.append((pose[:2], measures[0]))
    for index, (place, radius) in enumerate(discs):
        for shape in world.findall("model[@name='building']//collision"):
            beyond = np.abs(numbers(shape.find("pose"))[:2] - place) - sizes(shape)[1][:2]
            assert np.hypot(*np.maximum(beyond, 0)) > radius
        for other, other_radius in discs[:index]:
            assert math.dist(place, other) > radius + other_radius


# ---- the folder


def test_same_seed_gives_same_files_and_an_export_is_overwritten(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    export_world(GazeboExportSettings("small", one, seed=1))
    export_world(GazeboExportSettings("small", two, seed=2))
    export_world(GazeboExportSettings("small", two, seed=1))
    first, second = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in (one, two))
    assert first.keys() >= {*WORLD_FILES, MARKER_FILE}
    assert first == second


def test_folder_with_other_files_is_refused_unless_forced(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("x")
    with pytest.raises(InputError, match="--force"):
        export_world(GazeboExportSettings("small", tmp_path))
    (tmp_path / MARKER_FILE).write_text("not an export")
    with pytest.raises(InputError, match="--force"):
        export_world(GazeboExportSettings("small", tmp_path))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["thesis.txt", MARKER_FILE]
    export_world(GazeboExportSettings("small", tmp_path, force=True))
    assert (tmp_path / "world.sdf").is_file()
    assert (tmp_path / "thesis.txt").read_text() == "x"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"world": "nowhere"}, "nowhere"),
        ({"world": "small", "generation": "edifice"}, "fortress, harmonic"),
        ({"world": "small", "boxes": -1}, "--boxes"),
    ],
)
def test_invalid_settings_are_named(tmp_path: Path, arguments: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        export_world(GazeboExportSettings(folder=tmp_path / "out", **arguments))
    assert not (tmp_path / "out").exists()


def test_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file"):
        export_world(GazeboExportSettings("small", tmp_path / "file"))


def test_world_name_is_made_valid_for_topics(tmp_path: Path) -> None:
    plan = find_world("small")
    path = tmp_path / "w.txt"
    path.write_text(format_world(plan).replace("name: small", "name: Büro 3, Mitte"))
    export_world(GazeboExportSettings(str(path), tmp_path / "out"))
    assert parsed((tmp_path / "out" / "world.sdf").read_text()).find("world").get("name") == "B_ro_3_Mitte"
    assert "/world/B_ro_3_Mitte/clock" in (tmp_path / "out" / "bridge.yaml").read_text()


# ---- Gazebo's own parser


def check(path: Path) -> subprocess.CompletedProcess[str]:
    if shutil.which("ign") is None:
        if os.environ.get("CI") == "true":
            pytest.fail("ign is not installed")
        pytest.skip(
            "ign is not installed: apt install ignition-tools libsdformat12-12 libsdformat-dev sdformat-sdf ruby"
        )
    return subprocess.run(["ign", "sdf", "-k", str(path)], capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("name", built_in_worlds())
def test_gazebos_parser_accepts_every_built_in_world(tmp_path: Path, name: str) -> None:
    export_world(GazeboExportSettings(name, tmp_path, generation="harmonic" if name == "taxi" else "fortress"))
    for file in WORLD_FILES:
        checked = check(tmp_path / file)
        assert (checked.returncode, checked.stdout.strip()) == (0, "Valid."), checked.stdout + checked.stderr


@pytest.mark.parametrize(
    ("good", "bad"),
    [
        ("<child>left_wheel</child>", "<child>nothing</child>"),
        ("<mass>7.0</mass>", "<mass>-7.0</mass>"),
        ('<model name="building">', '<model name="floor">'),
        ("</sdf>", ""),
    ],
)
def test_gazebos_parser_rejects_broken_worlds(tmp_path: Path, good: str, bad: str) -> None:
    export_world(GazeboExportSettings("small", tmp_path))
    text = (tmp_path / "world.sdf").read_text()
    assert good in text
    (tmp_path / "world.sdf").write_text(text.replace(good, bad))
    assert check(tmp_path / "world.sdf").returncode != 0


def test_warehouse_cells_are_painted(exported: tuple[dict[str, ET.Element], Any]) -> None:
    painted = exported[0]["world.sdf"].findall("model[@name='building']/link/visual")
    cells = {shape.get("name") for shape in painted if shape.get("name").startswith("warehouse")}
    assert cells
    for name in cells:
        _, x, y, _ = name.split("_")
        assert Cell(int(x), int(y)) in find_world("rooms").warehouse | find_world("taxi10").warehouse
