"""Simulated deliveries in two small worlds: results, files, and their use in later runs."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from wherry.errors import InputError
from wherry.floorplan.world_files import find_world, format_world
from wherry.pipelines.delivery.result import DeliveryResult
from wherry.pipelines.delivery.simulated import DeliveryRun, DeliverySettings, prepare_delivery
from wherry.realization.mission import order_from_plan
from wherry.trace.records import Record, RobotSnapshot, StepTaken, null_sink

TIMINGS = {"wall_seconds", "real_time_factor"}


def deliver(world: str, out: Path, **changes: object) -> tuple[DeliveryResult, DeliveryRun]:
    """Run a delivery."""
    run = prepare_delivery(replace(DeliverySettings(world=world, out=out), **changes))  # type: ignore[arg-type]
    return run(null_sink), run


def without_timings(result: DeliveryResult) -> dict[str, object]:
    """The result without the metrics that depend on the computer's speed."""
    return {name: value for name, value in result.as_json().items() if name not in TIMINGS}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[DeliveryResult, Path]:
    out = tmp_path_factory.mktemp("small")
    return deliver("small", out)[0], out


@pytest.fixture(scope="module")
def taxi(tmp_path_factory: pytest.TempPathFactory) -> tuple[DeliveryResult, Path]:
    out = tmp_path_factory.mktemp("taxi")
    return deliver("taxi", out)[0], out


@pytest.fixture(params=["small", "taxi"])
def run(request: pytest.FixtureRequest) -> tuple[DeliveryResult, Path]:
    delivered: tuple[DeliveryResult, Path] = request.getfixturevalue(request.param)
    return delivered


def test_every_box_is_delivered_without_a_collision(run: tuple[DeliveryResult, Path]) -> None:
    result, _ = run
    assert (result.status, result.exit_status) == ("delivered", 0)
    assert result.delivered == result.boxes > 0
    assert (result.collisions, result.unreachable) == (0, 0)
    assert 0 < result.learning_steps <= result.actions
    assert result.path_ratio is None or 1.0 <= result.path_ratio < 2.0


def test_localization_and_map_are_accurate(run: tuple[DeliveryResult, Path]) -> None:
    result, _ = run
    assert result.localization_rmse_m is not None
    assert 0.0 < result.localization_rmse_m < 0.08
    assert result.map_error_m is not None
    assert 0.0 < result.map_error_m < 0.02


def test_all_files_are_written(run: tuple[DeliveryResult, Path]) -> None:
    result, out = run
    names = {path.name for path in out.iterdir()}
    assert {"result.json", "rules.json", "map.yaml", "map.pgm", "report.html"} <= names
    assert not [name for name in names if name.startswith(".")]  # no temporary files
    assert json.loads((out / "result.json").read_text("utf-8")) == result.as_json()
    assert set(result.as_json()) == {field.name for field in fields(DeliveryResult)}
    page = (out / "report.html").read_text("utf-8")
    assert page.count("<svg") >= 3
    assert "All boxes are delivered." in page


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(taxi: tuple[DeliveryResult, Path], tmp_path: Path) -> None:
    first, out = taxi
    again, _ = deliver("taxi", tmp_path)
    assert without_timings(again) == without_timings(first)
    for name in ("map.pgm", "map.yaml", "rules.json"):
        assert (tmp_path / name).read_bytes() == (out / name).read_bytes()


@pytest.mark.slow
def test_another_seed_gives_another_run(taxi: tuple[DeliveryResult, Path], tmp_path: Path) -> None:
    other, _ = deliver("taxi", tmp_path, seed=1)
    assert other.status == "delivered"
    assert without_timings(other) != without_timings(taxi[0])


def test_rules_learnt_in_one_world_need_no_learning_in_another(
    small: tuple[DeliveryResult, Path], taxi: tuple[DeliveryResult, Path], tmp_path: Path
) -> None:
    for world, (_, out) in (("taxi", small), ("small", taxi)):
        result, _ = deliver(world, tmp_path, rules_file=out / "rules.json", seed=1)
        assert result.status == "delivered"
        assert result.learning_steps == 0
        assert result.path_ratio is not None
        assert 1.0 <= result.path_ratio <= 1.3


