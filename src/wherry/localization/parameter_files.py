"""Parameter files of amcl in the YAML formats of nav2 and ROS 1."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ConfigDict, create_model

from wherry.documents import Document, Flag, Integer, Number, read_yaml, validate
from wherry.errors import InputError
from wherry.localization.parameter_sections import NodeParameters, node_parameters
from wherry.localization.parameters import AmclParameters
from wherry.space.pose import Pose

NODE = "amcl"  # name of the ROS node
MAX_LISTED = 6  # parameters that are named in a note
MAX_FILE_SIZE = 1_000_000  # bytes; a file may contain the parameters of all nodes of a robot

ROS1_NAMES = MappingProxyType(
    {f"odom_alpha{i}": f"alpha{i}" for i in range(1, 6)}
    | {
        f"laser_{name}": name
        for name in ("z_hit", "z_short", "z_max", "z_rand", "sigma_hit", "lambda_short", "max_beams")
    }
    | {
        "kld_err": "pf_err",
        "kld_z": "pf_z",
        "odom_model_type": "robot_model_type",
        "beam_skip_error_threshold_": "beam_skip_error_threshold",
    }
)
ROS1_DEFAULTS = MappingProxyType(
    {
        "min_particles": 100,
        "max_particles": 5000,
        "pf_err": 0.01,
        "update_min_d": 0.2,
        "update_min_a": math.pi / 6.0,
        "resample_interval": 2,
        "max_beams": 30,
        "laser_max_range": -1.0,
        "z_hit": 0.95,
        "z_short": 0.1,
        "z_rand": 0.05,
    }
)
MODEL_NAMES = MappingProxyType(
    {
        "diff": "differential",
        "diff-corrected": "differential",
        "omni": "omnidirectional",
        "omni-corrected": "omnidirectional",
        "nav2_amcl::DifferentialMotionModel": "differential",
        "nav2_amcl::OmniMotionModel": "omnidirectional",
    }
)
INITIAL_POSE = MappingProxyType({"initial_pose_x": 0, "initial_pose_y": 1, "initial_pose_a": 2})
INITIAL_COVARIANCE = MappingProxyType({"initial_cov_xx": 0, "initial_cov_yy": 1, "initial_cov_aa": 2})
NODE_PARAMETERS = frozenset(  # parameters of the ROS node, which are ignored since the filter has none of them
    [
        "always_reset_initial_pose",
        "base_frame_id",
        "bond_heartbeat_period",
        "diagnostic_updater",
        "allow_parameter_qos_overrides",
        "autostart_node",
        "bag_scan_period",
        "laser_check_interval",
        "tf_prefix",
        "first_map_only",
        "force_update_after_initialpose",
        "force_update_after_set_initialpose",
        "freespace_downsampling",
        "global_frame_id",
        "gui_publish_rate",
        "introspection_mode",
        "map_topic",
        "odom_frame_id",
        "random_seed",
        "restore_defaults",
        "save_pose_rate",
        "scan_topic",
        "service_introspection_mode",
        "start_type_description_service",
        "std_warn_level_enabled",
        "tf_broadcast",
        "transform_tolerance",
        "use_map_topic",
        "use_sim_time",
        "qos_overrides",
    ]
)


ROS1_NODE_PARAMETERS = frozenset(["gui_publish_rate", "restore_defaults", "use_map_topic"])  # of ROS 1 only
UNCORRECTED_MODELS = ("diff", "omni")  # ROS 1's odometry models that use variances as standard deviations


class InitialPose(Document):
    """nav2's ``initial_pose``: x m, y m, yaw rad, map frame; other keys are ignored."""

    model_config = ConfigDict(extra="ignore")

    x: Number = 0.0
    y: Number = 0.0
    yaw: Number = 0.0


_FILTER_TYPES: MappingProxyType[str, Any] = MappingProxyType(
    {
        field.name: {"float": Number, "int": Integer, "bool": Flag, "str": str}[str(field.type)]
        for field in fields(AmclParameters)
        if field.name not in ("initial_pose", "initial_covariance")
    }
)
_KEY_TYPES: MappingProxyType[str, Any] = MappingProxyType(
    {
        **_FILTER_TYPES,
        **{key: _FILTER_TYPES[name] for key, name in ROS1_NAMES.items()},
        **dict.fromkeys([*INITIAL_POSE, *INITIAL_COVARIANCE], Number),
        "initial_pose": InitialPose,
        "do_beamskip": Flag,
    }
)
_OPTIONAL_FIELDS: dict[str, Any] = {key: (kind, None) for key, kind in _KEY_TYPES.items()}
_AmclDocument: type[Document] = create_model("_AmclDocument", __base__=Document, **_OPTIONAL_FIELDS)


@dataclass(frozen=True, slots=True)
class LoadedParameters:
    """Content of a parameter file.

    Attributes:
        parameters: Parameters of the filter.
        unknown: Keys of the file that are no parameters of amcl, probably misspelt.
        notes: What was decided, and which parameters are not used, as sentences for the user.
    """

    parameters: AmclParameters
    unknown: tuple[str, ...]
    notes: tuple[str, ...] = ()


def load_parameters(path: str | Path) -> LoadedParameters:
    """Read amcl's parameters from a YAML file of nav2 or ROS 1.

    They may be below namespaces, beside other nodes, merged with those of wildcards (see `parameter_sections`), or at
    the top level. In a file with names of ROS 1, missing parameters have the defaults of ROS 1.

    Raises:
        InputError: The file cannot be read, is not a YAML mapping, has no parameters of amcl or different ones of
            several amcl nodes, or a value is invalid.
    """
    return _parse(node_parameters(read_yaml(path, max_bytes=MAX_FILE_SIZE), NODE, path), str(path))


