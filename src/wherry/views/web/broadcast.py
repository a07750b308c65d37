"""A run's frames for any number of pages, of which none can hold the run up."""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from itertools import accumulate

from wherry.trace.codec import Encoder
from wherry.trace.records import Record, RobotSnapshot

LARGEST_MESSAGE = 1_000_000  # bytes, after which the rest goes into the next message
LARGEST_BACKLOG = 16_000_000  # bytes of Seen that a page may lie behind; beyond that it is sent fewer of them
LARGEST_HISTORY = 256_000_000  # bytes of Seen that are kept for pages that come later


@dataclass(frozen=True, slots=True)
class Batch:
    """What to send to a page next.

    Attributes:
        frames: Whole frames in a row.
        following: The number of the first frame after these.
    """

    frames: bytes
    following: int


class Broadcast:
    """A sink that keeps every frame of a run for those who watch; the run calls it, the server's thread reads it.

    Pages ask for what follows the frames that they have, so there is no queue to overflow. A page that is too slow for
    the run gets fewer snapshots; a run that is too long for the memory keeps fewer of them. All other records are kept and
    sent without exception.

    Attributes:
        name: Tells this run from others, so that a page which comes back knows whether to go on or to begin anew.
        ended: Whether the run is over.
    """

    def __init__(self) -> None:
        self.name = secrets.token_hex(8)
        self.ended = False
        self._encoder = Encoder()
        self._frames: list[bytes] = []
        self._moments: list[int | None] = []  # for each frame, which Seen it is, or None for another record
        self._moment_count = 0
        self._history = 0  # bytes of Seen in _frames
        self._kept_every = 1

    def __call__(self, record: Record) -> None:
        """Keep a record."""
        self.add(self._encoder.encode(record), is_moment=isinstance(record, RobotSnapshot))

    def add(self, frame: bytes, *, is_moment: bool) -> None:
        """Keep a frame; pages see it as soon as it is in the list.

        Args:
            frame: A record's frame.
            is_moment: Whether it is a `RobotSnapshot`, of which some may be left out.
        """
        self._moments.append(self._moment_count if is_moment else None)
        if is_moment:
            frame = b"" if self._moment_count % self._kept_every else frame
            self._moment_count += 1
            self._history += len(frame)
        self._frames.append(frame)
        if self._history > LARGEST_HISTORY:
            self._forget_half()

    def end(self) -> None:
        """Say that nothing more comes."""
        self.ended = True

    def __len__(self) -> int:
        """How many frames there are."""
        return len(self._frames)

    def after(self, start: int) -> Batch:
        """The next frames from number ``start`` on, as many as fit into one message; at least one if there is one."""
        pending = self._frames[start:]
        moments = self._moments[start : start + len(pending)]
        backlog = sum(len(frame) for frame, moment in zip(pending, moments, strict=True) if moment is not None)
        every = 1 + backlog // LARGEST_BACKLOG
        chosen = [
            frame if moment is None or moment % every == 0 else b""
            for frame, moment in zip(pending, moments, strict=True)
        ]
        count = max(1, sum(total <= LARGEST_MESSAGE for total in accumulate(map(len, chosen))))
        return Batch(b"".join(chosen[:count]), min(start + count, start + len(pending)))

    def _forget_half(self) -> None:
        """Forget every second Seen; their numbers stay, so that pages lose nothing else."""
        self._kept_every *= 2
        for at, moment in enumerate(self._moments):
            if moment is not None and moment % self._kept_every:
                self._frames[at] = b""
        self._history = sum(
            len(frame) for frame, moment in zip(self._frames, self._moments, strict=True) if moment is not None
        )
