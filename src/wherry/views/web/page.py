"""Pages as single HTML files that contain styles, scripts and, for a recorded run, its trace."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from importlib import resources

from markupsafe import Markup

from wherry.trace.recordings import pack_frames
from wherry.views.templates import render_template

PLAYER_SCRIPTS = ("dom.js", "trace.js", "map.js", "player.js", "scene.js", "panels.js", "app.js")


def player_page(title: str, settings: Mapping[str, object], frames: bytes | None = None) -> str:
    """The page that plays a trace.

    Args:
        title: Title of the window.
        settings: Settings for the scripts: ``source`` is "socket" or "file".
        frames: Frames to embed in the page, as from `recordings.load_frames`; None if the server sends them.
    """
    trace = "" if frames is None else base64.b64encode(pack_frames(frames)).decode("ascii")
    return render_page("player.html.j2", PLAYER_SCRIPTS, title=title, settings=settings, trace=trace)


def render_page(
    template: str,
    scripts: Sequence[str],
    *,
    title: str,
    settings: Mapping[str, object],
    trace: str = "",
    styles: Sequence[str] = ("style.css",),
) -> str:
    """Render a page with embedded styles and scripts, and a content security policy that allows no other script.

    Args:
        template: File name of the template.
        scripts: File names of the scripts, in the order in which they are run.
        title: Title of the window.
        settings: Settings for the scripts.
        trace: A trace file in Base64.
        styles: File names of the style sheets.
    """
    style, program = ("\n".join(_static_text(file) for file in files) for files in (styles, scripts))
    digest = base64.b64encode(hashlib.sha256(f"\n{program}\n".encode()).digest()).decode("ascii")
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src 'self' data:; base-uri 'none'; form-action 'none'"
    )
    return render_template(
        template,
        policy=policy,
        title=title,
        # Styles, scripts and Base64 are safe; in JSON, "<" must be escaped because it could end the script element.
        style=Markup(style),  # noqa: S704
        settings=Markup(json.dumps(settings).replace("<", "\\u003c")),  # noqa: S704
        trace=Markup(trace),  # noqa: S704
        program=Markup(program),  # noqa: S704
    )


def _static_text(name: str) -> str:
    return (resources.files("wherry.views.web") / "static" / name).read_text(encoding="utf-8")
