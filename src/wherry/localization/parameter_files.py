"""Parameter files of amcl in the YAML formats of nav2 and ROS 1."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ConfigDict, create_model

from wherry.documents import Document, Flag, Integer, Number, read_yaml, validate
from wherry.errors import InputError
from wherry.localization.parameters import AmclParameters
from wherry.space.pose import Pose

MAX_FILE_SIZE = 1_000_000  # bytes; a file may contain the parameters of all nodes of a robot
NODE = "amcl"  # name of the ROS node
SECTION_NAMES = (NODE, f"/{NODE}", "ros__parameters", "/**")  # keys below which amcl's parameters are nested

ROS1_NAMES = MappingProxyType(
    {f"odom_alpha{i}": f"alpha{i}" for i in range(1, 6)}
    | {
        f"laser_{name}": name
        for name in ("z_hit", "z_short", "z_max", "z_rand", "sigma_hit", "lambda_short", "max_beams")
    }
    | {"kld_err": "pf_err", "kld_z": "pf_z", "odom_model_type": "robot_model_type"}
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
        "diagnostic_updater.period",
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
        "std_warn_level_enabled",
        "tf_broadcast",
        "transform_tolerance",
        "use_map_topic",
        "use_sim_time",
        "qos_overrides",
    ]
)


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
    """

    parameters: AmclParameters
    unknown: tuple[str, ...]


def load_parameters(path: str | Path) -> LoadedParameters:
    """Read amcl's parameters from a YAML file of nav2 or ROS 1.

    The parameters may be nested in ``amcl: ros__parameters:`` or in ``amcl:``, below a namespace or beside other nodes,
    or be at the top level. In a file with names of ROS 1, missing parameters have the defaults of ROS 1.

    Raises:
        InputError: The file cannot be read, is not a YAML mapping, has no parameters of amcl, or a value is invalid.
    """
    try:
        section = _section(read_yaml(path, max_bytes=MAX_FILE_SIZE))
    except RecursionError as error:
        raise InputError(path, "", "is nested too deeply") from error
    return _parse(section, str(path))


def _section(content: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """The mapping with amcl's parameters, at any depth."""
    for name in SECTION_NAMES:
        if isinstance(content.get(name), dict):
            return _section(content[name])
    for value in content.values():
        if isinstance(value, dict) and (NODE in value or f"/{NODE}" in value):
            return _section(value)
    return content


def _parse(section: Mapping[Any, Any], source: str) -> LoadedParameters:
    """Check amcl's parameters and separate the unknown keys."""
    known = {key: value for key, value in section.items() if key in _KEY_TYPES}
    unknown = tuple(str(key) for key in section if key not in _KEY_TYPES and key not in NODE_PARAMETERS)
    if len(unknown) == len(section):
        raise InputError(source, "", f"has no parameters of {NODE}")
    document = validate(_AmclDocument, known, source)
    values = {key: getattr(document, key) for key in known}
    try:
        return LoadedParameters(_build(values), unknown)
    except InputError as error:
        raise InputError(source, error.field, error.reason) from error


def _build(values: Mapping[str, Any]) -> AmclParameters:
    """The filter's parameters from checked values by their keys in the file."""
    arguments: dict[str, Any] = dict(ROS1_DEFAULTS) if any(key in ROS1_NAMES for key in values) else {}
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
