"""Text files as strangers write them: packing, byte order marks, line ends, comments, and files of other kinds."""

from __future__ import annotations

import bz2
import gzip
import lzma
from pathlib import Path

import pytest

from wherry.errors import InputError
from wherry.logs.options import ReadingOptions
from wherry.logs.reading import read_log
from wherry.logs.tables import read_odometry

LINES = [f"FLASER 4 1.0 2.0 3.0 4.0 0 0 0 0 0 0 {n}.0 host {n}.0" for n in range(1, 9)]
TEXT = "\n".join(LINES) + "\n"

VARIANTS = {
    "byte order mark": b"\xef\xbb\xbf" + TEXT.encode(),
    "Windows line ends": TEXT.replace("\n", "\r\n").encode(),
    "spaces and tabs around": "".join(f"  \t{line} \t\n" for line in LINES).encode(),
    "no line end at the end": TEXT.rstrip("\n").encode(),
    "comments": f"# a\n// b\n  % c\n\n{TEXT}".encode(),
    "gzipped": gzip.compress(TEXT.encode()),
    "gzipped with a mark": gzip.compress(b"\xef\xbb\xbf" + TEXT.encode()),
}


@pytest.mark.parametrize("name", ["some.log", "some.log.gz", "some"])
@pytest.mark.parametrize("content", VARIANTS.values(), ids=VARIANTS.keys())
def test_variants_of_text_are_read_whatever_the_name(tmp_path: Path, content: bytes, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    log = read_log(path)
    assert [scan.time for scan in log.scans] == [float(n) for n in range(1, 9)]
    assert not log.skipped


OTHERS = {
    "has no (scans|numbers) in it": b"",
    "is text in UTF-16: convert it to UTF-8": TEXT.encode("utf-16"),
    "is a binary file, not text": TEXT.encode("utf-16-le"),
    "is a ROS 1 bag": b"#ROSBAG V2.0\n" + bytes(100),
    r"ends in .mcap": b"\x89MCAP0\r\n" + bytes(100),
    r"ends in .db3": b"SQLite format 3\x00" + bytes(100),
    "lines that end in a carriage return only": TEXT.replace("\n", "\r").encode(),
    "compressed by xz": lzma.compress(TEXT.encode()),
    "compressed by bzip2": bz2.compress(TEXT.encode()),
    "gzipped twice": gzip.compress(gzip.compress(TEXT.encode())),
}


@pytest.mark.parametrize(("reason", "content"), OTHERS.items(), ids=OTHERS.keys())
def test_files_of_other_kinds_are_named_even_if_lenient(tmp_path: Path, reason: str, content: bytes) -> None:
    path = tmp_path / "some.log"
    path.write_bytes(content)
    for read in (read_log, lambda file: read_log(file, ReadingOptions(lenient=True)), read_odometry):
        with pytest.raises(InputError, match=reason):
            read(path)


def test_a_binary_image_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "some.log"
    path.write_bytes(bytes(range(256)) * 20)
    with pytest.raises(InputError, match="is a binary file, not text"):
        read_log(path)


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        (LINES[3].replace("2.0", "2,0"), "line 4: has a decimal comma in 2,0"),
        (LINES[3].replace("2.0", "2\x00.0"), "line 4: has a word that is not a number"),
        (LINES[3].replace("2.0", "2_0"), "line 4: has an underscore in a number"),
        (LINES[3].replace("FLASER 4", "FLASER 0x4"), "line 4: does not say how many beams it has"),
    ],
)
def test_malformed_numbers_are_named_or_left_out(tmp_path: Path, broken: str, reason: str) -> None:
    path = tmp_path / "some.log"
    path.write_text(TEXT.replace(LINES[3], broken))
    with pytest.raises(InputError, match=reason):
        read_log(path)
    log = read_log(path, ReadingOptions(lenient=True))
    assert len(log.scans) == 7
    assert any(note.startswith('1 of 8 lines is left out: 1 like "line 4: ') for note in log.notes)


def test_more_malformed_lines_than_a_share_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "some.log"
    path.write_text(TEXT + "\n".join(f"FLASER 4 1.0 {n}" for n in range(4)))
    with pytest.raises(InputError, match=r"4 of 12 .* cannot be used, more than the 25% that --lenient leaves out"):
        read_log(path, ReadingOptions(lenient=True))


def test_logs_that_do_not_fit_into_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "some.log"
    path.write_text(TEXT)
    monkeypatch.setattr("wherry.logs.collector.MAX_MESSAGES", 5)
    with pytest.raises(InputError, match="line 6: exceeds the 5 messages and"):
        read_log(path)
    monkeypatch.setattr("wherry.logs.rejections.MAX_REJECTED", 3)
    path.write_text("FLASER 4 1.0\n" * 1000)
    with pytest.raises(InputError, match="line 4: is the last of over 3 that cannot be used: has 3 words"):
        read_log(path, ReadingOptions(lenient=True))
