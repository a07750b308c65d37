"""Trace files: read back whole, up to where they were cut, or not at all."""

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


def kinds(records: list[Record]) -> list[str]:
    return [type(record).__name__ for record in records]


def test_a_file_holds_the_run_with_fewer_moments(recording: Path) -> None:
    wanted: list[Record] = []
    keep = throttle_snapshots(wanted.append, SNAPSHOT_PERIOD)
    for record in short_run():
        keep(record)
    assert kinds(load_trace(recording.parent)) == kinds(wanted)
    assert len(wanted) < len(short_run())


def test_thinning_keeps_to_the_period_and_lets_all_else_through() -> None:
    kept: list[Record] = []
    keep = throttle_snapshots(kept.append, 0.4)
    for step in range(21):
        keep(snapshot_at(0.1 * step, 0.0))
        keep(Narration(0.1 * step, Phase.EXPLORE, "x"))
    times = [record.time for record in kept if isinstance(record, RobotSnapshot)]
    np.testing.assert_allclose(times, [0.0, 0.4, 0.8, 1.2, 1.6, 2.0])
    assert sum(isinstance(record, Narration) for record in kept) == 21


@pytest.mark.parametrize("share", [0.3, 0.6, 0.99])
def test_a_file_cut_short_is_read_up_to_its_last_whole_frame(recording: Path, share: float) -> None:
    whole, content = load_trace(recording), recording.read_bytes()
    recording.write_bytes(content[: int(share * len(content))])
    part = load_trace(recording)
    assert 0 < len(part) < len(whole) or (share > 0.9 and len(part) == len(whole))
    assert kinds(part) == kinds(whole)[: len(part)]


def test_every_record_is_on_the_disk_as_soon_as_it_is_told(tmp_path: Path) -> None:
    recorder = TraceRecorder(tmp_path / TRACE_FILE_NAME)
    for number, record in enumerate(short_run()[:3], start=1):
        recorder(record)
        assert len(load_trace(tmp_path)) == number  # what a kill would leave
    recorder.close()


def test_packed_frames_are_a_file(recording: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.wherry"
    copy.write_bytes(pack_frames(load_frames(recording)))
    assert kinds(load_trace(copy)) == kinds(load_trace(recording))


def test_a_folder_means_the_trace_in_it(tmp_path: Path) -> None:
    assert find_trace(tmp_path) == tmp_path / TRACE_FILE_NAME
    assert find_trace(tmp_path / "other.wherry") == tmp_path / "other.wherry"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "no trace"),
        (b"P5\n4 4\n255\n", "no trace"),
        (b"wherry-trace: 2\n", "another version"),
        (MAGIC, "holds no record"),
        (MAGIC + b"not compressed", "is damaged"),
        (MAGIC + zlib.compress(b"\xff" * 64), "holds no record"),
        (MAGIC + zlib.compress(b"\x08\0\0\0\0\0\0\0\x02\0\0\0{}  "), "frame 1: is damaged"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "x.wherry"
    path.write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        load_trace(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_trace(tmp_path)
    with pytest.raises(InputError, match="cannot be written"):
        TraceRecorder(tmp_path / "nowhere" / TRACE_FILE_NAME)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_is_said_in_one_line() -> None:
    with pytest.raises(InputError, match="/dev/full: cannot be written: No space left on device"):
        TraceRecorder(Path("/dev/full"))