def _parse(node: NodeParameters, source: str) -> LoadedParameters:
    """Check amcl's parameters, and separate those that are not used."""
    section = _with_initial_pose(node.parameters, source)
    ignored = [key for key in section if _is_ros1_name(key) and node.is_ros2]
    known = {key: value for key, value in section.items() if key in _KEY_TYPES and key not in ignored}
    of_node = [key for key in section if _is_node_parameter(key)]
    unknown = tuple(key for key in section if key not in _KEY_TYPES and key not in of_node and key not in node.shared)
    if not known and not of_node:
        raise InputError(source, "", f"has no parameters of {NODE}")
    values = _checked(known, source)
    try:
        parameters = _build(values, is_ros1=not node.is_ros2 and any(map(_is_ros1_name, section)))
    except InputError as error:
        raise InputError(source, error.field, error.reason) from error
    own = [key for key in of_node if key not in node.shared]
    notes = (*node.notes, *_notes(values, ignored, own, source))
    return LoadedParameters(parameters, unknown, notes)


def _with_initial_pose(parameters: Mapping[str, Any], source: str) -> dict[str, Any]:
    """The parameters with ``initial_pose.x`` and the like as one mapping."""
    prefix = "initial_pose."
    nested = {key.removeprefix(prefix): value for key, value in parameters.items() if key.startswith(prefix)}
    section = {key: value for key, value in parameters.items() if not key.startswith(prefix)}
    if nested and "initial_pose" in section:
        raise InputError(source, "initial_pose", "is given twice")
    return {**section, "initial_pose": nested} if nested else section


def _is_ros1_name(key: str) -> bool:
    """Whether only ROS 1 has a parameter of this name."""
    return key in ROS1_NAMES or key in INITIAL_POSE or key in INITIAL_COVARIANCE or key in ROS1_NODE_PARAMETERS


def _is_node_parameter(key: str) -> bool:
    """Whether a parameter is one of the ROS node, which localization of a log does not have."""
    return key.split(".", maxsplit=1)[0] in NODE_PARAMETERS


def _checked(known: Mapping[str, Any], source: str) -> dict[str, Any]:
    """The values by their keys, after a check of their types and that no parameter has two values."""
    document = validate(_AmclDocument, known, source)
    values = {key: getattr(document, key) for key in known}
    for key, name in ROS1_NAMES.items():
        if key in values and name in values and values[key] != values[name]:
            raise InputError(source, key, f"is {values[key]}, but {name}, its name in nav2, is {values[name]}")
    return values


def _notes(values: Mapping[str, Any], ignored: Sequence[str], of_node: Sequence[str], source: str) -> list[str]:
    """Which of the file's parameters are not used, or not as amcl uses them."""
    notes = []
    if ignored:
        names = ", ".join(f"{key} ({ROS1_NAMES[key]})" if key in ROS1_NAMES else key for key in ignored[:MAX_LISTED])
        notes.append(f"{source}: not used, as by nav2, since they are names of ROS 1 (nav2's in brackets): {names}.")
    if of_node:
        more = f" and {len(of_node) - MAX_LISTED} more" if len(of_node) > MAX_LISTED else ""
        notes.append(f"{source}: not used, since they concern the ROS node: {', '.join(of_node[:MAX_LISTED])}{more}.")
    if "initial_pose" in values and not values.get("set_initial_pose", False):
        notes.append(f"{source}: initial_pose is the start pose although set_initial_pose is not true.")
    if values.get("odom_model_type") in UNCORRECTED_MODELS:
        model = values["odom_model_type"]
        notes.append(f"{source}: odom_model_type {model} is computed as {model}-corrected, without amcl's old fault.")
    if values.get("do_beamskip") and values.get("laser_model_type") != "likelihood_field_prob":
        notes.append(f"{source}: do_beamskip has no effect without laser_model_type likelihood_field_prob, as in amcl.")
    return notes


def _build(values: Mapping[str, Any], *, is_ros1: bool) -> AmclParameters:
    """The filter's parameters from checked values by their keys in the file."""
    arguments: dict[str, Any] = dict(ROS1_DEFAULTS) if is_ros1 else {}
    pose = [0.0, 0.0, 0.0]
    covariance = list(AmclParameters().initial_covariance)
    for key, value in values.items():
        if key == "initial_pose":
            pose = [value.x, value.y, value.yaw]
            arguments.setdefault("set_initial_pose", True)
        elif key in INITIAL_POSE:
            pose[INITIAL_POSE[key]] = value
            arguments["set_initial_pose"] = True
        elif key in INITIAL_COVARIANCE:
            covariance[INITIAL_COVARIANCE[key]] = value
        elif key != "do_beamskip":
            arguments[ROS1_NAMES.get(key, key)] = value
    for name in ("robot_model_type", "laser_model_type"):
        if name in arguments:
            arguments[name] = MODEL_NAMES.get(arguments[name], arguments[name])
    if arguments.get("laser_model_type") == "likelihood_field_prob" and not values.get("do_beamskip", False):
        arguments["laser_model_type"] = "likelihood_field"  # without beam skipping the two are the same model
    parameters = AmclParameters(**arguments)
    x, y, theta = pose
    xx, yy, aa = covariance
    return replace(parameters, initial_pose=Pose(x, y, theta), initial_covariance=(xx, yy, aa))
