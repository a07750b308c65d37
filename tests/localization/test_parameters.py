"""Parameter files of nav2 and ROS 1 are read unchanged, and their errors name the key."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.localization.parameter_files import load_parameters
from wherry.localization.parameters import AmclParameters
from wherry.localization.sensor import valid_beams
from wherry.robot import Scan
from wherry.space.pose import Pose

NAV2 = """
amcl:
  ros__parameters:
    use_sim_time: True
    alpha1: 0.3
    base_frame_id: "base_footprint"
    beam_skip_distance: 0.5
    do_beamskip: true
    initial_pose: {x: 1.0, y: 2, z: 0.0, yaw: 0.5}
    laser_max_range: 20.0
    laser_model_type: "likelihood_field_prob"
    max_beams: 90
    max_particles: 3000
    pf_err: 0.02
    robot_model_type: "nav2_amcl::OmniMotionModel"
    z_hit: 0.6
    refine: false
controller_server:
  ros__parameters:
    controller_frequency: 20.0
"""
ROS1 = """
odom_model_type: diff
odom_alpha1: 0.1
laser_z_hit: 0.9
initial_pose_a: 1.5
initial_cov_xx: 0.01
min_particles: 50
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "amcl.yaml"
    path.write_text(text)
    return path


def test_file_of_nav2(tmp_path: Path) -> None:
    loaded = load_parameters(write(tmp_path, NAV2))
    assert loaded.unknown == ()
    assert loaded.parameters == AmclParameters(
        alpha1=0.3,
        beam_skip_distance=0.5,
        initial_pose=Pose(1.0, 2.0, 0.5),
        set_initial_pose=True,
        laser_max_range=20.0,
        laser_model_type="likelihood_field_prob",
        max_beams=90,
        max_particles=3000,
        pf_err=0.02,
        robot_model_type="omnidirectional",
        z_hit=0.6,
        refine=False,
    )


def test_parameters_below_a_namespace(tmp_path: Path) -> None:
    text = "robot1:\n" + "".join(f"  {line}\n" for line in NAV2.strip().splitlines())
    assert load_parameters(write(tmp_path, text)).parameters.alpha1 == 0.3


def test_names_and_defaults_of_ros_1(tmp_path: Path) -> None:
    parameters = load_parameters(write(tmp_path, ROS1)).parameters
    assert parameters.alpha1 == 0.1
    assert parameters.z_hit == 0.9
    assert parameters.z_rand == 0.05  # ROS 1's default, not nav2's
    assert parameters.update_min_a == pytest.approx(math.pi / 6)
    assert parameters.initial_pose.theta == 1.5
    assert parameters.initial_covariance[0] == 0.01
    assert parameters.robot_model_type == "differential"
    assert (parameters.min_particles, parameters.max_particles) == (50, 5000)


def test_likelihood_field_without_beam_skipping(tmp_path: Path) -> None:
    loaded = load_parameters(write(tmp_path, NAV2.replace("do_beamskip: true", "do_beamskip: false")))
    assert loaded.parameters.laser_model_type == "likelihood_field"


