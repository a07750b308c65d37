from .learning_curve import learning_curves
from .report import DeliveryReport, ReportPicture, render_report
from .rerun_recording import rerun_recording
from .snapshot_svg import MapBackground, draw_snapshot
from .terminal import DeliveryProgress
from .web.broadcast import TraceBroadcast
from .web.editor import serve_editor
from .web.page import player_page
from .web.server import PageServer, serve_recording, serve_run

__all__ = [
    "DeliveryProgress",
    "DeliveryReport",
    "MapBackground",
    "PageServer",
    "ReportPicture",
    "TraceBroadcast",
    "draw_snapshot",
    "learning_curves",
    "player_page",
    "render_report",
    "rerun_recording",
    "serve_editor",
    "serve_recording",
    "serve_run",
]
