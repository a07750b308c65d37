from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from wherry.errors import InputError
from wherry.yaml_files import check_number, load_mapping


@pytest.mark.parametrize(("text", "found"), [("", {}), ("# nothing\n", {}), ("a: 1\nb: [2]\n", {"a": 1, "b": [2]})])
def test_a_mapping_is_read(tmp_path: Path, text: str, found: dict[str, Any]) -> None:
    (tmp_path / "file.yaml").write_text(text)
    assert load_mapping(tmp_path / "file.yaml") == found


@pytest.mark.parametrize("text", ["- 1", "a", "a: [", "!!python/object:os.system {}"])
def test_anything_else_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "file.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_mapping(tmp_path / "file.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [None, True, "1", [1], math.nan, math.inf, 0, -1, 10.1])
def test_what_is_no_number_or_out_of_bounds_is_refused(value: Any) -> None:
    with pytest.raises(InputError, match=r"^file: field: "):
        check_number("file", "field", value, most=10.0)


def test_numbers_may_be_whole_and_negative_where_that_makes_sense() -> None:
    assert check_number("file", "field", 10, most=10.0) == 10.0
    assert check_number("file", "field", -10, most=10.0, positive=False) == -10.0
