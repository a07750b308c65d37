"""Writing bags of ROS 1 and ROS 2 without a ROS installation (the rosbags package, optional extra ``bags``)."""

from __future__ import annotations

import shutil
from pathlib import Path
from threading import Lock
from typing import Any, Self

import numpy as np

from wherry.errors import InputError
from wherry.ros.bags.files import UNFINISHED, URI_CHARACTERS
from wherry.ros.bags.formats import FORMATS, BagFormat
from wherry.ros.encoding import NANOSECONDS
from wherry.ros.message_fields import Message, MessageT
from wherry.ros.topics import Topic

FLUSH_PERIOD = 1.0  # s of recorded time; at most that is lost if the process is killed


class BagWriter:
    """A bag that is being written; a context manager.

    Until it is closed, the bag is called PATH.active. If the process is killed, that file or folder remains, with
    everything but the last second (`FLUSH_PERIOD`); ``rosbag reindex``, ``mcap recover`` or ``ros2 bag reindex`` then
    makes a bag of it.

    Args:
        path: Path of the bag; the suffix decides on the format, see `FORMATS`.

    Attributes:
        path: Path of the bag.

    Raises:
        InputError: rosbags is not installed, the suffix is not that of a bag, or the path exists or cannot be written
            to.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._unfinished = self.path.with_name(self.path.name + UNFINISHED)
        self._connections: dict[tuple[str, type[Message]], Any] = {}
        self._next_flush = -np.inf  # s, recorded time
        self._lock = Lock()
        self._check_path()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._bag: BagFormat | None = FORMATS[self.path.suffix](self.path, self._unfinished)
        except ImportError as error:
            raise InputError(path, "", "is to be a ROS bag: pip install 'wherry[bags]' to record one") from error
        except OSError as error:
            raise InputError(path, "", f"cannot be written: {error.strerror}") from error

    def _check_path(self) -> None:
        """Refuse suffixes that are not those of bags, and paths that exist."""
        if self.path.suffix not in FORMATS:
            raise InputError("--record", str(self.path), "is neither .bag (ROS 1), .mcap, nor a folder's name (ROS 2)")
        if not self.path.suffix and URI_CHARACTERS & set(str(self.path)):
            raise InputError("--record", str(self.path), "has a #, ? or % in it, which SQLite cannot write")
        if self.path.exists():
            raise InputError("--record", str(self.path), "exists already; recordings are never overwritten")
        if self._unfinished.exists():
            reason = "is left over from a recording that was cut off; move it away"
            raise InputError("--record", str(self._unfinished), reason)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def write(self, topic: Topic[MessageT], message: MessageT, seconds: float) -> None:
        """Add a message; may be called from any thread.

        Args:
            topic: Topic with its absolute name.
            message: Message of the topic's type.
            seconds: Time of the message on the robot's clock, s.

        Raises:
            InputError: The disk is full or gone.
            ValueError: The bag is closed.
        """
        with self._lock:
            if self._bag is None:
                raise ValueError(f"{self.path} is closed")
            try:
                key = (topic.name, topic.message_type)
                if key not in self._connections:
                    self._connections[key] = self._bag.connect(topic)
                self._bag.write(self._connections[key], message, round(seconds * NANOSECONDS))
                if seconds >= self._next_flush:
                    self._next_flush = seconds + FLUSH_PERIOD
                    self._bag.flush()
            except OSError as error:
                raise InputError(self._unfinished, "", f"cannot be written any further: {error.strerror}") from error

    def close(self) -> None:
        """Complete the bag and rename it to its path; further calls do nothing.

        Raises:
            InputError: It cannot be completed; the unfinished bag keeps its name.
        """
        with self._lock:
            bag, self._bag = self._bag, None
            if bag is None:
                return
            try:
                bag.close()
                bag.finished_path.rename(self.path)
                if self._unfinished.is_dir():
                    shutil.rmtree(self._unfinished)
            except OSError as error:
                raise InputError(self._unfinished, "", f"cannot be finished: {error.strerror}") from error
