"""Saved pose graphs: mapping continues as if it had never stopped, and broken files are rejected."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.mapping.graph_slam import GraphSlam
from wherry.mapping.saved_graph import load_graph, save_graph
from wherry_testing.buildings import LIDAR, Drive, drive


@pytest.fixture(scope="module")
def driven() -> Drive:
    return drive(noise=0.01, drift=0.03, spacing=0.2)


def add(slam: GraphSlam, driven: Drive, first: int, last: int) -> None:
    for scan, odometry in zip(driven.scans[first:last], driven.odometry[first:last], strict=True):
        slam.add(scan, odometry)


@pytest.fixture(scope="module")
def half(driven: Drive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    slam = GraphSlam(LIDAR)
    add(slam, driven, 0, len(driven.scans) // 2)
    path = tmp_path_factory.mktemp("graph") / "graph.npz"
    save_graph(slam.snapshot(), path)
    return path


def test_mapping_continues_to_the_same_bytes(driven: Drive, half: Path, tmp_path: Path) -> None:
    at_once, in_halves = GraphSlam(LIDAR), GraphSlam.from_snapshot(load_graph(half))
    add(at_once, driven, 0, len(driven.scans))
    add(in_halves, driven, len(driven.scans) // 2, len(driven.scans))
    assert any(closure.is_accepted for closure in at_once.loop_closures)
    for number, slam in enumerate((at_once, in_halves)):
        slam.finish()
        save_graph(slam.snapshot(), tmp_path / f"{number}.npz")
    assert (tmp_path / "0.npz").read_bytes() == (tmp_path / "1.npz").read_bytes()
    np.testing.assert_array_equal(at_once.grid().probability, in_halves.grid().probability)


def test_beam_angles_and_contradictions_are_saved(driven: Drive, tmp_path: Path) -> None:
    slam = GraphSlam(LIDAR)
    scans = [
        replace(scan, beam_angles=scan.angles + 1e-3 * np.sin(scan.angles), time_increment=1e-5) if n % 3 else scan
        for n, scan in enumerate(driven.scans[:90])
    ]
    for scan in scans:  # odometry that never changes, so that it is contradicted
        slam.add(scan, driven.odometry[0])
    snapshot = slam.snapshot()
    assert snapshot.odometry_contradictions
    assert not snapshot.tracking.is_odometry_trusted
    save_graph(snapshot, tmp_path / "graph.npz")
    loaded = load_graph(tmp_path / "graph.npz")
    assert loaded.odometry_contradictions == snapshot.odometry_contradictions
    for first, second in zip(snapshot.keyframes, loaded.keyframes, strict=True):
        np.testing.assert_array_equal(first.scan.angles, second.scan.angles)
        assert (first.scan.beam_angles is None) == (second.scan.beam_angles is None)
        assert first.scan.time_increment == second.scan.time_increment
        np.testing.assert_array_equal(first.cloud.points, second.cloud.points)
    again = GraphSlam.from_snapshot(loaded)
    for at, continued in ((90, slam), (90, again)):
        for scan in driven.scans[at : at + 40]:
            continued.add(scan, driven.odometry[0])
    np.testing.assert_array_equal(slam.trajectory.poses, again.trajectory.poses)


def test_files_of_the_first_version_are_read(driven: Drive, half: Path, tmp_path: Path) -> None:
    with np.load(half) as archive:
        head = json.loads(archive["head"].tobytes())
    head["wherry-graph"] = 1
    for name in ("odometry_credit", "odometry_bias", "scan_time"):
        del head["front"][name]
    added = ("scan_time_increment", "scan_angle_count", "scan_angles", "contradiction_times", "contradiction_motions")
    old = changed(
        half, tmp_path / "old.npz", head=np.frombuffer(json.dumps(head).encode(), np.uint8), **dict.fromkeys(added)
    )
    slams = [GraphSlam.from_snapshot(load_graph(path)) for path in (half, old)]
    middle = len(driven.scans) // 2
    for slam in slams:
        add(slam, driven, middle, middle + 40)
    np.testing.assert_array_equal(slams[0].trajectory.poses, slams[1].trajectory.poses)


def test_a_graph_without_scans_cannot_be_saved(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nothing"):
        save_graph(GraphSlam().snapshot(), tmp_path / "graph.npz")


def test_a_snapshot_does_not_change_with_later_scans(driven: Drive) -> None:
    slam = GraphSlam(LIDAR)
    add(slam, driven, 0, 30)
    snapshot = slam.snapshot()
    counts = [len(submap.members) for submap in snapshot.submaps]
    add(slam, driven, 30, 60)
    assert [len(submap.members) for submap in snapshot.submaps] == counts
    assert len(snapshot.keyframes) == len(snapshot.keyframe_poses) < len(slam.keyframes)
    assert len(snapshot.scan_poses) == 30


def test_the_scan_of_each_keyframe_has_its_time(driven: Drive) -> None:
    slam = GraphSlam(LIDAR)
    add(slam, driven, 0, 60)
    snapshot = slam.snapshot()
    times = [driven.scans[scan].time for scan in snapshot.keyframe_scans]
    assert times == [keyframe.scan.time for keyframe in snapshot.keyframes]


def test_a_restored_graph_does_not_change_its_snapshot(half: Path, driven: Drive) -> None:
    snapshot = load_graph(half)
    counts = [len(submap.members) for submap in snapshot.submaps]
    constraints = len(snapshot.constraints), len(snapshot.submap_constraints)
    middle = len(driven.scans) // 2
    add(GraphSlam.from_snapshot(snapshot), driven, middle, middle + 40)
    assert [len(submap.members) for submap in snapshot.submaps] == counts
    assert (len(snapshot.constraints), len(snapshot.submap_constraints)) == constraints


def changed(half: Path, out: Path, **arrays: object) -> Path:
    with np.load(half) as archive:
        whole = {name: archive[name] for name in archive.files}
    for name, value in arrays.items():
        if value is None:
            del whole[name]
        else:
            whole[name] = np.asarray(value)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **whole)
    out.write_bytes(buffer.getvalue())
    return out


def test_an_array_that_is_missing_or_invalid_is_named(half: Path, tmp_path: Path) -> None:
    out = tmp_path / "broken.npz"
    with np.load(half) as archive:
        nodes, ends, covariance = archive["nodes"], archive["edge_ends"], archive["edge_covariance"]
        fields, ranges = archive["scan_fields"], archive["scan_ranges"]
        head = json.loads(archive["head"].tobytes())
    cases = {
        "nodes": [None, nodes[:, :2], nodes.astype(np.int64), nodes * np.nan, nodes + 1e10, nodes[:-1]],
        "edge_ends": [ends + 10_000, ends - 10_000, ends[:-1]],
        "scan_angles": [np.zeros(1)],
        "edge_covariance": [-covariance],
        "scan_fields": [fields * [1, 1, 100, 1, 1, 1], fields * [1, 1, 1, 1, 0, 1]],
        "scan_ranges": [ranges[:-1]],
    }
    for name, values in cases.items():
        for value in values:
            with pytest.raises(InputError) as caught:
                load_graph(changed(half, out, **{name: value}))
            assert caught.value.field == name
    wrong_credit = {**head, "front": {**head["front"], "odometry_credit": 1000}}
    for broken in ({**head, "wherry-graph": 99}, {**head, "settings": {"speed": 1}}, [1], wrong_credit):
        with pytest.raises(InputError):
            load_graph(changed(half, out, head=np.frombuffer(json.dumps(broken).encode(), np.uint8)))


def test_a_file_that_is_not_an_archive_is_rejected(half: Path, tmp_path: Path) -> None:
    path = tmp_path / "graph.npz"
    for content in (b"", b"nonsense", half.read_bytes()[:-200]):
        path.write_bytes(content)
        with pytest.raises(InputError, match="saved pose graph"):
            load_graph(path)
    middle = half.stat().st_size // 2
    path.write_bytes(
        half.read_bytes()[:middle] + bytes(50) + half.read_bytes()[middle + 50 :]
    )  # a broken deflate stream
    with pytest.raises(InputError, match="saved pose graph"):
        load_graph(path)
    np.savez(path, nodes=np.array([{}], dtype=object), head=np.zeros(2, np.uint8))
    with pytest.raises(InputError):
        load_graph(path)
    with pytest.raises(InputError):
        load_graph(tmp_path / "missing.npz")
