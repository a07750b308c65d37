"""Trace files: written record by record, and read up to their last complete frame."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.trace.recordings import (
    MAGIC,
    SNAPSHOT_PERIOD,
    TRACE_FILE_NAME,
    TraceRecorder,
    find_trace,
    load_frames,
    load_trace,
    pack_frames,
)
from wherry.trace.records import Narration, Phase, Record, RobotSnapshot, throttle_snapshots
from wherry_testing.runs import short_run, snapshot_at


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    with TraceRecorder(tmp_path / TRACE_FILE_NAME) as recorder:
        for record in short_run():
            recorder(record)
    return tmp_path / TRACE_FILE_NAME


def type_names(records: list[Record]) -> list[str]:
    return [type(record).__name__ for record in records]


def test_a_file_contains_the_run_with_fewer_snapshots(recording: Path) -> None:
    expected: list[Record] = []
    sink = throttle_snapshots(expected.append, SNAPSHOT_PERIOD)
    for record in short_run():
        sink(record)
    assert type_names(load_trace(recording.parent)) == type_names(expected)
    assert len(expected) < len(short_run())


def test_throttling_limits_the_rate_of_snapshots_only() -> None:
    kept: list[Record] = []
    sink = throttle_snapshots(kept.append, 0.4)
    for step in range(21):
        sink(snapshot_at(0.1 * step, 0.0))
        sink(Narration(0.1 * step, Phase.EXPLORE, "x"))
    times = [record.time for record in kept if isinstance(record, RobotSnapshot)]
    np.testing.assert_allclose(times, [0.0, 0.4, 0.8, 1.2, 1.6, 2.0])
    assert sum(isinstance(record, Narration) for record in kept) == 21


@pytest.mark.parametrize("fraction", [0.3, 0.6, 0.99])
def test_a_truncated_file_is_read_up_to_its_last_complete_frame(recording: Path, fraction: float) -> None:
    complete, content = load_trace(recording), recording.read_bytes()
    recording.write_bytes(content[: int(fraction * len(content))])
    part = load_trace(recording)
    assert 0 < len(part) < len(complete) or (fraction > 0.9 and len(part) == len(complete))
    assert type_names(part) == type_names(complete)[: len(part)]


def test_every_record_can_be_read_before_the_file_is_closed(tmp_path: Path) -> None:
    recorder = TraceRecorder(tmp_path / TRACE_FILE_NAME)
    for number, record in enumerate(short_run()[:3], start=1):
        recorder(record)
        assert len(load_trace(tmp_path)) == number  # as if the process had been killed
    recorder.close()


def test_packed_frames_can_be_loaded(recording: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.wherry"
    copy.write_bytes(pack_frames(load_frames(recording)))
    assert type_names(load_trace(copy)) == type_names(load_trace(recording))


def test_the_trace_of_a_folder_is_found(tmp_path: Path) -> None:
    assert find_trace(tmp_path) == tmp_path / TRACE_FILE_NAME
    assert find_trace(tmp_path / "other.wherry") == tmp_path / "other.wherry"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no trace"),
        (b"P5\n4 4\n255\n", "no trace"),
        (b"wherry-trace: 2\n", "another version"),
        (MAGIC, "contains no record"),
        (MAGIC + b"not compressed", "is damaged"),
        (MAGIC + zlib.compress(b"\xff" * 64), "contains no record"),
        (MAGIC + zlib.compress(b"\x08\0\0\0\0\0\0\0\x02\0\0\0{}  "), "frame 1: is damaged"),
    ],
)
def test_invalid_files_are_rejected_in_one_line(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "x.wherry"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        load_trace(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_or_folder_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_trace(tmp_path)
    with pytest.raises(InputError, match="cannot be written"):
        TraceRecorder(tmp_path / "nowhere" / TRACE_FILE_NAME)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_is_reported_in_one_line() -> None:
    with pytest.raises(InputError, match="/dev/full: cannot be written: No space left on device"):
        TraceRecorder(Path("/dev/full"))