def test_unknown_keys_are_reported(tmp_path: Path) -> None:
    assert load_parameters(write(tmp_path, "amcl: {alpha1: 0.1, z_hitt: 0.5, foo: 1}")).unknown == ("z_hitt", "foo")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("amcl: {alpha1: high}", "alpha1: 'high' is invalid: input should be a valid number"),
        ("amcl: {alpha1: .nan}", "alpha1: nan is invalid: input should be a finite number"),
        ("amcl: {alpha1: -0.1}", "alpha1: -0.1 must not be negative"),
        ("amcl: {max_beams: 30.5}", "max_beams: 30.5 is invalid: input should be a valid integer"),
        ("amcl: {max_beams: true}", "max_beams: True is invalid: input should be a valid integer"),
        ("amcl: {z_rand: 0.0}", "z_rand: 0.0 must be positive"),
        ("amcl: {min_particles: 10, max_particles: 5}", "max_particles: 5 is below min_particles"),
        ("amcl: {laser_model_type: magic}", "laser_model_type: 'magic' is none of"),
        ("amcl: {initial_pose: 3}", "initial_pose: 3 is invalid: input should be a valid dictionary"),
        ("amcl: {initial_pose: {x: .inf}}", "initial_pose.x: inf is invalid: input should be a finite number"),
        ("amcl: {alpha1: 0.1, do_beamskip: maybe}", "do_beamskip: 'maybe' is invalid: input should be a valid boolean"),
        ("amcl: [1, 2", "line 1: is not YAML"),
        ("- 1", "is not a mapping of fields to values"),
        ("controller: {speed: 1}", "has no parameters of amcl"),
        ("", "has no parameters of amcl"),
        ("amcl: {alpha1: true}", "alpha1: True is invalid: input should be a valid number"),
        ("amcl: {alpha1: }", "alpha1: None is invalid: input should be a valid number"),
        ("odom_alpha1: high", "odom_alpha1: 'high' is invalid: input should be a valid number"),
        ("amcl: {laser_model_type: 3}", "laser_model_type: 3 is invalid: input should be a valid string"),
    ],
)
def test_invalid_files_are_rejected(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(InputError) as caught:
        load_parameters(write(tmp_path, text))
    assert named in str(caught.value)
    assert "amcl.yaml" in str(caught.value)


def test_missing_file_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_parameters(tmp_path / "nowhere.yaml")


def test_number_with_an_exponent_and_no_point_is_read_as_by_ros(tmp_path: Path) -> None:
    assert load_parameters(write(tmp_path, "amcl: {alpha1: 1e-1}")).parameters.alpha1 == 0.1


def test_quoted_numbers_and_exponents_are_numbers(tmp_path: Path) -> None:
    text = "amcl: {alpha1: 5e-2, max_particles: 1e+03, z_hit: '0.05', do_beamskip: 'false'}"
    parameters = load_parameters(write(tmp_path, text)).parameters
    assert (parameters.alpha1, parameters.max_particles, parameters.z_hit) == (0.05, 1000, 0.05)


def test_file_that_contains_itself_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nested too deeply"):
        load_parameters(write(tmp_path, "amcl: &a\n  amcl: *a\n"))


AMCL = "ros__parameters: {alpha1: 0.3}"


@pytest.mark.parametrize(
    "text",
    [
        f"/robot1/amcl:\n  {AMCL}\n",
        f"robot1:\n  amcl:\n    {AMCL}\n",
        f"robot1/amcl:\n  {AMCL}\n",
        f"fleet:\n  robot1:\n    amcl:\n      {AMCL}\n",
        f"/fleet:\n  robot1/amcl:\n    {AMCL}\n",
        f"/**/amcl:\n  {AMCL}\n",
        f"/*/amcl:\n  {AMCL}\n",
        f"/**:\n  {AMCL}\n",
        f"'**':\n  {AMCL}\n",
        f"/**:\n  amcl:\n    {AMCL}\n",
        "robot1: {amcl: {alpha1: 0.3}}\n",
        "/robot1/amcl: {odom_alpha1: 0.3}\n",
        f"robot1:\n  amcl:\n    {AMCL}\nrobot2:\n  amcl:\n    {AMCL}\n",
    ],
)
def test_the_node_is_found_below_namespaces_and_wildcards(tmp_path: Path, text: str) -> None:
    assert load_parameters(write(tmp_path, text)).parameters.alpha1 == 0.3


def test_parameters_of_all_nodes_are_merged_with_those_of_amcl(tmp_path: Path) -> None:
    text = (
        "/**:\n  ros__parameters: {alpha1: 0.3, z_hit: 0.7, footprint: 2}\n"
        "amcl:\n  ros__parameters: {alpha1: 0.4}\n"
        "robot2:\n  /**:\n    ros__parameters: {z_hit: 0.9}\n"
    )
    loaded = load_parameters(write(tmp_path, text))
    assert (loaded.parameters.alpha1, loaded.parameters.z_hit) == (0.4, 0.7)
    assert loaded.unknown == ()  # another node's parameters below the wildcard are not misspelt ones of amcl
    assert loaded.notes == ()


def test_sections_with_wildcards_alone_are_merged(tmp_path: Path) -> None:
    text = "/**:\n  ros__parameters: {z_hit: 0.7}\n/**/amcl:\n  ros__parameters: {alpha1: 0.4}\n"
    parameters = load_parameters(write(tmp_path, text)).parameters
    assert (parameters.alpha1, parameters.z_hit) == (0.4, 0.7)


def test_a_wildcard_after_the_node_overrides_it_as_in_ros_2_and_it_is_said(tmp_path: Path) -> None:
    text = "amcl:\n  ros__parameters: {alpha1: 0.4}\n/**:\n  ros__parameters: {alpha1: 0.3}\n"
    loaded = load_parameters(write(tmp_path, text))
    assert loaded.parameters.alpha1 == 0.3
    assert "alpha1 of /amcl is that of /**, which comes later in the file" in loaded.notes[0]


def test_several_nodes_with_different_parameters_are_refused_by_name(tmp_path: Path) -> None:
    text = "robot1: {amcl: {alpha1: 0.3}}\nrobot2: {amcl: {alpha1: 0.4}}\n"
    with pytest.raises(
        InputError, match="of several nodes, of which only one can be meant: /robot1/amcl, /robot2/amcl"
    ):
        load_parameters(write(tmp_path, text))


def test_a_file_of_other_nodes_names_them(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no parameters of amcl, only of /planner"):
        load_parameters(write(tmp_path, "planner:\n  ros__parameters: {tolerance: 0.5}\n"))


def test_parameters_with_and_without_ros_2_s_key_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="both with and without ros__parameters"):
        load_parameters(write(tmp_path, "amcl: {alpha1: 0.4}\n/amcl:\n  ros__parameters: {alpha2: 0.3}\n"))


@pytest.mark.parametrize("limit", ["-1", "-1.0", "0.0"])
def test_range_limits_that_are_not_positive_leave_the_scan_s_own(tmp_path: Path, limit: str) -> None:
    text = f"amcl: {{laser_max_range: {limit}, laser_min_range: {limit}, alpha1: 0.1}}"
    parameters = load_parameters(write(tmp_path, text)).parameters
    scan = Scan(0.0, np.array([0.05, 0.2, 7.9, 8.1]), 0.0, 0.1, 0.1, 8.0)
    assert valid_beams(scan, Pose(), parameters).ranges.tolist() == [0.2, 7.9]


def test_defaults_of_ros_1_hold_for_a_file_with_any_name_of_ros_1(tmp_path: Path) -> None:
    parameters = load_parameters(
        write(tmp_path, "amcl: {initial_pose_x: 3, beam_skip_error_threshold_: 0.4}")
    ).parameters
    assert (parameters.max_particles, parameters.laser_max_range) == (5000, -1.0)
    assert parameters.beam_skip_error_threshold == 0.4
    assert parameters.initial_pose.x == 3.0


def test_names_of_ros_1_in_a_file_of_ros_2_are_not_used_as_by_nav2_and_it_is_said(tmp_path: Path) -> None:
    loaded = load_parameters(write(tmp_path, "amcl:\n  ros__parameters: {kld_err: 0.02, alpha1: 0.1}\n"))
    assert (loaded.parameters.pf_err, loaded.parameters.max_particles) == (0.05, 2000)
    assert "names of ROS 1 (nav2's in brackets): kld_err (pf_err)." in loaded.notes[0]


def test_two_values_of_one_parameter_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"odom_alpha1: is .*, but alpha1, its name in nav2, is "):
        load_parameters(write(tmp_path, "amcl: {odom_alpha1: 0.3, alpha1: 0.2}"))


def test_initial_pose_with_dotted_names(tmp_path: Path) -> None:
    text = "amcl:\n  ros__parameters: {set_initial_pose: true, initial_pose.x: 1.5, initial_pose.yaw: 0.5}\n"
    loaded = load_parameters(write(tmp_path, text))
    assert loaded.parameters.initial_pose == Pose(1.5, 0.0, 0.5)
    assert loaded.notes == ()


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (
            "amcl: {alpha1: 0.1, scan_topic: front, base_frame_id: base}",
            "concern the ROS node: scan_topic, base_frame_id.",
        ),
        (
            "amcl: {alpha1: 0.1, initial_pose: {x: 1.0}}",
            "initial_pose is the start pose although set_initial_pose is not",
        ),
        ("amcl: {odom_model_type: diff}", "odom_model_type diff is computed as diff-corrected"),
        ("amcl: {do_beamskip: true}", "do_beamskip has no effect without laser_model_type likelihood_field_prob"),
    ],
)
def test_parameters_that_are_not_used_are_said(tmp_path: Path, text: str, note: str) -> None:
    notes = load_parameters(write(tmp_path, text)).notes
    assert any(note in one for one in notes)
    assert all(len(one.removeprefix(str(tmp_path))) < 300 for one in notes)
