"""Messages of ``/diagnostics``, and a count of the messages that a node rejected, so that none is dropped silently."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header

OK, WARN, ERROR = ros.DiagnosticStatus.OK, ros.DiagnosticStatus.WARN, ros.DiagnosticStatus.ERROR


@dataclass
class RejectedMessages:
    """How many messages a node rejected, and why it rejected the last one.

    Attributes:
        counts: Number of rejected messages by topic.
        last: Topic of the last rejected message and the reason; empty if there is none.
    """

    counts: Counter[str] = field(default_factory=Counter)
    last: str = ""

    def add(self, topic: str, reason: object) -> None:
        """Count a rejected message."""
        self.counts[topic] += 1
        self.last = f"{topic}: {reason}"


def diagnostic_status(name: str, level: int, text: str, values: Mapping[str, object]) -> ros.DiagnosticStatus:
    """The status of one component.

    Args:
        name: Name of the component.
        level: `OK`, `WARN` or `ERROR`.
        text: One sentence.
        values: Further values by name.
    """
    pairs = tuple(ros.KeyValue(key, str(value)) for key, value in values.items())
    return ros.DiagnosticStatus(level, name, text, "wherry", pairs)


def diagnostic_array(seconds: float, *statuses: ros.DiagnosticStatus) -> ros.DiagnosticArray:
    """The statuses of all components at a time, s."""
    return ros.DiagnosticArray(encode_header(seconds, ""), statuses)
