"""The whole state of graph SLAM in a file, so that mapping goes on another day as if it had never stopped.

A NumPy archive of plain arrays, never pickled objects; submaps are not in it, for they follow from the scans.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.files import read_bytes, write_atomically
from wherry.mapping.closures import Closure
from wherry.mapping.cloud import Cloud
from wherry.mapping.graph_slam import GraphSlam, GraphSlamSettings
from wherry.mapping.keyscans import Keyscan
from wherry.mapping.pieces import Edge, EdgeList, Front, Piece
from wherry.robot import Odometry, Scan, Velocity
from wherry.space.pose import Floats, Pose

FORMAT_VERSION = 1
LARGEST_FILE = 4_000_000_000  # bytes, unpacked
POSE, COVARIANCE = (3,), (3, 3)
# Every array of the file: its kind, and the shape of one of its entries.
ARRAYS: Mapping[str, tuple[str, tuple[int, ...]]] = {
    "nodes": ("f", POSE),
    "scan_fields": ("f", (6,)),  # time, angle_min, angle_increment, range_min, range_max, beams
    "scan_ranges": ("f", ()),
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
    "closure_fields": ("f", (4,)),  # time, response, rival, window
    "front_poses": ("f", POSE),  # pose, rate, key_pose
    "front_covariances": ("f", COVARIANCE),  # covariance, next_covariance
}
SAME_LENGTH = (
    ("nodes", "scan_fields"),
    ("edge_ends", "edge_measured", "edge_covariance", "edge_robust"),
    ("way_ends", "way_measured", "way_covariance"),
    ("piece_origin", "piece_start", "piece_covariance"),
    ("member_piece", "member_key", "member_pose"),
    ("passed_time", "passed_key", "passed_pose"),
    ("closure_ends", "closure_measured", "closure_information", "closure_fields"),
)


def save_graph(slam: GraphSlam, path: str | Path) -> None:
    """Write the state of graph SLAM.

    Raises:
        InputError: The folder does not exist or cannot be written to.
        ValueError: Nothing was mapped yet.
    """
    if slam.front is None:
        raise ValueError("there is nothing to save before the first scan")
    front, scans = slam.front, [keyscan.scan for keyscan in slam.keyscans]
    members = [(number, key, pose) for number, piece in enumerate(slam.pieces) for key, pose in piece.members]
    closures = slam.closures
    fields = [
        [scan.time, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max, len(scan.ranges)]
        for scan in scans
    ]
    values: dict[str, Any] = {
        "nodes": slam.nodes,
        "scan_fields": fields,
        "scan_ranges": np.concatenate([scan.ranges for scan in scans]),
        **_edge_arrays("edge", slam.edges),
        "edge_robust": slam.edges.robust,
        **_edge_arrays("way", slam.ways),
        "piece_origin": [piece.origin for piece in slam.pieces],
        "piece_start": [piece.start.as_array() for piece in slam.pieces],
        "piece_covariance": [piece.start_covariance for piece in slam.pieces],
        "member_piece": [number for number, _, _ in members],
        "member_key": [key for _, key, _ in members],
        "member_pose": [pose.as_array() for _, _, pose in members],
        "passed_time": [time for time, _, _ in slam.passed],
        "passed_key": [key for _, key, _ in slam.passed],
        "passed_pose": [pose.as_array() for _, _, pose in slam.passed],
        "closure_ends": [[closure.target, closure.node] for closure in closures],
        "closure_measured": [closure.measured.as_array() for closure in closures],
        "closure_information": [closure.information for closure in closures],
        "closure_fields": [[item.time, item.response, item.rival, item.window] for item in closures],
        "front_poses": [front.pose.as_array(), front.rate, front.key_pose.as_array()],
        "front_covariances": [front.covariance, front.next_covariance],
    }
    head = {
        "wherry-graph": FORMAT_VERSION,
        "settings": asdict(slam.settings),
        "lidar": slam.lidar.as_array().tolist(),
        "front": {"piece": front.piece, "time": front.time, "key": front.key},
        "odometry": _odometry_fields(front.odometry),
        "key_odometry": _odometry_fields(front.key_odometry),
        "pending": slam.pending,
        "refused": [closure.refused for closure in closures],
    }
    arrays = {name: _shaped(values[name], *ARRAYS[name]) for name in ARRAYS}
    arrays["head"] = np.frombuffer(json.dumps(head).encode("utf-8"), np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getvalue())


def load_graph(path: str | Path) -> GraphSlam:
    """Read a state of graph SLAM; scans can be added to it.

    Raises:
        InputError: The file cannot be read, is of another version, or is not what it should be.
    """
    head, arrays = _read(Path(path))
    try:
        return _restored(head, arrays)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(path, "head", f"does not fit the arrays: {error}") from error


def _restored(head: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> GraphSlam:
    """Graph SLAM in the state that was saved; submaps are made again from their scans when they are asked for."""
    slam = GraphSlam(_pose(np.array(head["lidar"], dtype=np.float64)), GraphSlamSettings(**head["settings"]))
    begins = np.concatenate([[0], np.cumsum(arrays["scan_fields"][:, 5].astype(np.int64))])
    for number, (time, angle_min, step, range_min, range_max, _) in enumerate(arrays["scan_fields"].tolist()):
        ranges = arrays["scan_ranges"][begins[number] : begins[number + 1]]
        scan = Scan(time, ranges, angle_min, step, range_min, range_max)
        slam.keyscans.append(Keyscan(scan, Cloud.of(scan, slam.lidar, slam.settings.range_limit)))
    slam.nodes = arrays["nodes"]
    slam.pending = int(head["pending"])
    for edge in _edges("edge", arrays, arrays["edge_robust"]):
        slam.edges.append(edge)
    for way in _edges("way", arrays, np.zeros(len(arrays["way_ends"]), np.bool_)):
        slam.ways.append(way)
    for origin, start, covariance in zip(
        arrays["piece_origin"], arrays["piece_start"], arrays["piece_covariance"], strict=True
    ):
        slam.pieces.append(Piece(int(origin), _pose(start), covariance))
    for piece, key, pose in zip(arrays["member_piece"], arrays["member_key"], arrays["member_pose"], strict=True):
        slam.pieces[piece].members.append((int(key), _pose(pose)))
    slam.passed = [
        (float(time), int(key), _pose(pose))
        for time, key, pose in zip(arrays["passed_time"], arrays["passed_key"], arrays["passed_pose"], strict=True)
    ]
    slam.closures = [
        Closure(time, int(ends[1]), int(ends[0]), _pose(measured), information, response, rival, window, str(refused))
        for (time, response, rival, window), ends, measured, information, refused in zip(
            arrays["closure_fields"].tolist(),
            arrays["closure_ends"],
            arrays["closure_measured"],
            arrays["closure_information"],
            head["refused"],
            strict=True,
        )
    ]
    pose, rate, key_pose = arrays["front_poses"]
    covariance, next_covariance = arrays["front_covariances"]
    slam.front = Front(
        piece=int(head["front"]["piece"]),
        time=float(head["front"]["time"]),
        pose=_pose(pose),
        odometry=_odometry(head["odometry"]),
        rate=rate,
        key=int(head["front"]["key"]),
        key_pose=_pose(key_pose),
        key_odometry=_odometry(head["key_odometry"]),
        covariance=covariance,
        next_covariance=next_covariance,
    )
    return slam


def _read(path: Path) -> tuple[Mapping[str, Any], Mapping[str, NDArray[Any]]]:
    """The file's head and arrays, checked."""
    data = io.BytesIO(read_bytes(path, limit=LARGEST_FILE))
    try:
        with zipfile.ZipFile(data) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > LARGEST_FILE:
                raise InputError(path, "", f"is larger than {LARGEST_FILE:,} bytes, unpacked")
        with np.load(data, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        head = json.loads(arrays.pop("head").tobytes())
    except (zipfile.BadZipFile, ValueError, KeyError, EOFError, OSError) as error:
        raise InputError(path, "", "is not a saved pose graph") from error
    _check(path, head, arrays)
    return head, arrays


def _check(path: Path, head: object, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Refuse what does not hold together."""
    if not isinstance(head, dict) or head.get("wherry-graph") != FORMAT_VERSION:
        raise InputError(path, "wherry-graph", f"must be version {FORMAT_VERSION}")
    for name, (kind, shape) in ARRAYS.items():
        array = arrays.get(name)
        if array is None or array.dtype.kind != kind or array.shape[1:] != shape or array.ndim != len(shape) + 1:
            raise InputError(path, name, "is missing or has the wrong shape")
        if kind == "f" and name != "scan_ranges" and not np.isfinite(array).all():
            raise InputError(path, name, "has a number that is not finite")
    for names in SAME_LENGTH:
        if len({len(arrays[name]) for name in names}) > 1:
            raise InputError(path, names[0], f"is not as long as {', '.join(names[1:])}")
    keys, pieces = len(arrays["nodes"]), len(arrays["piece_origin"])
    limits = {"edge_ends": keys, "piece_origin": keys, "member_key": keys, "passed_key": keys, "closure_ends": keys}
    for name, limit in {**limits, "way_ends": pieces, "member_piece": pieces}.items():
        if ((arrays[name] < 0) | (arrays[name] >= limit)).any():
            raise InputError(path, name, "names a node that does not exist")
    if arrays["scan_fields"][:, 5].sum() != len(arrays["scan_ranges"]):
        raise InputError(path, "scan_ranges", "is not as long as the scans")


def _shaped(value: Any, kind: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array with entries of a kind and a shape, also where there are none."""
    types = {"f": np.float64, "i": np.int64, "b": np.bool_}
    array: NDArray[Any] = np.array(value, dtype=types[kind]).reshape(-1, *shape)
    return array


def _edge_arrays(name: str, edges: EdgeList) -> dict[str, Any]:
    """Edges as the file's arrays."""
    return {
        f"{name}_ends": edges.ends,
        f"{name}_measured": edges.measured,
        f"{name}_covariance": edges.covariances,
    }


def _edges(name: str, arrays: Mapping[str, NDArray[Any]], robust: NDArray[Any]) -> Iterator[Edge]:
    """Edges from the file's arrays."""
    ends, measured, covariances = (arrays[f"{name}_{part}"] for part in ("ends", "measured", "covariance"))
    for (first, second), pose, covariance, doubted in zip(ends, measured, covariances, robust, strict=True):
        yield Edge(int(first), int(second), _pose(pose), covariance, bool(doubted))


def _pose(array: Floats) -> Pose:
    """A pose exactly as it was saved."""
    return Pose(float(array[0]), float(array[1]), float(array[2]))


def _odometry_fields(odometry: Odometry | None) -> list[float] | None:
    """Odometry as numbers."""
    if odometry is None:
        return None
    pose, velocity = odometry.pose, odometry.velocity
    return [odometry.time, pose.x, pose.y, pose.theta, velocity.linear, velocity.angular]


def _odometry(fields: Sequence[float] | None) -> Odometry | None:
    """Odometry from numbers."""
    if fields is None:
        return None
    time, x, y, theta, linear, angular = (float(value) for value in fields)
    return Odometry(time, Pose(x, y, theta), Velocity(linear, angular))
