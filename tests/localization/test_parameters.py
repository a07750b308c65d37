"""Parameter files of nav2 and ROS 1 are read unchanged, and their errors name the key."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.localization.parameter_files import load_parameters
from wherry.localization.parameters import AmclParameters
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


def test_file_that_contains_itself_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nested too deeply"):
        load_parameters(write(tmp_path, "amcl: &a\n  amcl: *a\n"))
