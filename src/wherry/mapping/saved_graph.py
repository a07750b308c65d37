"""Files of graph snapshots, from which mapping continues to the same bytes as without a stop.

A file is a NumPy archive of plain arrays without pickled objects; matching grids are not stored, since they are rebuilt
from the scans. The archive's keys are the format's own: there a keyframe is a node or a key, a submap a piece, a
constraint between submaps a way, the tracking state the front, and the second-best score the rival.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.files import read_bytes, write_atomically
from wherry.mapping.constraints import ConstraintList
from wherry.mapping.graph_snapshot import GraphSnapshot, ScanPose
from wherry.mapping.keyframes import Keyframe
from wherry.mapping.loop_closure import LoopClosure
from wherry.mapping.odometry_check import FULL_CREDIT, OdometryContradiction
from wherry.mapping.point_cloud import PointCloud
from wherry.mapping.rejections import rejection_of
from wherry.mapping.settings import GraphSlamSettings
from wherry.mapping.submaps import Submap
from wherry.mapping.tracking import TrackingState
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import MAX_COORDINATE, Floats, Pose

FORMAT_VERSION = 2  # value of the key wherry-graph in the head
FIRST_VERSION = 1  # oldest version that is read; it has neither beam angles nor contradictions of odometry
NO_ANGLES = np.zeros(0)  # beam angles of a scan whose beams are evenly spaced
MAX_FILE_SIZE = 300_000_000  # bytes, packed
MAX_UNPACKED_SIZE = 600_000_000  # bytes, unpacked: scans of 1,081 beams at 69,000 keyframes
EIGENVALUE_TOLERANCE = 1e-9  # negative eigenvalue that rounding explains, per largest entry
MAX_SCAN_ANGLE = 4.0 * math.pi  # rad, between the first and the last beam of a scan
POSE, COVARIANCE = (3,), (3, 3)  # shapes of an entry
# Every array of a file: its dtype kind, and the shape of one entry.
ARRAYS: Mapping[str, tuple[str, tuple[int, ...]]] = {
    "nodes": ("f", POSE),
    "scan_fields": ("f", (6,)),  # time, angle_min, angle_increment, range_min, range_max, number of beams
    "scan_ranges": ("f", ()),
    "scan_time_increment": ("f", ()),
    "scan_angle_count": ("i", ()),  # number of the scan's beam angles; 0 if its beams are evenly spaced
    "scan_angles": ("f", ()),
    "edge_ends": ("i", (2,)),
    "edge_measured": ("f", POSE),
    "edge_covariance": ("f", COVARIANCE),
    "edge_robust": ("b", ()),
    "way_ends": ("i", (2,)),
    "way_measured": ("f", POSE),
    "way_covariance": ("f", COVARIANCE),
    "piece_origin": ("i", ()),
    "piece_start": ("f", POSE),
    "piece_covariance": ("f", COVARIANCE),
    "member_piece": ("i", ()),
    "member_key": ("i", ()),
    "member_pose": ("f", POSE),
    "passed_time": ("f", ()),
    "passed_key": ("i", ()),
    "passed_pose": ("f", POSE),
    "closure_ends": ("i", (2,)),
    "closure_measured": ("f", POSE),
    "closure_information": ("f", COVARIANCE),
    "closure_fields": ("f", (4,)),  # time, score, second-best score, window
    "front_poses": ("f", POSE),  # pose, velocity, keyframe pose
    "front_covariances": ("f", COVARIANCE),  # covariance, next covariance
    "contradiction_times": ("f", (2,)),  # end and beginning of the motion
    "contradiction_motions": ("f", (2, 3)),  # by odometry and by scan matching
}
# Arrays that must have the same length.
SAME_LENGTH = (
    ("nodes", "scan_fields", "scan_time_increment", "scan_angle_count"),
    ("edge_ends", "edge_measured", "edge_covariance", "edge_robust"),
    ("way_ends", "way_measured", "way_covariance"),
    ("piece_origin", "piece_start", "piece_covariance"),
    ("member_piece", "member_key", "member_pose"),
    ("passed_time", "passed_key", "passed_pose"),
    ("closure_ends", "closure_measured", "closure_information", "closure_fields"),
    ("contradiction_times", "contradiction_motions"),
)
# Keys of the settings whose names in the file differ from those in the code.
SETTINGS_KEYS = {"keyframe_distance": "keyscan_distance", "keyframe_angle": "keyscan_angle"}

Arrays = Mapping[str, NDArray[Any]]


def save_graph(snapshot: GraphSnapshot, path: str | Path) -> None:
    """Write a snapshot.

    Raises:
        InputError: The folder does not exist or cannot be written to.
        ValueError: The snapshot was taken before the first scan.
    """
    if snapshot.tracking is None:
        raise ValueError("there is nothing to save before the first scan")
    values = {
        **_keyframe_arrays(snapshot),
        **_constraint_arrays("edge", snapshot.constraints),
        "edge_robust": snapshot.constraints.robust,
        **_constraint_arrays("way", snapshot.submap_constraints),
        **_submap_arrays(snapshot.submaps),
        **_closure_arrays(snapshot.loop_closures),
        **_tracking_arrays(snapshot.tracking),
        **_contradiction_arrays(snapshot.odometry_contradictions),
    }
    arrays = {name: _shaped(values[name], *ARRAYS[name]) for name in ARRAYS}
    head = json.dumps(_head(snapshot, snapshot.tracking)).encode("utf-8")
    arrays["head"] = np.frombuffer(head, np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getvalue())


def load_graph(path: str | Path) -> GraphSnapshot:
    """Read a snapshot, see `GraphSlam.from_snapshot`.

    Raises:
        InputError: The file cannot be read, has another version, or is inconsistent.
    """
    head, arrays = _read(Path(path))
    try:
        return _snapshot(head, arrays)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(path, "head", f"does not fit the arrays: {error}") from error


def _head(snapshot: GraphSnapshot, tracking: TrackingState) -> dict[str, Any]:
    """The part of the file that is no array: version, settings, odometry, scalars and explanations."""
    settings = {SETTINGS_KEYS.get(name, name): value for name, value in asdict(snapshot.settings).items()}
    return {
        "wherry-graph": FORMAT_VERSION,
        "settings": settings,
        "lidar": snapshot.lidar.as_array().tolist(),
        "front": {
            "piece": tracking.submap,
            "time": tracking.time,
            "key": tracking.keyframe,
            "odometry_credit": tracking.odometry_credit,
            "odometry_bias": tracking.odometry_bias.tolist(),
            "scan_time": tracking.scan_time,
        },
        "odometry": _odometry_fields(tracking.odometry),
        "key_odometry": _odometry_fields(tracking.keyframe_odometry),
        "pending": snapshot.pending_closures,
        "refused": [closure.explanation for closure in snapshot.loop_closures],
    }


def _keyframe_arrays(snapshot: GraphSnapshot) -> dict[str, Any]:
    """Keyframes with their scans, and the poses of all scans."""
    scans = [keyframe.scan for keyframe in snapshot.keyframes]
    angles = [NO_ANGLES if scan.beam_angles is None else scan.beam_angles for scan in scans]
    return {
        "nodes": snapshot.keyframe_poses,
        "scan_fields": [
            [scan.time, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max, len(scan.ranges)]
            for scan in scans
        ],
        "scan_ranges": np.concatenate([scan.ranges for scan in scans]),
        "scan_time_increment": [scan.time_increment for scan in scans],
        "scan_angle_count": [len(directions) for directions in angles],
        "scan_angles": np.concatenate(angles),
        "passed_time": [scan_pose.time for scan_pose in snapshot.scan_poses],
        "passed_key": [scan_pose.keyframe for scan_pose in snapshot.scan_poses],
        "passed_pose": [scan_pose.offset.as_array() for scan_pose in snapshot.scan_poses],
    }


def _constraint_arrays(name: str, constraints: ConstraintList) -> dict[str, Any]:
    """Constraints as arrays whose keys begin with a name."""
    return {
        f"{name}_ends": constraints.ends,
        f"{name}_measured": constraints.measured,
        f"{name}_covariance": constraints.covariances,
    }


def _submap_arrays(submaps: Sequence[Submap]) -> dict[str, Any]:
    """Submaps with their members."""
    members = [(index, keyframe, pose) for index, submap in enumerate(submaps) for keyframe, pose in submap.members]
    return {
        "piece_origin": [submap.origin for submap in submaps],
        "piece_start": [submap.start.as_array() for submap in submaps],
        "piece_covariance": [submap.start_covariance for submap in submaps],
        "member_piece": [index for index, _, _ in members],
        "member_key": [keyframe for _, keyframe, _ in members],
        "member_pose": [pose.as_array() for _, _, pose in members],
    }


def _closure_arrays(closures: Sequence[LoopClosure]) -> dict[str, Any]:
    """Loop closures without their explanations, which are in the head."""
    return {
        "closure_ends": [[closure.target, closure.keyframe] for closure in closures],
        "closure_measured": [closure.measured.as_array() for closure in closures],
        "closure_information": [closure.information for closure in closures],
        "closure_fields": [
            [closure.time, closure.score, closure.second_best_score, closure.window] for closure in closures
        ],
    }


def _tracking_arrays(tracking: TrackingState) -> dict[str, Any]:
    """Poses and covariances of the tracking state; the rest of it is in the head."""
    return {
        "front_poses": [tracking.pose.as_array(), tracking.velocity, tracking.keyframe_pose.as_array()],
        "front_covariances": [tracking.covariance, tracking.next_covariance],
    }


def _contradiction_arrays(contradictions: Sequence[OdometryContradiction]) -> dict[str, Any]:
    """Contradictions between odometry and scan matching."""
    return {
        "contradiction_times": [[contradiction.time, contradiction.since] for contradiction in contradictions],
        "contradiction_motions": [
            [contradiction.odometry.as_array(), contradiction.matched.as_array()] for contradiction in contradictions
        ],
    }


def _snapshot(head: Mapping[str, Any], arrays: Arrays) -> GraphSnapshot:
    """The snapshot of a file's head and arrays."""
    names = {key: name for name, key in SETTINGS_KEYS.items()}
    settings = GraphSlamSettings(**{names.get(key, key): value for key, value in head["settings"].items()})
    lidar = _pose(np.array(head["lidar"], dtype=np.float64))
    passed = zip(arrays["passed_time"], arrays["passed_key"], arrays["passed_pose"], strict=True)
    return GraphSnapshot(
        lidar=lidar,
        settings=settings,
        keyframes=_keyframes(arrays, lidar, settings.range_limit),
        keyframe_poses=arrays["nodes"],
        constraints=_constraints("edge", arrays, arrays["edge_robust"]),
        submaps=_submaps(arrays),
        submap_constraints=_constraints("way", arrays, np.zeros(len(arrays["way_ends"]), np.bool_)),
        tracking=_tracking(head, arrays),
        scan_poses=tuple(ScanPose(float(time), int(keyframe), _pose(pose)) for time, keyframe, pose in passed),
        loop_closures=_loop_closures(head, arrays),
        pending_closures=int(head["pending"]),
        odometry_contradictions=_contradictions(arrays),
    )