def test_a_map_and_rules_replace_exploring_and_learning(small: tuple[DeliveryResult, Path], tmp_path: Path) -> None:
    first, out = small
    records: list[Record] = []
    settings = DeliverySettings(
        world="small", out=tmp_path, seed=2, map_file=out / "map.yaml", rules_file=out / "rules.json"
    )
    result = prepare_delivery(settings)(records.append)
    assert result.status == "delivered"
    assert (result.learning_steps, result.collisions) == (0, 0)
    assert result.sim_seconds < first.sim_seconds
    phases = {record.phase for record in records if hasattr(record, "phase")}
    assert "explore" not in phases
    assert "localize" in phases


@pytest.mark.slow
def test_an_unreachable_box_is_reported_and_the_others_are_delivered(tmp_path: Path) -> None:
    # A wall encloses the cell R with its box.
    text = format_world(find_world("taxi"))
    plan = find_world("taxi")
    lines = text.splitlines()
    row = next(number for number, line in enumerate(lines) if "R" in line and line.startswith("|"))
    lines[row] = lines[row][:4] + "|" + lines[row][5:]
    lines[row + 1] = "+---" + lines[row + 1][4:]
    file = tmp_path / "walled.txt"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    result, run = deliver(str(file), tmp_path / "out")
    assert run.unreachable == (plan.marks["R"],)
    assert (result.delivered, result.boxes, result.unreachable) == (2, 3, 1)
    assert (result.status, result.exit_status, result.collisions) == ("delivered", 0, 0)


def test_a_world_without_boxes_counts_as_delivered(tmp_path: Path) -> None:
    result, _ = deliver("small", tmp_path, boxes=0)
    assert (result.delivered, result.boxes, result.status, result.actions) == (0, 0, "delivered", 0)


@pytest.mark.parametrize("after", ["the first snapshot", "some actions"])
def test_ctrl_c_ends_a_run_and_keeps_the_learnt_rules(after: str, tmp_path: Path) -> None:
    steps = 0

    def interrupt(record: Record) -> None:
        nonlocal steps
        steps += isinstance(record, StepTaken)
        if (after == "the first snapshot" and isinstance(record, RobotSnapshot)) or steps == 8:
            raise KeyboardInterrupt

    run = prepare_delivery(DeliverySettings(world="taxi", out=tmp_path))
    result = run(interrupt)
    assert (result.status, result.exit_status) == ("stopped", 130)
    rules = tmp_path / "rules.json"
    assert rules.exists()
    assert (tmp_path / "report.html").exists() is (after == "some actions")
    assert prepare_delivery(DeliverySettings(world="taxi", out=tmp_path, rules_file=rules)).rules == run.rules


def test_the_order_gives_the_warehouse_relative_to_the_start() -> None:
    plan = find_world("taxi")
    order = order_from_plan(plan)
    assert order.cell_size == plan.cell_size
    # The robot faces east in (2, 2): the warehouse (0, 0) is two cells behind it and two to its right.
    np.testing.assert_allclose(order.warehouse, [[-1.2, -1.2]])


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"boxes": -1}, "--boxes"),
        ({"boxes": 10_000}, "boxes"),
        ({"learner": "magic"}, "--learner"),
        ({"world": "nowhere"}, "nowhere"),
        ({"map_file": Path("no/such.yaml")}, "no/such.yaml"),
        ({"rules_file": Path("no/such.json")}, "no/such.json"),
    ],
)
def test_invalid_settings_are_rejected_before_any_file_is_written(
    changes: dict[str, object], where: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=where):
        prepare_delivery(replace(DeliverySettings(world="small", out=tmp_path / "out"), **changes))  # type: ignore[arg-type]
    assert not (tmp_path / "out").exists()
