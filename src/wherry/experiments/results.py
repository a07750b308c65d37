"""The results file: one section per experiment, with the command that writes it."""

from __future__ import annotations

import re
from pathlib import Path

from wherry.errors import InputError
from wherry.files import ensure_writable_folder, read_text, write_atomically

MAX_FILE_SIZE = 2_000_000  # bytes
HEADING = "# Results\nEvery section is written by the command named in it, and by nothing else.\n"


def write_section(path: Path, name: str, markdown: str) -> None:
    """Replace the section of this name in the results file, or append it.

    Args:
        path: The file; created if it does not exist.
        name: Name of the section, which is also the argument of ``wherry reproduce``.
        markdown: Text of the section, heading included.

    Raises:
        InputError: The file cannot be read or written.
    """
    text = read_text(path, max_bytes=MAX_FILE_SIZE) if path.exists() else HEADING
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    section = f"{begin}\n{markdown.strip()}\n\n`wherry reproduce {name}` wrote this section.\n{end}"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    found = pattern.findall(text)
    if len(found) > 1:
        raise InputError(path, begin, "occurs in the file more than once")
    changed = pattern.sub(lambda _: section, text) if found else f"{text.rstrip()}\n\n{section}\n"
    write_atomically(path, changed)


def write_picture(images: Path, name: str, content: bytes, alternative: str) -> str:
    """Write a picture, and return the Markdown that shows it in the results file.

    Args:
        images: Folder for pictures, beside the results file; created if it does not exist.
        name: File name of the picture.
        content: Content of the file.
        alternative: Text alternative of the picture.

    Raises:
        InputError: The picture cannot be written.
    """
    ensure_writable_folder(images)
    write_atomically(images / name, content)
    return f"![{alternative}]({images.name}/{name})"


def markdown_table(header: list[str], rows: list[list[str]]) -> str:
    """Return a Markdown table; the first column is text, the others are right-aligned numbers."""
    ruler = ["---"] + ["---:"] * (len(header) - 1)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [header, ruler, *rows])