def _keyframes(arrays: Arrays, lidar: Pose, range_limit: float) -> tuple[Keyframe, ...]:
    """Keyframes, with their point clouds recomputed from the scans."""
    ends = np.cumsum(arrays["scan_fields"][:, 5].astype(np.int64))[:-1]
    angle_ends = np.cumsum(arrays["scan_angle_count"])[:-1]
    scans = zip(
        arrays["scan_fields"].tolist(),
        np.split(arrays["scan_ranges"], ends),
        arrays["scan_time_increment"].tolist(),
        np.split(arrays["scan_angles"], angle_ends),
        strict=True,
    )
    keyframes = []
    for (time, angle_min, step, range_min, range_max, _), ranges, time_increment, angles in scans:
        beam_angles = angles if len(angles) else None
        scan = Scan(time, ranges, angle_min, step, range_min, range_max, time_increment, beam_angles)
        keyframes.append(Keyframe(scan, PointCloud.from_scan(scan, lidar, range_limit)))
    return tuple(keyframes)


def _constraints(name: str, arrays: Arrays, robust: NDArray[np.bool_]) -> ConstraintList:
    """Constraints from the arrays whose keys begin with a name."""
    ends, measured, covariances = (arrays[f"{name}_{part}"] for part in ("ends", "measured", "covariance"))
    return ConstraintList.from_arrays(ends, measured, covariances, robust)


