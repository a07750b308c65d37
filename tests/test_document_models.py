"""YAML and JSON documents are validated, and errors name file, field, value and reason."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic import Field, model_validator

from wherry.documents import Document, Flag, Integer, Number, load_json, load_yaml, parse_yaml, validate
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


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("5e-2", 0.05),
        ("1e+03", 1000.0),
        (".5", 0.5),
        ("+0.05", 0.05),
        ("-.5e1", -5.0),
        (".05E1", 0.5),
        ("5.", 5.0),
        ("010", 10),  # octal in YAML 1.1
        ("0o17", 15),
        ("0x1F", 31),
        ("true", True),
        ("FALSE", False),
        ("~", None),
        ("", None),
        ("!!float 5", 5.0),
        ("!!float '5e-2'", 0.05),
        ("!!str 5", "5"),
    ],
)
def test_scalars_have_the_types_of_yaml_1_2(text: str, value: object) -> None:
    found = parse_yaml(f"a: {text}\n", "file")["a"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    "text", ["yes", "no", "on", "off", "y", "1_000", "1:30", "2024-01-01", "1e", "e5", ".", "0b11", "infinity", "nan"]
)
def test_words_stay_words(text: str) -> None:
    assert parse_yaml(f"a: {text}\n", "file") == {"a": text}


@pytest.mark.parametrize(
    "text",
    [
        "a:\t0.05\nb: [1,\t2]\n",
        "a: 0.05\t# m\nb: [1, 2] \t \n",
        "a: 0.05\n\t# comment\n\t\nb:\n-\t1\n-\t2\n",
        "a: 0.05\r\nb: [1, 2]\r\n",
        "\ufeffa: 0.05\nb: [1, 2]\n",
        "%YAML 1.1\n---\na: 0.05\nb: [1, 2]\n...\n",
        "%YAML:1.0\n---\na: 0.05\nb: [1, 2]\n",  # as OpenCV writes
        "---\na: 0.05\nb: [1, 2]\n---\n",
        "x: &x {a: 0.05}\n<<: *x\nb: [1, 2]\n",
    ],
)
def test_notations_of_ros_files_are_read(text: str) -> None:
    found = parse_yaml(text, "file")
    assert (found["a"], found["b"]) == (0.05, [1, 2])


BOMB = "l0: &l0 [x]\n" + "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 12))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\nb: 2\na: 3", "f.yaml: line 3: repeats the key 'a'"),
        ('b: {a: 1, "a": 2}', "f.yaml: line 1: repeats the key 'a'"),
        ("a: 1\n---\nb: 2", "f.yaml: line 3: begins a second document; a file may have only one"),
        ("a:\n\tb: 1", "f.yaml: line 2: is not YAML: a tab indents the line; use spaces"),
        ("a: &a [*a]", "f.yaml: line 1: is nested too deeply: the alias 'a' is inside its own anchor"),
        (BOMB, "f.yaml: line 6: has more than 50,000 values"),
        ("a: " + "[" * 50_000, "f.yaml: line 1: is nested too deeply: more than 50 levels"),
        ("a: !!float wide", "f.yaml: line 1: is not YAML: 'wide' is not a number that can be read"),
        ("a: " + "9" * 5000, "f.yaml: line 1: is not YAML: '99999999999999999999' is not a number that can be read"),
        ("a: \0", "f.yaml: is not YAML: the character 0 is not permitted"),
    ],
)
def test_ambiguous_and_oversized_yaml_is_refused_with_its_line(text: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "f.yaml")
    assert str(caught.value) == message


class Robot(Document):
    speed: Annotated[Number, Field(gt=0)] = 1.0
    wheels: Integer = 2
    holonomic: Flag = False
    origin: list[Number] | None = None


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"speed": "0.05", "wheels": "4", "holonomic": "1"}, (0.05, 4, True)),
        ({"speed": " 5e-2 ", "wheels": 4.0, "holonomic": 1}, (0.05, 4, True)),
        ({"speed": 1, "wheels": "1e1", "holonomic": "yes"}, (1.0, 10, True)),
        ({"holonomic": "Off"}, (1.0, 2, False)),
    ],
)
def test_numbers_and_flags_may_be_quoted(fields: dict[str, Any], expected: tuple[Any, ...]) -> None:
    robot = validate(Robot, fields, "file")
    assert (robot.speed, robot.wheels, robot.holonomic) == expected
    assert validate(Robot, {"origin": ["1", -2, "3e0"]}, "file").origin == [1.0, -2.0, 3.0]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("speed", "yes"),
        ("speed", True),
        ("speed", "wide"),
        ("speed", ""),
        ("speed", "0"),
        ("speed", "inf"),
        ("speed", ".inf"),
        ("speed", 10**400),
        ("speed", None),
        ("wheels", "on"),
        ("wheels", False),
        ("wheels", "2.5"),
        ("wheels", 2.5),
        ("wheels", "9" * 5000),
        ("holonomic", "2"),
        ("holonomic", 2),
        ("holonomic", 1.0),
        ("holonomic", "maybe"),
    ],
)
def test_a_word_is_no_number_and_a_number_no_flag(field: str, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        validate(Robot, {field: value}, "robot.yaml")
    assert str(caught.value).startswith(f"robot.yaml: {field}: ")


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


def test_an_error_is_one_short_line_whatever_the_file_contains() -> None:
    error = InputError("some\nfile", "a\x00" * 200, "quotes \x1b[31m\n" * 200)
    assert str(error).isprintable()
    assert len(str(error)) < 350
