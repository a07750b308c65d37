"""The results file: one section an experiment, each written by the command that is named in it."""

from __future__ import annotations

import re
from pathlib import Path

from wherry.errors import InputError
from wherry.files import make_folder, read_text, write_atomically

LARGEST_FILE = 2_000_000  # bytes
HEADING = "# Results\nEvery section is written by the command named in it, and by nothing else.\n"


def write_section(path: Path, name: str, markdown: str) -> None:
    """Put a section into the results file, in the place of an older one of that name or at the end.

    Args:
        path: The file; made if it is not there.
        name: The section's name, which is also the argument of ``wherry reproduce``.
        markdown: Its text, heading included.

    Raises:
        InputError: The file cannot be read or written.
    """
    text = read_text(path, limit=LARGEST_FILE) if path.exists() else HEADING
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    section = f"{begin}\n{markdown.strip()}\n\n`wherry reproduce {name}` wrote this section.\n{end}"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    found = pattern.findall(text)
    if len(found) > 1:
        raise InputError(path, begin, "stands in the file more than once")
    changed = pattern.sub(lambda _: section, text) if found else f"{text.rstrip()}\n\n{section}\n"
    write_atomically(path, changed)


def write_picture(images: Path, name: str, content: bytes, shows: str) -> str:
    """Write a picture beside the results file, and return the Markdown that shows it there.

    Args:
        images: The folder for pictures; made if it is not there.
        name: The file's name in it.
        content: The file.
        shows: What it shows, for those who cannot see it.

    Raises:
        InputError: The picture cannot be written.
    """
    make_folder(images)
    write_atomically(images / name, content)
    return f"![{shows}]({images.name}/{name})"


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table; the first column is text, the others are figures."""
    ruler = ["---"] + ["---:"] * (len(header) - 1)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ruler, *rows])
