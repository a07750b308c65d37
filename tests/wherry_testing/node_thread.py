"""A simulator node that runs in a thread of the test."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

from wherry.ros.nodes.simulator import SimulatorNode


@contextlib.contextmanager
def running(node: SimulatorNode) -> Iterator[None]:
    """Run a node in a thread until the block ends."""
    over = threading.Event()
    thread = threading.Thread(target=node.run, args=(over.is_set,))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
