"""The page as one HTML file: style, scripts and, for a recorded trace, the trace itself."""

from __future__ import annotations

import base64
import hashlib
import html
import json
from collections.abc import Mapping, Sequence
from importlib import resources

from wherry.trace.recordings import pack_frames

SCRIPTS = ("trace.js", "map.js", "player.js", "scene.js", "panels.js", "app.js")


def player_page(title: str, settings: Mapping[str, object], frames: bytes | None = None) -> str:
    """The page that plays a trace.

    Args:
        title: Of the window.
        settings: What the scripts are told: ``source`` is "socket" or "file".
        frames: A trace for the page to carry with it, as from `recordings.load_frames`.
    """
    trace = "" if frames is None else base64.b64encode(pack_frames(frames)).decode("ascii")
    return assemble("player.html", SCRIPTS, {"title": title, "settings": settings, "trace": trace})


def assemble(
    name: str, scripts: Sequence[str], values: Mapping[str, object], *, styles: Sequence[str] = ("style.css",)
) -> str:
    """A page of its skeleton, styles and scripts, under a policy that lets no other script run.

    Args:
        name: The skeleton's file.
        scripts: The scripts' files, in the order in which they build on each other.
        values: ``title``, ``settings`` and, if the page carries one, ``trace``.
        styles: The styles' files.
    """
    style, program = ("\n".join(_text(file) for file in files) for files in (styles, scripts))
    digest = base64.b64encode(hashlib.sha256(f"\n{program}\n".encode()).digest()).decode("ascii")
    policy = (
        f"default-src 'none'; script-src 'sha256-{digest}'; style-src 'unsafe-inline'; img-src data: blob:; "
        "connect-src 'self' data:; base-uri 'none'; form-action 'none'"
    )
    # "<" inside JSON could end the script element that it stands in.
    settings = json.dumps(values["settings"]).replace("<", "\\u003c")
    parts = {
        "POLICY": html.escape(policy),
        "TITLE": html.escape(str(values["title"])),
        "STYLE": style,
        "SETTINGS": settings,
        "TRACE": str(values.get("trace", "")),
        "PROGRAM": program,
    }
    page = _text(name)
    head, *rest = page.split("{{")
    return head + "".join(parts[key] + after for key, _, after in (part.partition("}}") for part in rest))


def _text(name: str) -> str:
    return (resources.files("wherry.views.web") / "static" / name).read_text(encoding="utf-8")
