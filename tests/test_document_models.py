"""YAML and JSON documents are validated, and errors name file, field, value and reason."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic import Field, model_validator

from wherry.documents import Document, load_json, load_yaml, parse_yaml, validate
from wherry.errors import InputError


class Wheel(Document):
    radius: Annotated[float, Field(gt=0, le=1)]
    count: int = 2
    name: str = ""

    @model_validator(mode="after")
    def check(self) -> Wheel:
        if self.name == "square":
            raise ValueError("must be round")
        return self


class Cart(Document):
    wheel: Wheel


@pytest.mark.parametrize(("text", "found"), [("", {}), ("# nothing\n", {}), ("a: 1\nb: [2]\n", {"a": 1, "b": [2]})])
def test_yaml_mapping_is_parsed(text: str, found: dict[str, Any]) -> None:
    assert parse_yaml(text, "file") == found


@pytest.mark.parametrize(
    "text", ["- 1", "a", "a: [", "!!python/object:os.system {}", "a: \t- x", "[" * 3000, "? {a: 1}\n: 2\n? b"]
)
def test_invalid_yaml_is_rejected_in_one_line(text: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "file.yaml")
    assert str(caught.value).startswith("file.yaml: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) <= 300


@pytest.mark.parametrize(("text", "value"), [("1e-1", 0.1), ("2E3", 2000.0), ("-1e+2", -100.0), ("1.5e-1", 0.15)])
def test_numbers_with_an_exponent_are_parsed_as_in_ros(text: str, value: float) -> None:
    assert parse_yaml(f"a: {text}", "file") == {"a": value}


def test_an_integer_is_accepted_for_a_float() -> None:
    assert validate(Wheel, {"radius": 1}, "file").radius == 1.0


@pytest.mark.parametrize(
    ("radius", "reason"),
    [
        (True, "True is invalid: input should be a valid number"),
        ("1", "'1' is invalid: input should be a valid number"),
        (0, "0 is invalid: input should be greater than 0"),
        (1.5, "1.5 is invalid: input should be less than or equal to 1"),
        (float("nan"), "nan is invalid: input should be a finite number"),
        (float("inf"), "inf is invalid: input should be a finite number"),
        ([1] * 100, "[1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,… is invalid: input should be a valid number"),
    ],
)
def test_an_invalid_value_is_quoted_with_its_field(radius: Any, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        validate(Cart, {"wheel": {"radius": radius}}, "cart.yaml")
    assert str(caught.value) == f"cart.yaml: wheel.radius: {reason}"


@pytest.mark.parametrize(
    ("wheel", "message"),
    [
        ({}, "cart.yaml: wheel.radius: is missing"),
        ({"radius": 1, "colour": "red"}, "cart.yaml: wheel.colour: is not a known field"),
        ({"radius": 1, "name": "square"}, "cart.yaml: wheel: must be round"),
        (3, "cart.yaml: wheel: 3 is invalid: input should be a valid dictionary or instance of Wheel"),
    ],
)
def test_missing_unknown_and_contradictory_fields_are_named(wheel: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        validate(Cart, {"wheel": wheel}, "cart.yaml")
    assert str(caught.value) == message


def test_files_are_read_into_models(tmp_path: Path) -> None:
    (tmp_path / "cart.yaml").write_text("wheel: {radius: 5e-1}\n")
    (tmp_path / "cart.json").write_text('{"wheel": {"radius": 0.5}}')
    cart = Cart(wheel=Wheel(radius=0.5))
    assert load_yaml(tmp_path / "cart.yaml", Cart) == load_json(tmp_path / "cart.json", Cart, max_bytes=100) == cart


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"wheel": {"radius": 1}}' + " " * 100])
def test_invalid_json_is_rejected_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / "cart.json").write_text(text)
    with pytest.raises(InputError) as caught:
        load_json(tmp_path / "cart.json", Cart, max_bytes=100)
    assert "\n" not in str(caught.value)
