"""A buffer of a run's frames for any number of pages; a slow page never blocks the run."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from itertools import accumulate

from wherry.trace.codec import Encoder
from wherry.trace.records import Record, RobotSnapshot

MAX_MESSAGE_SIZE = 1_000_000  # bytes of frames in a message
MAX_BACKLOG_SIZE = 16_000_000  # bytes of unsent snapshots above which a page is sent only a part of them
MAX_HISTORY_SIZE = 256_000_000  # bytes of buffered snapshots above which every second one is dropped


@dataclass(frozen=True, slots=True)
class FrameBatch:
    """Frames that are sent to a page in one message.

    Attributes:
        frames: The concatenated frames.
        next_index: Index of the first frame after these.
    """

    frames: bytes
    next_index: int


class TraceBroadcast:
    """A sink that buffers the frames of a run; the run writes to it, and the server's thread reads from it.

    Each page requests the frames after those that it has, so no queue can overflow. A page that is slower than the run
    is sent fewer snapshots, and of a run that exceeds `MAX_HISTORY_SIZE` fewer snapshots are kept. All other records
    are always kept and sent.

    Attributes:
        run_id: Random identifier of the run, by which a reconnecting page decides whether to continue or to start over.
        ended: Whether the run is over.
    """

    def __init__(self) -> None:
        self.run_id = secrets.token_hex(8)
        self.ended = False
        self._encoder = Encoder()
        self._frames: list[bytes] = []
        self._snapshot_numbers: list[int | None] = []  # index of a frame among the snapshots, or None
        self._snapshot_count = 0
        self._history_size = 0  # bytes of the buffered snapshots
        self._stride = 1  # one snapshot in `_stride` is kept

    def __call__(self, record: Record) -> None:
        """Encode a record and add its frame."""
        self.add(self._encoder.encode(record), is_snapshot=isinstance(record, RobotSnapshot))

    def add(self, frame: bytes, *, is_snapshot: bool) -> None:
        """Add a frame, to be sent to all pages.

        Args:
            frame: A record's frame.
            is_snapshot: Whether the frame may be dropped, since it is a `RobotSnapshot`.
        """
        self._snapshot_numbers.append(self._snapshot_count if is_snapshot else None)
        if is_snapshot:
            frame = b"" if self._snapshot_count % self._stride else frame
            self._snapshot_count += 1
            self._history_size += len(frame)
        self._frames.append(frame)
        if self._history_size > MAX_HISTORY_SIZE:
            self._drop_every_second_snapshot()

    def end(self) -> None:
        """Mark the run as over."""
        self.ended = True

    def __len__(self) -> int:
        """Number of frames, dropped ones included."""
        return len(self._frames)

    def batch_from(self, start: int) -> FrameBatch:
        """The frames from an index on that fit into one message; at least one, if there is any."""
        frames = self._frames[start:]
        numbers = self._snapshot_numbers[start : start + len(frames)]
        backlog = sum(len(frame) for frame, number in zip(frames, numbers, strict=True) if number is not None)
        stride = 1 + backlog // MAX_BACKLOG_SIZE
        chosen = [
            frame if number is None or number % stride == 0 else b""
            for frame, number in zip(frames, numbers, strict=True)
        ]
        count = max(1, sum(total <= MAX_MESSAGE_SIZE for total in accumulate(map(len, chosen))))
        return FrameBatch(b"".join(chosen[:count]), min(start + count, start + len(frames)))

    def _drop_every_second_snapshot(self) -> None:
        """Empty the frames of every second snapshot; the indices of frames stay the same, since pages refer to them."""
        self._stride *= 2
        for index, number in enumerate(self._snapshot_numbers):
            if number is not None and number % self._stride:
                self._frames[index] = b""
        sizes = zip(map(len, self._frames), self._snapshot_numbers, strict=True)
        self._history_size = sum(size for size, number in sizes if number is not None)
