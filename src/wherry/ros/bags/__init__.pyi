from .log_recorder import LogRecorder
from .reading import is_bag, read_bag
from .recorded_transport import RecordedTransport
from .run_recorder import RecordedRobot, RunRecorder
from .writer import BagWriter

__all__ = [
    "BagWriter",
    "LogRecorder",
    "RecordedRobot",
    "RecordedTransport",
    "RunRecorder",
    "is_bag",
    "read_bag",
]