def _submaps(arrays: Arrays) -> tuple[Submap, ...]:
    """Submaps with their members."""
    begins = zip(arrays["piece_origin"], arrays["piece_start"], arrays["piece_covariance"], strict=True)
    submaps = tuple(Submap(int(origin), _pose(start), covariance) for origin, start, covariance in begins)
    members = zip(arrays["member_piece"], arrays["member_key"], arrays["member_pose"], strict=True)
    for index, keyframe, pose in members:
        submaps[index].members.append((int(keyframe), _pose(pose)))
    return submaps


def _loop_closures(head: Mapping[str, Any], arrays: Arrays) -> tuple[LoopClosure, ...]:
    """Loop closures with their explanations."""
    entries = zip(
        arrays["closure_fields"].tolist(),
        arrays["closure_ends"],
        arrays["closure_measured"],
        arrays["closure_information"],
        map(str, head["refused"]),
        strict=True,
    )
    return tuple(
        LoopClosure(
            time,
            int(keyframe),
            int(target),
            _pose(measured),
            information,
            score,
            second_best_score,
            window,
            rejection_of(explanation),
            explanation,
        )
        for (time, score, second_best_score, window), (target, keyframe), measured, information, explanation in entries
    )


def _contradictions(arrays: Arrays) -> tuple[OdometryContradiction, ...]:
    """Contradictions between odometry and scan matching."""
    entries = zip(arrays["contradiction_times"].tolist(), arrays["contradiction_motions"], strict=True)
    return tuple(
        OdometryContradiction(time, since, _pose(odometry), _pose(matched))
        for (time, since), (odometry, matched) in entries
    )


