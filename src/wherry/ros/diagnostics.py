"""What goes wrong is counted, and told on ``/diagnostics``: nothing that is refused is refused silently."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from wherry.ros import messages as ros
from wherry.ros.encoding import encode_header

OK, WARN, ERROR = ros.DiagnosticStatus.OK, ros.DiagnosticStatus.WARN, ros.DiagnosticStatus.ERROR


@dataclass
class RejectedMessages:
    """How many messages were refused, by topic, and why the last one was.

    Attributes:
        counts: By topic.
        last: The last one's topic and reason, empty before the first.
    """

    counts: Counter[str] = field(default_factory=Counter)
    last: str = ""

    def add(self, topic: str, reason: object) -> None:
        """Count one."""
        self.counts[topic] += 1
        self.last = f"{topic}: {reason}"


def diagnostic_status(name: str, level: int, text: str, values: Mapping[str, object]) -> ros.DiagnosticStatus:
    """How one part is doing."""
    pairs = tuple(ros.KeyValue(key, str(value)) for key, value in values.items())
    return ros.DiagnosticStatus(level, name, text, "wherry", pairs)


def diagnostic_array(seconds: float, *statuses: ros.DiagnosticStatus) -> ros.DiagnosticArray:
    """How all parts are doing."""
    return ros.DiagnosticArray(encode_header(seconds, ""), statuses)
