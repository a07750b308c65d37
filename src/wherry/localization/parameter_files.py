"""A user's amcl parameters: nav2's yaml, or ROS 1's, as they are."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from wherry.errors import InputError
from wherry.files import read_text
from wherry.localization.parameters import AmclParameters
from wherry.space.pose import Pose

LARGEST_FILE = 1_000_000  # bytes
EXPONENT = re.compile(r"[-+]?[0-9]+[eE][-+]?[0-9]+")  # a number for ROS and for YAML 1.2, a word for YAML 1.1
NODE = "amcl"
FIELDS: MappingProxyType[str, type] = MappingProxyType(
    {field.name: {"float": float, "int": int, "bool": bool, "str": str}[str(field.type)]
     for field in fields(AmclParameters) if field.name not in ("initial_pose", "initial_covariance")}
)  # fmt: skip

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
NOT_THE_FILTERS = frozenset(  # how nodes talk to each other, which wherry leaves to whoever wraps it
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


@dataclass(frozen=True, slots=True)
class LoadedParameters:
    """What a file says.

    Attributes:
        parameters: For the filter.
        unknown: Keys that mean nothing to amcl; probably they are misspelt.
    """

    parameters: AmclParameters
    unknown: tuple[str, ...]


def load_parameters(path: str | Path) -> LoadedParameters:
    """Read amcl's parameters from a yaml file of nav2 or of ROS 1.

    They may stand under ``amcl: ros__parameters:``, below a namespace, beside other nodes', under ``amcl:`` alone, or
    at the top. With ROS 1's names, ROS 1's defaults hold for what is not in the file.

    Raises:
        InputError: The file cannot be read, is no yaml mapping, has no parameters of amcl, or a value cannot be used.
    """
    try:
        content = yaml.safe_load(read_text(path, limit=LARGEST_FILE))
        section = _section(content) if isinstance(content, dict) else None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise InputError(path, f"line {mark.line + 1}" if mark else "", "is not valid yaml") from error
    except RecursionError as error:
        raise InputError(path, "", "is nested too deeply") from error
    if section is None:
        raise InputError(path, "", "has no parameters: a yaml mapping is needed")
    return _parse(section, str(path))


def _section(content: Mapping[Any, Any]) -> Mapping[Any, Any]:
    """The mapping that holds amcl's parameters, however deep it is nested."""
    for name in (NODE, f"/{NODE}", "ros__parameters", "/**"):
        if isinstance(content.get(name), dict):
            return _section(content[name])
    for value in content.values():
        if isinstance(value, dict) and (NODE in value or f"/{NODE}" in value):
            return _section(value)
    return content


def _parse(section: Mapping[Any, Any], source: str) -> LoadedParameters:
    values: dict[str, Any] = dict(ROS1_DEFAULTS) if any(key in ROS1_NAMES for key in section) else {}
    pose = [0.0, 0.0, 0.0]
    covariance = list(AmclParameters().initial_covariance)
    unknown: list[str] = []
    skip_beams = _value(source, "do_beamskip", section.get("do_beamskip", False), bool)
    for key, value in section.items():
        name = ROS1_NAMES.get(key, key)
        if name in FIELDS:
            values[name] = _value(source, key, value, FIELDS[name])
        elif key == "initial_pose":
            _read_pose(source, value, pose)
            values.setdefault("set_initial_pose", True)
        elif key in INITIAL_POSE:
            pose[INITIAL_POSE[key]] = _value(source, key, value, float)
            values["set_initial_pose"] = True
        elif key in INITIAL_COVARIANCE:
            covariance[INITIAL_COVARIANCE[key]] = _value(source, key, value, float)
        elif key not in NOT_THE_FILTERS and key != "do_beamskip":
            unknown.append(str(key))
    if len(unknown) == len(section):
        raise InputError(source, "", f"has no parameters of {NODE}")
    return LoadedParameters(_build(source, values, pose, covariance, skip_beams=skip_beams), tuple(unknown))


def _build(
    source: str, values: dict[str, Any], pose: list[float], covariance: list[float], *, skip_beams: bool
) -> AmclParameters:
    """The parameters, with amcl's names of models translated."""
    for key in ("robot_model_type", "laser_model_type"):
        if key in values:
            values[key] = MODEL_NAMES.get(values[key], values[key])
    if values.get("laser_model_type") == "likelihood_field_prob" and not skip_beams:
        values["laser_model_type"] = "likelihood_field"  # without beam skipping the two are the same model
    try:
        chosen = AmclParameters(**values)
        x, y, theta = pose
        xx, yy, aa = covariance
        return replace(chosen, initial_pose=Pose(x, y, theta), initial_covariance=(xx, yy, aa))
    except InputError as error:
        raise InputError(source, error.field, error.reason) from error


def _read_pose(source: str, value: object, pose: list[float]) -> None:
    """nav2's ``initial_pose: {x, y, z, yaw}``."""
    if not isinstance(value, dict):
        raise InputError(source, "initial_pose", f"{value!r} is not a mapping of x, y and yaw")
    for index, name in enumerate(("x", "y", "yaw")):
        pose[index] = _value(source, f"initial_pose.{name}", value.get(name, 0.0), float)


def _value(source: str, key: object, value: object, wanted: type) -> Any:
    """A value as the type that its field has; a whole number is also a real one, a truth value is neither."""
    if wanted is float and isinstance(value, str) and EXPONENT.fullmatch(value):
        value = float(value)
    convert: dict[type, Callable[[], Any]] = {
        float: lambda: float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None,
        int: lambda: value if isinstance(value, int) and not isinstance(value, bool) else None,
        bool: lambda: value if isinstance(value, bool) else None,
        str: lambda: value if isinstance(value, str) else None,
    }
    found = convert[wanted]()
    if found is None or (wanted is float and not math.isfinite(found)):
        kind = {float: "a number", int: "a whole number", bool: "true or false", str: "a name"}[wanted]
        raise InputError(source, str(key), f"{value!r} is not {kind}")
    return found