def _tracking(head: Mapping[str, Any], arrays: Arrays) -> TrackingState:
    """The tracking state."""
    pose, velocity, keyframe_pose = arrays["front_poses"]
    covariance, next_covariance = arrays["front_covariances"]
    front = head["front"]
    credit = int(front["odometry_credit"])
    if not 0 <= credit <= FULL_CREDIT:
        raise ValueError(f"odometry_credit is {credit}, not 0 to {FULL_CREDIT}")
    return TrackingState(
        submap=int(front["piece"]),
        time=_finite(front["time"]),
        pose=_pose(pose),
        odometry=_odometry(head["odometry"]),
        velocity=velocity,
        keyframe=int(front["key"]),
        keyframe_pose=_pose(keyframe_pose),
        keyframe_odometry=_odometry(head["key_odometry"]),
        covariance=covariance,
        next_covariance=next_covariance,
        odometry_credit=credit,
        odometry_bias=np.array([_finite(value) for value in front["odometry_bias"]]),
        scan_time=_finite(front["scan_time"]),
    )


def _finite(value: Any) -> float:
    """A number that is finite; otherwise raise a ValueError."""
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} is not finite")
    return number


def _read(path: Path) -> tuple[Mapping[str, Any], Arrays]:
    """The file's head and arrays, checked."""
    data = io.BytesIO(read_bytes(path, max_bytes=MAX_FILE_SIZE))
    try:
        with zipfile.ZipFile(data) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size <= MAX_UNPACKED_SIZE:
            with np.load(data, allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
            head = json.loads(arrays.pop("head").tobytes())
    except Exception as error:  # zipfile, zlib and numpy raise many kinds on damaged files
        raise InputError(path, "", "is not a saved pose graph") from error
    if size > MAX_UNPACKED_SIZE:
        raise InputError(path, "", f"is larger than {MAX_UNPACKED_SIZE:,} bytes, unpacked")
    if isinstance(head, dict) and head.get("wherry-graph") == FIRST_VERSION:
        head, completed = _completed(head, arrays)
        arrays = dict(completed)
    _check(path, head, arrays)
    return head, arrays


def _completed(head: dict[str, Any], arrays: Arrays) -> tuple[Mapping[str, Any], Arrays]:
    """The head and arrays of a file of the first version, with what it lacks."""
    front = head.get("front")
    if not isinstance(front, dict):
        return head, arrays
    keyframes = len(arrays.get("scan_fields", ()))
    missing = {
        "scan_time_increment": np.zeros(keyframes),
        "scan_angle_count": np.zeros(keyframes, np.int64),
        "scan_angles": NO_ANGLES,
        "contradiction_times": np.zeros((0, 2)),
        "contradiction_motions": np.zeros((0, 2, 3)),
    }
    front = front | {"odometry_credit": FULL_CREDIT, "odometry_bias": [0.0] * 3, "scan_time": front.get("time")}
    return head | {"wherry-graph": FORMAT_VERSION, "front": front}, {**missing, **arrays}


def _check(path: Path, head: object, arrays: Arrays) -> None:
    """Raise an `InputError` unless version, shapes, values, lengths and indices are valid."""
    if not isinstance(head, dict) or head.get("wherry-graph") != FORMAT_VERSION:
        raise InputError(path, "wherry-graph", f"must be version {FIRST_VERSION} to {FORMAT_VERSION}")
    for name, (kind, shape) in ARRAYS.items():
        _check_array(path, name, arrays.get(name), kind, shape)
    for names in SAME_LENGTH:
        if len({len(arrays[name]) for name in names}) > 1:
            raise InputError(path, names[0], f"is not as long as {', '.join(names[1:])}")
    keyframes, submaps = len(arrays["nodes"]), len(arrays["piece_origin"])
    keyframe_indices = ("edge_ends", "piece_origin", "member_key", "passed_key", "closure_ends")
    limits = dict.fromkeys(keyframe_indices, keyframes) | {"way_ends": submaps, "member_piece": submaps}
    for name, limit in limits.items():
        if ((arrays[name] < 0) | (arrays[name] >= limit)).any():
            raise InputError(path, name, "has the index of a node or submap that does not exist")
    _check_scans(path, arrays["scan_fields"], arrays["scan_ranges"])
    _check_beam_angles(path, arrays)


def _check_array(path: Path, name: str, array: object, kind: str, shape: tuple[int, ...]) -> None:
    """Raise an `InputError` unless an array has its dtype kind, the shape of its entries, and possible values."""
    if (
        not isinstance(array, np.ndarray)
        or array.dtype.kind != kind
        or array.shape[1:] != shape
        or array.ndim != len(shape) + 1
    ):
        raise InputError(path, name, "is missing or has the wrong shape")
    if kind == "f" and name != "scan_ranges" and not np.isfinite(array).all():
        raise InputError(path, name, "has a number that is not finite")
    if shape[-1:] == POSE and shape != COVARIANCE and (np.abs(array) > MAX_COORDINATE).any():
        raise InputError(path, name, f"has a pose beyond {MAX_COORDINATE:g} m")
    if shape == COVARIANCE and not _are_positive(array):
        raise InputError(path, name, "has a matrix with a negative eigenvalue")


def _are_positive(matrices: Floats) -> bool:
    """Whether symmetric matrices, [N, 3, 3], have no negative eigenvalue up to rounding."""
    largest = np.abs(matrices).max(axis=(1, 2), initial=0.0)
    return bool((np.linalg.eigvalsh(matrices) >= -EIGENVALUE_TOLERANCE * largest[:, None]).all())


def _check_scans(path: Path, fields: Floats, ranges: Floats) -> None:
    """Raise an `InputError` unless the scans' fields, [K, 6], and all their ranges are possible."""
    _, _, increment, range_min, range_max, beams = fields.T
    if (beams < 0).any() or (beams % 1.0 != 0).any() or beams.sum() != len(ranges):
        raise InputError(path, "scan_ranges", "is not as long as the scans")
    if ((range_min < 0.0) | (range_max <= range_min)).any() or (np.abs(increment * beams) > MAX_SCAN_ANGLE).any():
        raise InputError(path, "scan_fields", "has impossible limits of range or angle")


def _check_beam_angles(path: Path, arrays: Arrays) -> None:
    """Raise an `InputError` unless every scan has all of its beam angles or none."""
    beams, counts = arrays["scan_fields"][:, 5], arrays["scan_angle_count"]
    if not ((counts == 0) | (counts == beams)).all() or counts.sum() != len(arrays["scan_angles"]):
        raise InputError(path, "scan_angles", "is not as long as the scans")


def _shaped(value: Any, kind: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array with entries of a dtype kind and a shape, even if there are none."""
    types = {"f": np.float64, "i": np.int64, "b": np.bool_}
    array: NDArray[Any] = np.array(value, dtype=types[kind]).reshape(-1, *shape)
    return array


def _pose(array: Floats) -> Pose:
    """A pose with exactly the saved numbers; `Pose.from_array` would wrap the heading."""
    return Pose(float(array[0]), float(array[1]), float(array[2]))


def _odometry_fields(odometry: Odometry | None) -> list[float] | None:
    """Odometry as time, x, y, θ, v and ω."""
    if odometry is None:
        return None
    pose, velocity = odometry.pose, odometry.velocity
    return [odometry.time, pose.x, pose.y, pose.theta, velocity.linear, velocity.angular]


def _odometry(fields: Sequence[float] | None) -> Odometry | None:
    """Odometry from its `_odometry_fields`."""
    if fields is None:
        return None
    time, x, y, theta, linear, angular = (_finite(value) for value in fields)
    return Odometry(time, Pose(x, y, theta), Velocity(linear, angular))
